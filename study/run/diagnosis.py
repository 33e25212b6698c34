"""Runs the diagnosis of one record, and the plan of its next measurement, with progress shown."""

import dataclasses
import math
import pathlib
from collections.abc import Sequence
from typing import NamedTuple

from diagnosis import CATALOGUE, Diagnosis, Record, diagnose, measured, noise_of, stacked
from diagnosis.next_measurement import isolability
from diagnosis.programs import SUFFIX
from lumped.units import MMHG
from study.case.faults import CaseError, Fault
from study.case.model import Case
from study.case.ostium import sd_log_of
from study.case.read import read_case
from study.case.record import record_path
from study.run.patient import read_vessel
from study.run.progress import Progress
from study.store.cache_folder import cache_folder
from study.store.case_inputs import input_files
from study.store.options import RecordOptions
from study.store.provenance import Provenance, origin
from study.store.result_files import STUDY_FILE
from study.store.stored_document import load_document

_STEPS = {
    "fitting the base model": (2.0, 50.0),
    "fitting every effect": (1.0, 2.0),
    "fitting further forms": (1.0, 3.0),
    "fitting pairs of effects": (1.0, 1.0),
    "looking for what is not in the catalogue": (2.0, 18.0),
    "predicting conditions that were left out": (1.0, 1.0),
    "writing the report": (2.0, 2.0),
}
"""Steps of a diagnosis and their usual seconds on 2 cores: with compiled programs, and without."""

_CONTOURS_SD_LOG = 0.3
"""Standard deviation of ln R0 from contours: twice that of a ramp in 3D, as no bend is in it."""


def usual_seconds() -> dict[str, float]:
    """Steps of a diagnosis and the seconds that each usually takes on this machine."""
    folder = cache_folder()
    compiled = folder is not None and any(folder.glob(f"*{SUFFIX}"))
    return {step: known if compiled else anew for step, (known, anew) in _STEPS.items()}


def diagnose_record(record: Record, richness: str | None, progress: Progress) -> Diagnosis:
    """Diagnose one record.

    Args:
        record: the record.
        richness: use no more than this of it, one of `diagnosis.RICHNESS`.
        progress: told of the steps.
    """
    progress.plan(usual_seconds())
    begun: set[str] = set()

    def tell(step: str, done: int, of: int) -> None:
        if step not in begun:
            begun.add(step)
            progress.step(step)

    progress.step("fitting the base model")
    begun.add("fitting the base model")
    return diagnose(stacked([measured(record, richness)]), progress=tell)[0]


class Plan(NamedTuple):
    """What a measurement could show.

    Attributes:
        diagnosis: of the record; None where it holds no data.
        isolability: expected ln B by set of sensors and effect, see
            `diagnosis.next_measurement.isolability` [-].
    """

    diagnosis: Diagnosis | None
    isolability: dict[str, dict[str, float]]


def plan_record(record: Record, progress: Progress) -> Plan:
    """What to measure next; with data after a diagnosis, else from the conditions alone.

    Args:
        record: the record.
        progress: told of the steps.
    """
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
    return Plan(diagnosis, isolability(settings, CATALOGUE, noise_of(record).pressure_sd))


def record_origin(command: Sequence[str], options: RecordOptions) -> Provenance:
    """What must be known to compute the result of a record again.

    Args:
        command: the command as it was given.
        options: of the command.
    """
    file, case = record_path(options.record), options.case
    files = [file, *sorted(file.parent.glob("*.csv"))]
    if case is not None and case.suffix != ".json" and case.is_file():
        beside = case.parent / f"{case.stem}-results" / STUDY_FILE
        files += input_files(read_case(case))
        files += [beside] if beside.is_file() else []
    elif case is not None:
        files.append(case / STUDY_FILE if case.is_dir() else case)
    return origin(list(dict.fromkeys(files)), file.parent, command, options)


def with_case(record: Record, place: pathlib.Path) -> tuple[Record, str]:
    """The record with the resistance of a patient's case or finished study, and a remark.

    Args:
        record: the record.
        place: a case file, a stored result of `jaxfsi study`, or its folder. A case that states no
            R0 is looked up in the results beside it; else its contours give R0 and K.

    Raises:
        CaseError: the file is neither, or the contours of the case cannot be read.
    """
    if place.suffix == ".json" or (place / STUDY_FILE).is_file():
        return _with_ramp(record, place)
    case = read_case(place)
    other = ""
    if case.id != record.id:
        other = f" That case is of patient {case.id}, the record of {record.id}: check both."
    if case.surrogate.R0 is not None:
        R0 = float(case.surrogate.R0)
        how = f"was taken from {case.path.name}"
        changed, remark = _changed(record, R0, how, case.surrogate.R0_sd_log)
        return changed, remark + other
    beside = _study_beside(case)
    changed, remark = _with_contours(record, case) if beside is None else _with_ramp(record, beside)
    return changed, remark + other


