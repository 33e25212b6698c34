"""The tables of `follow`: promises against what came, and verdicts before and after."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from diagnosis.next_measurement import READINGS

Case = dict[str, Any]

UPDATES = {"gaussian": "Gaussian sizes", "moment": "the catalogue's prior"}
"""Kinds of the Bayes update, see `readings`; a flow is followed by a diagnosis, alike in both."""

SHOWN = 3
"""Advised measurements that a report shows, and of which promises are checked."""


def follow_table(levels: dict[str, list[Case]]) -> str:
    """All tables as Markdown.

    Args:
        levels: cases of `follow.followed` by richness.
    """
    return "\n\n".join([_promises(levels), _information(levels), _verdicts(levels)])


def mean_and_error(values: Sequence[float]) -> str:
    """Mean with its standard error."""
    if not values:
        return "-"
    if len(values) == 1:
        return f"{values[0]:.2f}"
    return f"{np.mean(values):.2f} ± {np.std(values, ddof=1) / np.sqrt(len(values)):.2f}"


def _promises(levels: dict[str, list[Case]]) -> str:
    """Change of ln odds of the two hypotheses toward the true one, of all options shown."""
    lines = [
        "| record | measurement | advised (first) | its effect acts: number, promised, realised, "
        "with the catalogue's prior | its rival acts: number, promised, KL of the converse, "
        "realised, with the catalogue's prior | neither: number |",
        "|---" * 6 + "|",
    ]
    for level, cases in levels.items():
        options = [(c, o) for c in cases for o in c["advice"][:SHOWN]]
        kinds = dict.fromkeys(_kind(o) for _, o in options)
        for sensor in [*kinds, *sorted({o["sensor"] for _, o in options})]:
            own = [(c, o) for c, o in options if sensor in (o["sensor"], _kind(o))]
            lines.append(f"| {level} | {_named(sensor)} | {_promise_line(own)} |")
    return "\n".join(lines)


def _kind(option: dict[str, Any]) -> str:
    return "size" if option["sensor"] in READINGS else "flow"


def _named(sensor: str) -> str:
    return {"flow": "**all flows**", "size": "**all readings**"}.get(sensor, sensor)


def _promise_line(own: list[tuple[Case, dict[str, Any]]]) -> str:
    known = [(c, o) for c, o in own if o["sensor"] in c["outcomes"]["gaussian"]]

    def realised(acts: str, kind: str) -> str:
        sign = 1.0 if acts == "first" else -1.0
        some = [c["outcomes"][kind][o["sensor"]]["log_B"] for c, o in known if o["acts"] == acts]
        return mean_and_error([sign * v for v in some])

    def promised(acts: str, of: str) -> str:
        some = [o[of] for _, o in known if o["acts"] == acts and o[of] is not None]
        return mean_and_error(some)

    number = {w: sum(o["acts"] == w for _, o in known) for w in ("first", "second", "neither")}
    leading = sum(c["advice"][0] is o for c, o in own)
    return (
        f"{len(own)} ({leading}) | {number['first']}, {promised('first', 'promised')}, "
        f"{realised('first', 'gaussian')}, {realised('first', 'moment')} | {number['second']}, "
        f"{promised('second', 'promised')}, {promised('second', 'converse')}, "
        f"{realised('second', 'gaussian')}, {realised('second', 'moment')} | {number['neither']}"
    )


def followable(cases: list[Case]) -> list[Case]:
    """Cases whose first advice was followed."""
    return [c for c in cases if c["advice"] and _first(c) in c["outcomes"]["gaussian"]]


def _first(case: Case) -> str:
    return case["advice"][0]["sensor"]


def _most(case: Case) -> str:
    """The reading with the most expected information."""
    return max(READINGS, key=lambda sensor: case["information"][sensor])


def _others(case: Case) -> list[str]:
    return [sensor for sensor in READINGS if sensor != _first(case)]


CHOICES: dict[str, Callable[[Case], list[str]]] = {
    "the advised": lambda case: [_first(case)],
    "another reading": _others,
    "the reading of most information": lambda case: [_most(case)],
}
"""Measurements that are followed: of several the mean counts."""


def _by_first_advice(cases: list[Case]) -> dict[str, list[Case]]:
    """Cases that were followed, by what was advised in the first place."""
    some = followable(cases)
    found = {"a flow": [c for c in some if _first(c) not in READINGS],
             "a reading": [c for c in some if _first(c) in READINGS]}  # fmt: skip
    return {name: own for name, own in found.items() if own}


def _information(levels: dict[str, list[Case]]) -> str:
    """Change of ln p of the truth, by the first advice and by the controls."""
    lines = [
        "| record | advised first: cases | followed | expected of readings | realised | median | "
        "with the catalogue's prior |",
        "|---" * 7 + "|",
    ]
    for level, cases in levels.items():
        for advised, some in _by_first_advice(cases).items():
            for name, chosen in CHOICES.items():
                known = [
                    float(np.mean([c["information"][s] for s in chosen(c)]))
                    for c in some
                    if all(s in READINGS for s in chosen(c))
                ]
                plain, moment = (_gained(some, chosen, kind) for kind in UPDATES)
                lines.append(
                    f"| {level} | {advised}: {len(some)} of {len(cases)} | {name} | "
                    f"{mean_and_error(known)} | {mean_and_error(plain)} | "
                    f"{np.median(plain):.2f} | {mean_and_error(moment)} |"
                )
    return "\n".join(lines)


def _gained(cases: list[Case], chosen: Callable[[Case], list[str]], kind: str) -> list[float]:
    return [
        float(np.mean([c["outcomes"][kind][s]["information"] for s in chosen(c)])) for c in cases
    ]


def _verdicts(levels: dict[str, list[Case]]) -> str:
    lines = [
        "| record, update | advised first | followed | "
        "ambiguous, effects act: rightly, in part, wrongly named | "
        "no gap, effects act | unknown, effects act | named rightly: no longer, wrongly | "
        "nothing of the catalogue acts, unnamed: named |",
        "|---" * 8 + "|",
    ]
    for level, cases in levels.items():
        for kind, update in UPDATES.items():
            for advised, some in _by_first_advice(cases).items():
                for name, chosen in CHOICES.items():
                    found = [
                        (c, [c["outcomes"][kind][s]["standing"] for s in chosen(c)]) for c in some
                    ]
                    lines.append(f"| {level}, {update} | {advised} | {name} | {_moves(found)} |")
    return "\n".join(lines)


def _moves(found: list[tuple[Case, list[str]]]) -> str:
    """Cases by what they were, and how many became what; of several measurements the mean."""

    def of(before: str, acting: bool) -> list[list[str]]:
        kinds = ("single", "pair") if acting else ("none", "outside")
        return [a for c, a in found if c["before"] == before and c["label"]["kind"] in kinds]

    def count(some: list[list[str]], *wanted: str) -> str:
        return f"{sum(float(np.mean([s in wanted for s in after])) for after in some):.3g}"

    unnamed = ("ambiguous", "no_gap", "unknown")
    parts = []
    for before in unnamed:
        some = of(before, True)
        became = ", ".join(count(some, after) for after in ("right", "in part", "wrong"))
        parts.append(f"{len(some)}: {became}")
    right = of("right", True)
    parts.append(f"{len(right)}: {count(right, *unnamed)}, {count(right, 'in part', 'wrong')}")
    empty = [after for before in unnamed for after in of(before, False)]
    parts.append(f"{len(empty)}: {count(empty, 'right', 'in part', 'wrong')}")
    return " | ".join(parts)
