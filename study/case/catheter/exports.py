"""The files of one examination: read, their beats found, told apart into conditions and checks."""

import dataclasses
import pathlib
import re
from collections.abc import Mapping, Sequence

from study.case.catheter.beat_means import ImportedCondition, import_condition
from study.case.catheter.columns import ExportFormat, check_files
from study.case.catheter.drift import WireDrift, wire_drift
from study.case.catheter.named_files import CHECK, NamedFile, common_stem, named_files
from study.case.catheter.table import refusal
from study.case.catheter.trace import read_trace
from study.case.faults import CaseError, Fault
from study.case.recorded import PATIENT
from study.case.schema import Word

_MOST_FILES = 30


@dataclasses.dataclass(frozen=True)
class Exports:
    """What the files of one examination hold.

    Attributes:
        patient: name of the patient.
        folder: where the first file lies.
        conditions: in the order of measurement.
        checks: files with the wire beside the aortic catheter.
        drift: of the wire, where the files say anything of it.
    """

    patient: str
    folder: pathlib.Path
    conditions: tuple[ImportedCondition, ...]
    checks: tuple[ImportedCondition, ...]
    drift: WireDrift | None


def read_exports(
    given: Sequence[str],
    told: ExportFormat,
    spans: Mapping[str, tuple[float, float]],
    patient: str | None,
) -> Exports:
    """Read the files of an examination.

    Args:
        given: `FILE` or `NAME=FILE` of each condition, in the order of measurement.
        told: what the user says of the columns.
        spans: times that are used of a condition [s], by its name.
        patient: name of the patient; None: what the names of the files say.

    Raises:
        CaseError: files are at fault; the first fault of each.
    """
    files = named_files(given)
    check_files([file.path for file in files])
    if len(files) > _MOST_FILES:
        cure = "give those of one examination"
        raise refusal(files[-1].path, f"{len(files)} files are too many", cure)
    names = [file.name for file in files]
    for name in spans:
        if name not in names:
            cure = f"name one of {', '.join(names)}"
            raise refusal(
                files[0].path, "there is no such condition", cure, key="--span", value=name
            )
    (key,) = (key for key in PATIENT if key.name == "id" and isinstance(key, Word))
    if patient is not None and not re.fullmatch(key.pattern, patient):
        problem = "no usable name of a patient"
        raise refusal(files[0].path, problem, f"give {key.described}", key="--id", value=patient)
    faults: list[Fault] = []
    found: list[ImportedCondition] = []
    for file in files:
        try:
            found.append(_read(file, told, spans))
        except CaseError as error:
            faults += error.faults
    if faults:
        raise CaseError(faults)
    conditions = tuple(c for c in found if c.drug != CHECK)
    checks = tuple(c for c in found if c.drug == CHECK)
    drift = wire_drift(conditions, checks)
    name = patient or common_stem(files)
    return Exports(name, files[0].path.parent, conditions, checks, drift)


def _read(
    file: NamedFile, told: ExportFormat, spans: Mapping[str, tuple[float, float]]
) -> ImportedCondition:
    trace = read_trace(file.path, told)
    if file.name in spans:
        trace = trace.within(spans[file.name])
    return import_condition(file.name, file.drug, trace)
