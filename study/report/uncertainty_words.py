"""What a page says of the uncertainty of FFR, from a document."""

from collections.abc import Mapping, Sequence
from typing import Any

from study.report.headline import percent
from study.run.limits import FFR_THRESHOLD

LEAST_SHARE = 0.01
"""Share of the variance below which a cause is not shown."""


def uncertainty_words(entries: Sequence[Mapping[str, Any]]) -> str:
    """The intervals in a sentence; empty where there are none."""
    if not entries:
        return ""
    return f"With all that is uncertain: {'; '.join(interval_words(e) for e in entries)}."


RULES_ONLY = "With the published stress rules and no error but that of the resting ratio:"
"""Before the verdict, where intervals stand beside it."""


def interval_words(entry: Mapping[str, Any]) -> str:
    """FFR 0.86 [0.79, 0.90] under a condition, with the chance of 0.80 or below."""
    low, high = entry["interval_90"]
    chance = percent(entry["chance_at_or_below_threshold"])
    return (
        f"FFR {entry['median']:.2f} [{low:.2f}, {high:.2f}] under {entry['condition']} (90 %;"
        f" chance of {FFR_THRESHOLD:.2f} or below: {chance})"
    )


def help_rows(entry: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Causes worth measuring, those that shrink the interval most first."""
    low, high = entry["interval_90"]
    width = high - low
    rows = []
    for cause in entry["causes"]:
        if cause["share"] < LEAST_SHARE:
            continue
        a, b = cause["interval_if_known"]
        rows.append({**cause, "narrower": 1.0 - (b - a) / width if width > 0.0 else 0.0})
    return sorted(rows, key=lambda row: -row["narrower"])
