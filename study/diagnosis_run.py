"""Runs the diagnosis of one record, and the plan of its next measurement, with progress shown."""

import dataclasses
import pathlib
from collections.abc import Sequence

from diagnosis import CATALOGUE, Diagnosis, Record, diagnose, measured, stacked
from lumped.units import MMHG_S_PER_ML
from study.case import Case
from study.diagnosis_results import Document, plan_document
from study.progress import Progress
from study.provenance import origin
from study.record_file import record_path

CASE_SD_LOG = 0.15
"""Log-sd of a resistance that comes from a patient's own anatomy."""

STEPS = {
    "fitting the base model": 8.0,
    "fitting every effect": 20.0,
    "fitting from a second start": 1.0,
    "fitting pairs of effects": 4.0,
    "writing the report": 8.0,
}
"""Steps of a diagnosis and the seconds that they usually take, compilation included."""


def diagnose_record(record: Record, richness: str | None, progress: Progress) -> Diagnosis:
    """Diagnose one record.

    Args:
        record: the record.
        richness: use no more than this of it, one of `diagnosis.RICHNESS`.
        progress: told of the steps.
    """
    progress.plan(STEPS)
    begun: set[str] = set()

    def tell(step: str, done: int, of: int) -> None:
        if step not in begun:
            begun.add(step)
            progress.step(step)

    progress.step("fitting the base model")
    begun.add("fitting the base model")
    return diagnose(stacked([measured(record, richness)]), tell=tell)[0]


def plan_record(record: Record, progress: Progress, provenance: Document) -> Document:
    """What to measure next; with data after a diagnosis, else from the conditions alone."""
    settings = None
    diagnosis = None
    try:
        settings = measured(record)
    except ValueError:
        blank = tuple(dataclasses.replace(c, ffr=0.9, beats={}) for c in record.conditions)
        settings = measured(dataclasses.replace(record, conditions=blank))
    else:
        diagnosis = diagnose_record(record, None, progress)
    progress.step("comparing sets of sensors")
    return plan_document(record, diagnosis, settings, CATALOGUE, provenance)


def record_origin(place: pathlib.Path, command: Sequence[str]) -> Document:
    """What must be known to compute the result of a record again.

    Args:
        place: the record's file or folder.
        command: the command as it was given.
    """
    file = record_path(place)
    return origin([file, *sorted(file.parent.glob("*.csv"))], file.parent, command)


def with_case(record: Record, case: Case) -> tuple[Record, str]:
    """The record with the resistance of a patient's case, and a remark that says so."""
    if case.surrogate.R0 is None:
        return record, (
            f"The case {case.path.name} states no R0 below [surrogate]; the record's own was used."
        )
    R0 = float(case.surrogate.R0) / MMHG_S_PER_ML
    changed = dataclasses.replace(record, R0=R0, R0_sd_log=CASE_SD_LOG)
    return changed, f"R0 = {R0:.3g} mmHg s/ml was taken from {case.path.name}."
