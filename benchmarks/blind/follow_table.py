"""The tables of `follow`: promises against what came, and verdicts before and after."""

from collections.abc import Callable
from typing import Any

import numpy as np

from diagnosis.next_measurement import READINGS

Case = dict[str, Any]

UPDATES = {"gaussian": "Gaussian sizes", "moment": "the catalogue's prior"}
"""Kinds of the Bayes update, see `readings`."""


def follow_table(levels: dict[str, list[Case]]) -> str:
    """All tables as Markdown.

    Args:
        levels: cases of `follow.followed` by richness.
    """
    return "\n\n".join([_promises(levels), _verdicts(levels), _by_sensor(levels)])


def _advised(cases: list[Case]) -> list[Case]:
    return [case for case in cases if case["advice"]]


def _first(case: Case) -> str:
    return case["advice"][0][0]


def _most(case: Case) -> str:
    """The reading with the most expected information."""
    return max(READINGS, key=lambda sensor: case["information"][sensor])


def _others(case: Case, kind: str) -> list[dict[str, Any]]:
    return [one for sensor, one in case["outcomes"][kind].items() if sensor != _first(case)]


def _mean(values: list[float]) -> str:
    """Mean with its standard error."""
    if not values:
        return "-"
    spread = np.std(values, ddof=1) / np.sqrt(len(values)) if len(values) > 1 else np.nan
    error = f" ± {spread:.1f}" if np.isfinite(spread) else ""
    return f"{np.mean(values):.1f}{error}"


def _promises(levels: dict[str, list[Case]]) -> str:
    lines = [
        "| record, update | advised | its effect acts: cases, promised, realised | "
        "its rival acts: cases, promised, expected, realised | neither acts | "
        "ln p(truth): expected, realised, median | another sensor |",
        "|---" * 7 + "|",
    ]
    for level, cases in levels.items():
        some = _advised(cases)
        for kind, update in UPDATES.items():
            by = {w: [c for c in some if c["acts"] == w] for w in ("first", "second", "neither")}
            first = [_outcome(c, kind)["log_B"] for c in by["first"]]
            second = [-_outcome(c, kind)["log_B"] for c in by["second"]]
            gains = [_outcome(c, kind)["information"] for c in some]
            read = [c for c in some if _first(c) in READINGS]
            other = [float(np.mean([o["information"] for o in _others(c, kind)])) for c in some]
            converse = [c["converse"] for c in by["second"] if c["converse"] is not None]
            median = f"{np.median(gains):.2f}" if gains else "-"
            lines.append(
                f"| {level}, {update} | {len(some)} of {len(cases)}{_left_out(cases)} | {len(first)}, "
                f"{_mean([c['advice'][0][2] for c in by['first']])}, {_mean(first)} | "
                f"{len(second)}, {_mean([c['advice'][0][2] for c in by['second']])}, "
                f"{_mean(converse)}, {_mean(second)} | {len(by['neither'])} | "
                f"{_mean([c['information'][_first(c)] for c in read])}, {_mean(gains)}, {median} | "
                f"{_mean(other)} |"
            )
    return "\n".join(lines)


def _left_out(cases: list[Case]) -> str:
    """How often something was advised that cannot be followed."""
    number = sum(case["left_out"] > 0 for case in cases)
    return f", {number} not followed" if number else ""


def _outcome(case: Case, kind: str) -> dict[str, Any]:
    return case["outcomes"][kind][_first(case)]


def _verdicts(levels: dict[str, list[Case]]) -> str:
    lines = [
        "| record, update | measured | unnamed, though effects act: rightly, one of two, wrongly | "
        "named rightly: no longer, wrongly | nothing known acts, unnamed: named |",
        "|---" * 5 + "|",
    ]
    chosen: dict[str, Callable[[Case, str], list[str]]] = {
        "the advised": lambda c, kind: [_outcome(c, kind)["standing"]],
        "another": lambda c, kind: [o["standing"] for o in _others(c, kind)],
        "most information": lambda c, kind: [c["outcomes"][kind][_most(c)]["standing"]],
    }
    for level, cases in levels.items():
        some = _advised(cases)
        for kind, update in UPDATES.items():
            for name, after in chosen.items():
                found = [(c, after(c, kind)) for c in some]
                lines.append(f"| {level}, {update} | {name} | {_moves(found)} |")
    return "\n".join(lines)


def _moves(found: list[tuple[Case, list[str]]]) -> str:
    """Cases by what they were and became; of several sensors the mean number."""
    open_ones, right, empty = [], [], []
    for case, after in found:
        if case["before"] == "right":
            right.append(after)
        elif case["before"] not in ("in part", "wrong"):
            acting = case["label"]["kind"] in ("single", "pair")
            (open_ones if acting else empty).append(after)

    def count(some: list[list[str]], *wanted: str) -> str:
        number = sum(float(np.mean([s in wanted for s in after])) for after in some)
        return f"{number:.3g}"

    named = ("right", "in part", "wrong")
    lost = ("ambiguous", "no_gap", "unknown")
    return (
        f"{len(open_ones)}: {count(open_ones, 'right')}, {count(open_ones, 'in part')}, "
        f"{count(open_ones, 'wrong')} | {len(right)}: {count(right, *lost)}, "
        f"{count(right, 'in part', 'wrong')} | {len(empty)}: {count(empty, *named)}"
    )


def _by_sensor(levels: dict[str, list[Case]]) -> str:
    lines = [
        "| record | advised | cases | its effect acts | promised | its effect acts: realised | "
        "ln p(truth): expected, realised |",
        "|---" * 7 + "|",
    ]
    for level, cases in levels.items():
        some = _advised(cases)
        for sensor in dict.fromkeys(sorted(_first(c) for c in some)):
            own = [c for c in some if _first(c) == sensor]
            acts = [c for c in own if c["acts"] == "first"]
            known = [c["information"][sensor] for c in own if sensor in c["information"]]
            lines.append(
                f"| {level} | {sensor} | {len(own)} | {len(acts)} | "
                f"{_mean([c['advice'][0][2] for c in own])} | "
                f"{_mean([_outcome(c, 'gaussian')['log_B'] for c in acts])} | "
                f"{_mean(known)}, {_mean([_outcome(c, 'gaussian')['information'] for c in own])} |"
            )
    return "\n".join(lines)
