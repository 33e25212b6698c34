"""Scores answers to a foreign set against its sealed labels; knows nothing of the method.

Effects rank by the sum of the probabilities of all hypotheses that hold them. λ is that of the
label: the visibility of the effect by its generator. An effect called "outside" by the generator
that the catalogue holds under another name counts as that effect (`HELD`). A null whose aortic
waveform is of another family has the effect `aortic_waveform`.

Some records have an effect and, besides, an aortic waveform of another family. Naming the waveform
there is right but tells nothing of the effect, so it is struck out of the answer (`_without`): what
is left is scored as if the waveform had been known.
"""

import json
import pathlib
from typing import Any

import numpy as np

from benchmarks.blind.score import expected_calibration_error, wilson
from benchmarks.foreign.check import WAVEFORM, read_answers
from benchmarks.foreign.noise_floor import noise_floor, share_closed
from benchmarks.foreign.regret import log_regret

HELD = {
    "outside:distal_gain": "sensor_gain",
    "outside:damped_distal": "distal_damping",
    "outside:ringing_catheter": "catheter_damping",
}
"""Kinds outside the generators' list that the catalogue of effects holds."""

VISIBLE = 3.0
"""Visibility λ from which an effect can be asked for."""

Row = dict[str, Any]


def joined(folder: pathlib.Path, name: str) -> list[Row]:
    """Answers of a method with their labels.

    Args:
        folder: a set.
        name: of the method: `answers-NAME.json` lies in the folder.

    Raises:
        ValueError: there are no answers, or one is not as it has to be, see `read_answers`.
    """
    labels = labels_of(folder)
    file = folder / f"answers-{name}.json"
    if not file.is_file():
        raise ValueError(
            f"{folder} has no {file.name}. A method called NAME writes answers-NAME.json; those of"
            " the project are written by `python -m benchmarks.foreign answer`."
        )
    answers = read_answers(file, labels)
    rows = []
    for record, answer in sorted(answers.items()):
        label = labels[record]
        truth, lam = HELD.get(label["truth"], label["truth"]), float(label["lambda"])
        family = label.get("background", {}).get("family", "assumed")
        if truth == "none" and family != "assumed":
            truth, lam = WAVEFORM, float(label["background"]["lambda"])
        if family != "assumed" and truth != WAVEFORM:
            answer = _without(answer, WAVEFORM)
        row = {**answer, "record": record, "truth": truth, "lambda": lam, "label": label}
        if answer["verdict"] == "named":
            row["closed"] = share_closed(answer, noise_floor(folder, record))
        rows.append(row)
    return rows


def labels_of(folder: pathlib.Path) -> dict[str, Row]:
    """Labels of a set by record.

    Raises:
        ValueError: the folder is no set.
    """
    file = folder / "labels.json"
    if not file.is_file():
        raise ValueError(
            f"{folder} is no set: it has no {file.name}. `python -m benchmarks.foreign make` makes"
            " one."
        )
    return json.loads(file.read_text(encoding="utf-8"))["records"]


def _without(answer: Row, effect: str) -> Row:
    """An answer without one effect: hypotheses that hold it count for what else they hold."""
    parts: dict[str, dict[str, float]] = {}
    for kind in ("probabilities", "beside"):
        found: dict[str, float] = {}
        for name, p in answer.get(kind, {}).items():
            left = "+".join(part for part in name.split("+") if part != effect)
            if left or kind == "probabilities":
                found[left or "none"] = found.get(left or "none", 0.0) + p
        parts[kind] = found
    named = [name for name in answer["named"] if name != effect]
    alone = answer["verdict"] == "named" and not named
    return {**answer, **parts, "named": named, "verdict": "no_gap" if alone else answer["verdict"]}


def inclusion(row: Row) -> dict[str, float]:
    """Probability of every effect, alone or with others."""
    found: dict[str, float] = {}
    for name, p in [*row["probabilities"].items(), *row.get("beside", {}).items()]:
        for part in name.split("+"):
            if part not in ("none", "unknown"):
                found[part] = found.get(part, 0.0) + p
    return found