def study_of(place: pathlib.Path) -> pathlib.Path | None:
    """The finished study whose ramp `with_case` takes for the same place; None without.

    Raises:
        CaseError: a case file cannot be read.
    """
    if place.suffix == ".json" or (place / STUDY_FILE).is_file():
        return place
    case = read_case(place)
    return _study_beside(case) if case.surrogate.R0 is None else None


def _study_beside(case: Case) -> pathlib.Path | None:
    """Results of a study beside its case, where they are."""
    beside = case.path.parent / f"{case.path.stem}-results"
    return beside if (beside / STUDY_FILE).is_file() else None


def _with_contours(record: Record, case: Case) -> tuple[Record, str]:
    """What the contours of a case know of the ostium, ΔP = R0 Q + K Q|Q|; no study gives more."""
    vessel = read_vessel(case)
    if vessel is None:
        return record, (
            f"The case {case.path.name} states no R0 below [surrogate], has no contours, and no "
            f"finished study lies in {case.path.stem}-results; the record's own was used."
        )
    R0, K = (float(part) for part in (vessel.losses.law.R0, vessel.losses.law.K))
    known = dataclasses.replace(record, R0=R0, R0_sd_log=_CONTOURS_SD_LOG, K=max(K, 0.0))
    return known, (
        f"R0 = {R0 / MMHG:.3g} mmHg s/ml and K = {K / MMHG:.3g} mmHg s2/ml2 follow from the "
        f"contours of {case.path.name}; the ramp of a finished study would tell more."
    )


def _with_ramp(record: Record, place: pathlib.Path) -> tuple[Record, str]:
    """What the ramp ΔP = a Q + b Q|Q| + L dQ/dt knows of the ostium.

    The whole curve; where its a is not positive, the secant at the drop at rest, or where the
    record does not tell that, the tangent at 40 mmHg, which is larger than the resistance there.
    """
    document = load_document(place)
    ramp = document.get("ramp")
    if document.get("kind") != "study" or not isinstance(ramp, dict):
        cure = "give a case file, or the folder of a finished jaxfsi study"
        raise CaseError([Fault(place, "ramp", None, "no study with a ramp", "", cure)])
    a, b, tangent = (float(ramp[k]) for k in ("a", "b", "tangent_40_mmHg"))
    if a > 0.0 and b > 0.0:
        L = max(float(ramp["inertance"]), 0.0)
        known = dataclasses.replace(record, R0=a, R0_sd_log=sd_log_of(None), K=b, L=L)
        return known, (
            f"R0 = {a / MMHG:.3g} mmHg s/ml, K = {b / MMHG:.3g} mmHg s2/ml2 and "
            f"L = {L / MMHG:.3g} mmHg s2/ml are the "
            f"curve of the ramp in {place.name}."
        )
    drop = _drop_at_rest(record)
    if drop is None or drop <= 0.0:
        return _changed(
            record, tangent, f"is the tangent at 40 mmHg of the ramp in {place.name} (the record "
            "does not tell the drop at rest)"
        )  # fmt: skip
    R0 = 0.5 * (a + math.sqrt(a**2 + 4.0 * b * drop))
    return _changed(
        record, R0, f"is the secant at {drop / MMHG:.3g} mmHg, the measured drop at rest, of the "
        f"ramp in {place.name} (its tangent at 40 mmHg: {tangent / MMHG:.3g})"
    )  # fmt: skip


def _drop_at_rest(record: Record) -> float | None:
    """Mean pressure drop at rest [dyn/cm²]; None where the record does not tell."""
    for c in record.conditions:
        if c.drug != "none" or c.held_out:
            continue
        if "P_distal" in c.beats:
            return float(c.beats["P_aorta"].mean() - c.beats["P_distal"].mean())
        if c.mean_P_aorta is not None and c.mean_P_distal is not None:
            return c.mean_P_aorta - c.mean_P_distal
        if c.ffr is not None:
            return (1.0 - c.ffr) * (c.P_systolic + 2.0 * c.P_diastolic) / 3.0
    return None


def _changed(
    record: Record, R0: float, how: str, sd_log: float | None = None
) -> tuple[Record, str]:
    changed = dataclasses.replace(record, R0=R0, R0_sd_log=sd_log_of(sd_log))
    return changed, f"R0 = {R0 / MMHG:.3g} mmHg s/ml {how}."
