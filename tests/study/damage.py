"""Damage that measured records suffer, drawn at random."""

from collections.abc import Callable

import numpy as np

Files = dict[str, str]


def _rows(files: Files, name: str) -> list[list[str]]:
    return [row.split(",") for row in files[name].strip().split("\n")]


def _with(files: Files, name: str, rows: list[list[str]]) -> Files:
    return {**files, name: "\n".join(",".join(row) for row in rows) + "\n"}


def _table(rng: np.random.Generator, files: Files) -> str:
    return str(rng.choice([name for name in files if name.endswith(".csv")]))


def letters(rng: np.random.Generator, files: Files) -> Files:
    """Some characters of a file are others."""
    name = str(rng.choice(list(files)))
    text = list(files[name])
    for _ in range(int(rng.integers(1, 6))):
        text[int(rng.integers(len(text)))] = str(rng.choice(list('0.-,=\n[]x" ')))
    return {**files, name: "".join(text)}


def no_column(rng: np.random.Generator, files: Files) -> Files:
    """A pressure was not recorded."""
    name, k = _table(rng, files), int(rng.integers(1, 3))
    return _with(files, name, [row[:k] + row[k + 1 :] for row in _rows(files, name)])


def scaled(rng: np.random.Generator, files: Files) -> Files:
    """Pressures in kPa, or with a gain."""
    name, factor = _table(rng, files), float(rng.choice([1 / 7.5, 0.1, 0.9, 1.15]))
    head, *body = _rows(files, name)
    return _with(
        files, name, [head, *([t, *(repr(float(v) * factor) for v in r)] for t, *r in body)]
    )


def gap(rng: np.random.Generator, files: Files) -> Files:
    """Samples without a number."""
    name = _table(rng, files)
    head, *body = _rows(files, name)
    for k in rng.integers(len(body), size=3):
        body[k][1] = str(rng.choice(["nan", "", "inf"]))
    return _with(files, name, [head, *body])


def clipped(rng: np.random.Generator, files: Files) -> Files:
    """A trace cut off at some height."""
    name, k, share = _table(rng, files), int(rng.integers(1, 3)), float(rng.uniform(0.7, 1.0))
    head, *body = _rows(files, name)
    values = np.array([float(row[k]) for row in body])
    top = values.min() + share * np.ptp(values)
    for row in body:
        row[k] = repr(min(float(row[k]), float(top)))
    return _with(files, name, [head, *body])


def swapped(rng: np.random.Generator, files: Files) -> Files:
    """Aortic and distal pressure exchanged."""
    name = _table(rng, files)
    head, *body = _rows(files, name)
    return _with(files, name, [head, *([t, b, a] for t, a, b in body)])


def misaligned(rng: np.random.Generator, files: Files) -> Files:
    """Beats that start elsewhere in the cycle."""
    name = _table(rng, files)
    head, *body = _rows(files, name)
    by = int(rng.integers(1, len(body)))
    turned = [r[1:] for r in body[by:] + body[:by]]
    return _with(files, name, [head, *([t, *v] for (t, *_), v in zip(body, turned, strict=True))])


def backward_flow(rng: np.random.Generator, files: Files) -> Files:
    """A flow column, of the wrong sign every second time."""
    name, sign = _table(rng, files), float(rng.choice([-1.0, 1.0]))
    head, *body = _rows(files, name)
    waves = [[*row, repr(sign * (70.0 + 30.0 * np.sin(k / 20.0)))] for k, row in enumerate(body)]
    return _with(files, name, [[*head, "Q_coronary_ml_per_min"], *waves])


def no_condition(rng: np.random.Generator, files: Files) -> Files:
    """A condition was not measured."""
    head, *parts = files["record.toml"].split("\n[condition.")
    del parts[int(rng.integers(len(parts)))]
    return {**files, "record.toml": "\n[condition.".join([head, *parts])}


def odd_value(rng: np.random.Generator, files: Files) -> Files:
    """A number of the record is larger or smaller."""
    lines = files["record.toml"].split("\n")
    at = [k for k, line in enumerate(lines) if " = " in line and line[-1].isdigit()]
    k = int(rng.choice(at))
    key, value = lines[k].split(" = ")
    factor = float(rng.choice([-1.0, 0.0, 0.5, 0.8, 1.3, 3.0, 60.0]))
    lines[k] = f"{key} = {float(value) * factor!r}"
    return {**files, "record.toml": "\n".join(lines)}


def fewer_rows(rng: np.random.Generator, files: Files) -> Files:
    """A file that ends early."""
    name = _table(rng, files)
    rows = _rows(files, name)
    return _with(files, name, rows[: int(rng.integers(1, len(rows)))])


KINDS: tuple[Callable[[np.random.Generator, Files], Files], ...] = (
    letters, no_column, scaled, gap, clipped, swapped, misaligned, backward_flow, no_condition,
    odd_value, fewer_rows,
)  # fmt: skip


def damaged(rng: np.random.Generator, files: Files) -> Files:
    """The record with one kind of damage, sometimes two."""
    kinds = [KINDS[int(k)] for k in rng.choice(len(KINDS), size=2, replace=False)]
    first = kinds[0](rng, files)
    try:
        return kinds[1](rng, first) if rng.random() < 0.3 else first
    except (ValueError, IndexError):  # the first left nothing that the second could damage
        return first