def ranked_first(row: Row) -> str:
    """The likeliest effect; empty where none has a probability, or several the largest."""
    found = inclusion(row)
    most = max(found.values(), default=0.0)
    first = [name for name, p in found.items() if p == most]
    return first[0] if most > 0.0 and len(first) == 1 else ""


def calibration(rows: list[Row]) -> float:
    """Expected calibration error of the likeliest hypothesis's probability."""
    p, hit = [], []
    for row in rows:
        name = max(row["probabilities"], key=lambda n: row["probabilities"][n])
        true = "unknown" if row["truth"].startswith("outside") else row["truth"]
        p.append(row["probabilities"][name])
        hit.append(float(name == true))
    return expected_calibration_error(np.array(p), np.array(hit))


def score(rows: list[Row]) -> dict[str, str]:
    """All figures of one set or of several."""
    single = [r for r in rows if r["truth"] != "none" and not r["truth"].startswith("outside")]
    null = [r for r in rows if r["truth"] == "none"]
    outside = [r for r in rows if r["truth"].startswith("outside")]
    seen = [r for r in single if r["lambda"] >= VISIBLE]
    far = [r for r in outside if r["lambda"] >= VISIBLE]
    named = [r for r in single if r["verdict"] == "named"]
    held = [r["held_out_rms_mmHg"] for r in rows if "held_out_rms_mmHg" in r]
    worse = sum(after > 1.1 * before + 0.05 for before, after in held)
    closed = [
        1.0 - r["held_out_rms_mmHg"][1] / r["held_out_rms_mmHg"][0]
        for r in named
        if "held_out_rms_mmHg" in r
    ]
    allowed = [r["closed"] for r in named if r.get("closed") is not None]

    def first(some: list[Row]) -> str:
        return wilson(sum(ranked_first(r) == r["truth"] for r in some), len(some))

    def says(some: list[Row], *verdicts: str) -> str:
        return wilson(sum(r["verdict"] in verdicts for r in some), len(some))

    return {
        f"first, λ ≥ {VISIBLE:g}": first(seen),
        "first, all": first(single),
        "first, if a gap is seen": first([r for r in single if r["verdict"] != "no_gap"]),
        "named": says(single, "named"),
        "right if named": wilson(sum(r["named"] == [r["truth"]] for r in named), len(named)),
        "holds the effect if named": wilson(
            sum(r["truth"] in r["named"] for r in named), len(named)
        ),
        "false alarms": says(null, "named", "ambiguous", "unknown"),
        "outside: named": says(outside, "named"),
        f"outside, λ ≥ {VISIBLE:g}: flagged": says(far, "ambiguous", "unknown"),
        "calibration error": f"{calibration(rows):.3f}" if rows else "-",
        "held-out gap closed if named": f"{np.median(closed):.2f}" if closed else "-",
        "… of what noise leaves to close": f"{np.median(allowed):.2f}" if allowed else "-",
        "made worse": wilson(worse, len(held)),
    }


def misses(rows: list[Row]) -> list[str]:
    """Every record that was ranked or named wrongly, in a line."""
    lines = []
    for row in rows:
        outside, none = row["truth"].startswith("outside"), row["truth"] == "none"
        wrong = (
            (outside and row["verdict"] == "named")
            or (none and row["verdict"] != "no_gap")
            or (not outside and not none and ranked_first(row) != row["truth"])
            or (not outside and row["verdict"] == "named" and row["named"] != [row["truth"]])
        )
        if wrong:
            lines.append(
                f"{row['record']}: {row['truth']}, {row['label']['form']} (λ {row['lambda']:.1f})"
                f" -> {row['verdict']}: {', '.join(row['named'][:3]) or '-'}; "
                f"first {ranked_first(row) or '-'}"
            )
    return lines


