"""Rows of tables that page and terminal share, from the document of a run."""

from collections.abc import Iterator, Mapping
from typing import Any

from study.store.result_names import CALIBRATED, FIXED

Document = Mapping[str, Any]


def ratio_name(condition: str) -> str:
    """Name of the pressure ratio in a condition: `rest_ratio` or `ffr`."""
    return "rest_ratio" if condition == "rest" else "ffr"


def laws(document: Document) -> list[str]:
    """Laws with a calibration, the case's own first."""
    return [law for law, fit in document["calibrations"].items() if "alpha" in fit]


def ratio_rows(document: Document) -> Iterator[dict[str, Any]]:
    """One row a condition and rule: its runs by law and boundary."""
    settings = dict.fromkeys((run["condition"], run["rule"]) for run in document["runs"])
    for name, rule in sorted(settings, key=lambda s: list(document["conditions"]).index(s[0])):
        cells = {
            (run["law"], run["boundary"]): {**run, "ratio": run[ratio_name(name)],
                                            "sd": run[f"{ratio_name(name)}_sd"]}
            for run in document["runs"]
            if (run["condition"], run["rule"]) == (name, rule)
        }  # fmt: skip
        entry = document["conditions"][name]
        yield {
            "condition": name,
            "rule": rule,
            "first": rule is None or rule == document["rule"],
            "measured": entry.get("measured_rest_ratio", entry.get("measured_ffr")),
            "cells": [
                (boundary, cells[law, boundary])
                for law in laws(document)
                for boundary in (FIXED, CALIBRATED)
            ],
        }


def gap_rows(document: Document) -> Iterator[dict[str, Any]]:
    """Predicted less measured ratio, where stress was measured, and at rest with the fixed outlet.

    With the calibrated outlet the resting gap is zero by construction and says nothing.
    """
    for run in document["runs"]:
        if run["gap"] is None or (run["condition"] == "rest" and run["boundary"] == CALIBRATED):
            continue
        yield {**run, "ratio": run[ratio_name(run["condition"])]}
