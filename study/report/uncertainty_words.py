"""What a page says of the uncertainty of FFR, from a document."""

from collections.abc import Mapping
from typing import Any

from study.report.headline import percent
from study.report.parameter_names import NAMES
from study.run.limits import FFR_THRESHOLD

LEAST_SHARE = 0.01
"""Share of the variance below which a cause is not shown."""


def uncertainty_words(document: Mapping[str, Any]) -> str:
    """The intervals of a run or a study in a sentence; empty where there are none."""
    entries = document.get("uncertainty", [])
    if not entries:
        return ""
    return f"With all uncertainties included: {'; '.join(interval_words(e) for e in entries)}."


def rules_words(document: Mapping[str, Any]) -> str:
    """Before the verdict by stress rules, where intervals stand beside it; else empty."""
    entries = document.get("uncertainty", [])
    if not entries:
        return ""
    entry = entries[0]
    factors = entry["rule_bed_factors"].items()
    rules = ", ".join(f"{factor:.2f} by the rule {rule}" for rule, factor in factors)
    low, high = entry["bed_factor_90"]
    bed = f"{entry['bed_factor']:.2f} [{low:.2f}, {high:.2f}] by {source_words(entry)}"
    return (
        f"Resistance of the bed under {entry['condition']} over that at rest: {rules}; {bed}."
        " By the rules, with the error of the resting ratio alone:"
    )


def source_words(entry: Mapping[str, Any]) -> str:
    """Where the response of the bed is taken from."""
    if entry["bed_factor_source"] == "the case":
        return "the case"
    return "flow reserves in the literature"


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


def causes_words(entry: Mapping[str, Any]) -> str:
    """The causes worth a word, with their shares of the variance."""
    shown = [cause for cause in entry["causes"] if cause["share"] >= 0.05]
    parts = [f"{NAMES.get(c['name'], c['name'])} {100.0 * c['share']:.0f} %" for c in shown]
    return f"of its variance, {', '.join(parts)}"


MEASURED_BY = {
    "bed_factor": "flow under stress over that at rest (flow_reserve of the condition)",
    "rest_ratio": "the resting Pd/Pa again, the wire equalised before and after",
    "stress_loss": "the lumen under stress, by ultrasound",
    "R0": "the lumen",
    "K": "the lumen",
    "P_venous": "the right atrial pressure",
}
"""What would be measured to know a number better."""

WORTH = 0.1
"""Share by which an interval must shrink for a measurement to be named."""


def help_words(entry: Mapping[str, Any]) -> list[str]:
    """What to measure, and from what to what the interval shrinks, best first."""
    low, high = entry["interval_90"]
    return [
        f"measure {MEASURED_BY[row['name']]}: FFR under"
        f" {entry['condition']} from [{low:.2f}, {high:.2f}] to"
        f" [{row['interval_if_known'][0]:.2f}, {row['interval_if_known'][1]:.2f}]"
        for row in help_rows(entry)
        if row["narrower"] >= WORTH and row["name"] in MEASURED_BY and not _measured(entry, row)
    ]


def _measured(entry: Mapping[str, Any], row: Mapping[str, Any]) -> bool:
    """Whether a cause was measured already."""
    return row["name"] == "bed_factor" and entry.get("flow_reserve") is not None


def level_words(entry: Mapping[str, Any]) -> str:
    """How many samples there are, and what corrects them."""
    found = [f"{entry['n_samples']} draws"]
    for level in entry.get("levels", []):
        found.append(f"corrected by {level['runs']} {level['of']} (error {level['error']:.4f})")
        if level.get("failed"):
            found.append(
                f"{level['failed']} more {level['of']} had none, since the lumen collapsed: low"
                " values of FFR are missing"
            )
    return ", ".join(found)


def uncertainty_rows(
    document: Mapping[str, Any],
) -> list[tuple[Mapping[str, Any], list[Mapping[str, Any]], str]]:
    """What a page shows of each condition: the entry, causes worth measuring, how it was found."""
    return [(e, help_rows(e), level_words(e)) for e in document.get("uncertainty", [])]