def table(folders: list[pathlib.Path], name: str) -> str:
    """Figures of a method over sets, apart and together, as a Markdown table."""
    alike = len({folder.name for folder in folders}) < len(folders)
    places = {str(folder) if alike else folder.name: folder for folder in folders}
    sets = {column: joined(folder, name) for column, folder in places.items()}
    sizes = {column: len(labels_of(folder)) for column, folder in places.items()}
    oracles = {c: against_oracle(folder, sets[c]) for c, folder in places.items()}
    if len(sets) > 1:
        sizes["all"] = sum(sizes.values())
        sets["all"] = [row for rows in sets.values() for row in rows]
        oracles["all"] = [pair for pairs in oracles.values() for pair in pairs]
    answered = {c: {"answered": f"{len(rows)} of {sizes[c]}"} for c, rows in sets.items()}
    return _markdown(name, sets, oracles, answered)


def comparison(folders: list[pathlib.Path], names: list[str]) -> str:
    """Figures of several methods over all sets together, as a Markdown table.

    Only records that all of them have answered count.

    Args:
        folders: sets.
        names: of the methods, one column each.
    """
    columns: dict[str, list[Row]] = {name: [] for name in names}
    oracles: dict[str, list[tuple[Row, Row]]] = {name: [] for name in names}
    for folder in folders:
        found = {name: joined(folder, name) for name in columns}
        common = set.intersection(*({row["record"] for row in rows} for rows in found.values()))
        for name, rows in found.items():
            own = [row for row in rows if row["record"] in common]
            columns[name] += own
            oracles[name] += against_oracle(folder, own)
    (count,) = {len(rows) for rows in columns.values()}
    return _markdown(f"{count} records", columns, oracles)


def _markdown(
    head: str,
    columns: dict[str, list[Row]],
    oracles: dict[str, list[tuple[Row, Row]]],
    first: dict[str, dict[str, str]] | None = None,
) -> str:
    """A table with one line a figure and one column a group of answers.

    Args:
        head: of the first column.
        columns: answers.
        oracles: those of which the oracle's are known, with these; without any, no regret is shown.
        first: figures above all others, by column.
    """
    figures = {
        label: {**(first[label] if first else {}), **score(rows)} for label, rows in columns.items()
    }
    if any(oracles.values()):
        figures = {label: {**f, **regret(oracles[label])} for label, f in figures.items()}
    lines = [f"| {head} | " + " | ".join(figures) + " |", "|---" * (len(figures) + 1) + "|"]
    for key in next(iter(figures.values())):
        lines.append(f"| {key} | " + " | ".join(f[key] for f in figures.values()) + " |")
    return "\n".join(lines)


def against_oracle(folder: pathlib.Path, rows: list[Row]) -> list[tuple[Row, Row]]:
    """Rows of a method beside the oracle's, of records that both answered; empty without it."""
    if not (folder / "answers-oracle.json").is_file():
        return []
    best = {row["record"]: row for row in joined(folder, "oracle")}
    return [(row, best[row["record"]]) for row in rows if row["record"] in best]


def regret(pairs: list[tuple[Row, Row]]) -> dict[str, str]:
    """Figures of a method beside the oracle, see `benchmarks.foreign.regret`."""
    seen = [
        pair
        for pair in pairs
        if pair[0]["lambda"] >= VISIBLE
        and pair[0]["truth"] != "none"
        and not pair[0]["truth"].startswith("outside")
    ]
    own, best = (sum(ranked_first(p[k]) == p[k]["truth"] for p in seen) for k in (0, 1))
    mean = "{:.2f} [{:.2f}, {:.2f}]".format(*log_regret(pairs)) if pairs else "-"
    return {
        "log-score regret, 90 %": mean,
        f"first, λ ≥ {VISIBLE:g}: method, oracle": f"{own}, {best} of {len(seen)}",
    }
