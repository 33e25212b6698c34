"""Synthetic minutes of a catheter laboratory, and the damage that exports of them suffer."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

Columns = dict[str, np.ndarray]


class Minute(NamedTuple):
    """Samples, and the truth behind them.

    Attributes:
        columns: `time` [s], `p_aortic`, `p_distal` [mmHg].
        onset: start of every beat [s].
        ectopic: whether a beat is premature, cut short by one, or follows its pause.
        period: mean length of the ordinary beats [s].
        mean: mean of both pressures over ordinary beats, respiration left out [mmHg].
    """

    columns: Columns
    onset: np.ndarray
    ectopic: np.ndarray
    period: float
    mean: dict[str, float]


def _beat(since: np.ndarray, period: float, strength: float) -> np.ndarray:
    """Pressure of a beat [mmHg]: upstroke, systole, notch, decay."""
    systole = 0.34 * np.sqrt(period / 0.8)
    valve = 1.0 / (1.0 + np.exp(-(since - 0.03) / 0.008))
    bump = np.sqrt(np.sin(np.pi * np.clip((since + 0.03) / (systole + 0.06), 0.0, 1.0)))
    notch = 2.4 * np.exp(-0.5 * ((since - systole - 0.06) / 0.025) ** 2) - 3.2 * np.exp(
        -0.5 * ((since - systole) / 0.012) ** 2
    )
    decay = 18.0 * np.exp(-np.maximum(since - 0.3, 0.0) / 0.35)
    return 66.0 + strength * (valve * (34.0 * bump + decay) + notch)


def minute(
    seed: int = 0,
    *,
    seconds: float = 60.0,
    rate: float = 100.0,
    period: float = 0.8,
    noise: float = 1.0,
    respiration: float = 4.0,
    ectopics: float = 0.1,
    ratio: float = 0.9,
    delay: float = 0.012,
    sway: float = 0.03,
) -> Minute:
    """A minute of both pressures.

    Args:
        seed: of the draws.
        seconds: length.
        rate: samples a second.
        period: of a beat at rest of the respiration [s].
        noise: standard deviation of a sample [mmHg].
        respiration: amplitude of the pressure's swing [mmHg].
        ectopics: share of beats that an extrasystole cuts short.
        ratio: distal over aortic pressure.
        delay: of the distal pressure [s].
        sway: relative amplitude by which lengths of beats follow the respiration.
    """
    rng = np.random.default_rng(seed)
    onset, ectopic = [-0.37], []
    while onset[-1] < seconds + 2.0 * period:
        if len(ectopic) > 2 and not ectopic[-1] and rng.random() < ectopics:
            onset += [onset[-1] + 0.62 * period, onset[-1] + 1.98 * period]
            ectopic += [True, True]
        else:
            onset.append(onset[-1] + period * (1.0 + sway * np.sin(np.pi * onset[-1] / 2.0)))
            ectopic.append(False)
    starts, wrong = np.array(onset), np.array(ectopic)
    fine = np.arange(-0.3, seconds + 0.3, 0.001)
    P, ordinary, lengths = np.full(fine.size, 70.0), np.zeros(fine.size, bool), []
    for k, bad in enumerate(wrong):
        inside = (fine >= starts[k]) & (fine < starts[k + 1])
        early = bool(bad and k and wrong[k - 1])
        P[inside] = _beat(fine[inside] - starts[k], period, 0.6 if early else 1.0)
        if not bad and starts[k] > 0.0 and starts[k + 1] < seconds:
            ordinary |= inside
            lengths.append(starts[k + 1] - starts[k])
    kernel = np.exp(-0.5 * (np.arange(-15, 16) / 5.0) ** 2)
    P = np.convolve(P, kernel / kernel.sum(), mode="same")
    swing = respiration * np.sin(np.pi * fine / 2.0)
    t = np.arange(0.0, seconds, 1.0 / rate)
    columns = {
        "time": t,
        "p_aortic": np.interp(t, fine, P + swing) + noise * rng.standard_normal(t.size),
        "p_distal": np.interp(t - delay, fine, ratio * P + swing)
        + noise * rng.standard_normal(t.size),
    }
    after = np.concatenate([[False], wrong[:-1]])
    mean = float(P[ordinary].mean())
    return Minute(
        columns, starts[:-1], wrong | after, float(np.mean(lengths)),
        {"P_aorta": mean, "P_distal": ratio * mean},
    )  # fmt: skip


def export(columns: Columns, *, separator: str = ",", decimal: str = ".") -> str:
    """The columns as a console writes them."""
    lines = [separator.join(columns)]
    for row in zip(*columns.values(), strict=True):
        lines.append(separator.join(f"{v:.3f}".replace(".", decimal) for v in row))
    return "\n".join(lines) + "\n"


def _rows(text: str) -> tuple[str, list[list[str]]]:
    head, *body = text.strip().split("\n")
    return head, [row.split(",") for row in body]


def _text(head: str, rows: list[list[str]]) -> str:
    return "\n".join([head, *(",".join(row) for row in rows)]) + "\n"


def _cells(change: Callable[[int, list[str]], list[str] | None]) -> Callable[[str], str]:
    """Damage row by row; None: the row is lost."""

    def damaged(text: str) -> str:
        head, rows = _rows(text)
        found = [change(k, row) for k, row in enumerate(rows)]
        return _text(head, [row for row in found if row is not None])

    return damaged


def _scaled(factor: float, first: int = 1) -> Callable[[str], str]:
    return _cells(lambda k, row: row[:first] + [f"{float(v) * factor:.4f}" for v in row[first:]])


def _set(column: int, value: str, where: Callable[[int], bool]) -> Callable[[str], str]:
    return _cells(
        lambda k, row: [value if c == column and where(k) else v for c, v in enumerate(row)]
    )


def _two_rates(text: str) -> str:
    head, rows = _rows(text)
    return _text(head, rows[:3000] + rows[3000::2])


def _headers(text: str) -> str:
    above = "Patient;Doe, J.\nDate;24.11.2026;10:32\nExport 2.1\n\n"
    return above + text.replace(".", "#").replace(",", ";").replace("#", ",")


def _with_units(text: str) -> str:
    head, body = text.split("\n", 1)
    return f"{head}\ns,mmHg,mmHg\n{body}"


def _noisy(text: str) -> str:
    rng = np.random.default_rng(3)
    return _cells(lambda k, row: [row[0], *(f"{v:.2f}" for v in rng.uniform(60, 120, 2))])(text)


def _shaken(text: str) -> str:
    return _cells(lambda k, row: [row[0], *(("250.0",) * 2 if 2000 <= k < 2060 else row[1:])])(text)


def _restarted(text: str) -> str:
    head, rows = _rows(text)
    return _text(head, rows[2000:] + rows[:2000])


def _clock(text: str) -> str:
    return _cells(
        lambda k, row: [
            f"10:{31 + int(float(row[0]) // 60):02d}:{float(row[0]) % 60:05.2f}",
            *row[1:],
        ]
    )(text)


KEPT: dict[str, Callable[[str], str]] = {
    "as it is": lambda text: text,
    "byte-order mark": lambda text: "\ufeff" + text,
    "carriage returns": lambda text: text.replace("\n", "\r\n"),
    "headers, semicolons, decimal commas": _headers,
    "tabs": lambda text: text.replace(",", "\t"),
    "quotes": _cells(lambda k, row: [f'"{v}"' for v in row]),
    "a line of units": _with_units,
    "clock times": _clock,
    "truncated last line": lambda text: text.rstrip()[:-9],
    "NaN text": _set(1, "NaN", lambda k: k % 400 < 3),
    "empty cells": _set(2, "", lambda k: k % 300 == 7),
    "a gap": _cells(lambda k, row: None if 1500 <= k < 1900 else row),
    "lost samples": _cells(lambda k, row: None if k % 37 == 0 else row),
    "two rates": _two_rates,
    "some doubled times": _cells(
        lambda k, row: row if k % 900 else [f"{k / 100 + 0.01:.3f}", *row[1:]]
    ),
    "a flush": _shaken,
    "some wrong times": _set(0, "7.5", lambda k: k % 1900 == 30),
    "drift": _cells(lambda k, row: [*row[:2], f"{float(row[2]) + k / 2000:.3f}"]),
    "further columns": _cells(lambda k, row: [*row, "x" if k == 70 else ""]),
    "milliseconds, named": lambda text: _cells(
        lambda k, row: [f"{1000 * float(row[0]):.0f}", *row[1:]]
    )(text).replace("time,", "time [ms],"),
    "kPa, named": lambda text: (
        _scaled(0.1333224)(text)
        .replace("p_aortic", "p_aortic [kPa]")
        .replace("p_distal", "p_distal [kPa]")
    ),
}
"""Exports of which a record can be made."""

REFUSED: dict[str, tuple[Callable[[str], str], str]] = {
    "kPa": (_scaled(0.1333224), "--unit kPa"),
    "dyn/cm2": (_scaled(1333.224), "not plausible"),
    "swapped": (lambda text: text.replace("p_aortic", "x").replace("p_distal", "p_aortic")
                .replace("x", "p_distal"), "exchange"),
    "constant": (_set(2, "80.0", lambda k: True), "hardly moves"),
    "means": (_cells(lambda k, row: [row[0], f"{92 + k % 3 / 10}", row[2]]), "hardly moves"),
    "reversed time": (_cells(lambda k, row: [f"{60 - k / 100:.3f}", *row[1:]]), "backwards"),
    "two recordings": (_restarted, "falls back"),
    "coarse clock": (_cells(lambda k, row: [f"{k / 100:.1f}", *row[1:]]), "--rate"),
    "milliseconds": (_cells(lambda k, row: [f"{10 * k}", *row[1:]]), "--time-unit"),
    "no names": (lambda text: text.split("\n", 1)[1], "--columns"),
    "other names": (lambda text: text.replace("p_aortic", "art1"), "--columns"),
    "two aortic columns": (lambda text: text.replace("p_distal", "Pa"), "choose one"),
    "same column twice": (_cells(lambda k, row: [row[0], row[1], row[1]]), "the same numbers"),
    "noise alone": (_noisy, "no regular beats"),
    "two seconds": (lambda text: "\n".join(text.split("\n")[:200]), "beats"),
    "ten rows": (lambda text: "\n".join(text.split("\n")[:11]), "numbers"),
    "empty": (lambda text: "", "no rows of numbers"),
    "words": (lambda text: "no pressure was recorded\n" * 80, "no rows of numbers"),
    "commas twice": (lambda text: "time,p_aortic,p_distal\n"
                     + text.split("\n", 1)[1].replace(".", ","), "decimal"),
    "mostly NaN": (_set(1, "nan", lambda k: k % 3 < 2), "hold no plausible"),
    "5 Hz": (_cells(lambda k, row: row if k % 20 == 0 else None), "50 Hz"),
}  # fmt: skip
"""Exports of which none can be made, and a word of the sentence that says why."""
