"""A finished study, opened again: its case as its command changed it, its mesh, and its curve."""

import pathlib
from collections.abc import Mapping
from typing import Any, NamedTuple

from study.case.faults import CaseError, Fault
from study.case.model import Case
from study.case.read import read_case
from study.run.progress import Progress
from study.run.results import Run3D, calibrated_runs
from study.run.run_context import RunContext
from study.run.study_choice import StudyChoice
from study.run.study_context import check_study, open_context, with_curve
from study.run.study_options import study_case, study_choice
from study.store.case_inputs import inputs_of
from study.store.json_form import from_json
from study.store.numerics import decided_by
from study.store.options import StudyOptions, case_path
from study.store.stored_document import load_document, readable

_AGAIN = "run jaxfsi study again in the same folder: it computes what is no longer valid"


class RampCurve(NamedTuple):
    """Curve of a ramp, ΔP = a Q + b Q|Q| + L dQ/dt.

    Attributes:
        a: of the curve [dyn·s/cm⁵].
        b: of the curve [dyn·s²/cm⁸].
        L: inertance [dyn·s²/cm⁵].
    """

    a: float
    b: float
    L: float


class FinishedStudy(NamedTuple):
    """A finished study.

    Attributes:
        context: what its runs shared; the surrogate of its case is the curve of the ramp.
        ramp: that curve.
        alpha: α as calibrated in 3D [-].
        calibrated: its runs with it, rest first.
        choice: how it was made.
    """

    context: RunContext
    ramp: RampCurve
    alpha: float
    calibrated: list[Run3D]
    choice: StudyChoice


class _Stored(NamedTuple):
    """What is read of the document of a study.

    Attributes:
        ramp: curve of the ramp.
        alpha: α as calibrated [-].
        calibrated: runs with it.
        options: of its command; None where the document does not hold them.
        inputs: hash of each input file.
    """

    ramp: RampCurve
    alpha: float
    calibrated: list[Run3D]
    options: StudyOptions | None
    inputs: dict[str, str]


def finished_study(place: pathlib.Path, progress: Progress) -> FinishedStudy:
    """Open a finished study.

    Args:
        place: its folder, or its `study.json`.
        progress: told of the mesh, which is made again where the cache has lost it.

    Raises:
        CaseError: it is no study, or its case is not where its command says or was changed since.
    """
    document = study_document(place)
    stored = readable(place, document, lambda: _read(document))
    case, options = _studied(place, stored.options, stored.inputs)
    _check_numerics(place, document)
    choice = study_choice(case, options)
    check_study(case, choice)
    folder = place.parent if place.suffix == ".json" else place
    context, _ = open_context(case, folder, choice.run, progress)
    context = with_curve(context, stored.ramp.a, stored.ramp.b)
    return FinishedStudy(context, stored.ramp, stored.alpha, stored.calibrated, choice)


def studied_case(place: pathlib.Path) -> Case:
    """The case of a finished study as its command changed it; no mesh is opened.

    Args:
        place: its folder, or its `study.json`.

    Raises:
        CaseError: it is no study, or its case is not where its command says or was changed since.
    """
    document = study_document(place)
    stored = readable(place, document, lambda: _origin(document))
    return _studied(place, *stored)[0]


def _studied(
    place: pathlib.Path, options: StudyOptions | None, inputs: Mapping[str, str]
) -> tuple[Case, StudyOptions]:
    """The case of a study, unchanged since, and the options of its command."""
    if options is None:
        problem = "an earlier version of jaxfsi made it, which did not store its options"
        raise CaseError([Fault(place, "", None, problem, "", _AGAIN)])
    case = study_case(read_case(case_path(options)), options)
    _check_unchanged(case, inputs)
    return case, options


def study_document(place: pathlib.Path) -> dict[str, Any]:
    """The document of a finished study.

    Args:
        place: its folder, or its `study.json`.

    Raises:
        CaseError: it is no study, or cannot be read.
    """
    document = load_document(place)
    if document.get("kind") != "study":
        cure = "give the folder of a finished jaxfsi study"
        raise CaseError([Fault(place, "", None, "this is no study", "", cure)])
    return document


def _read(document: Mapping[str, Any]) -> _Stored:
    """Read all that is gone on from, so that damage is found here."""
    ramp = RampCurve(*(float(document["ramp"][name]) for name in ("a", "b", "inertance")))
    runs = [from_json(Run3D, run) for run in document["runs"]]
    return _Stored(
        ramp,
        float(document["loop"]["alpha"]),
        calibrated_runs(runs, str(document["loop"]["run"])),
        *_origin(document),
    )


def _origin(document: Mapping[str, Any]) -> tuple[StudyOptions | None, dict[str, str]]:
    """Options of the command, None where the document does not hold them, and hashes of inputs."""
    origin = document["provenance"]
    options = origin.get("options")
    inputs = {str(entry["file"]): str(entry["sha256"]) for entry in origin["inputs"]}
    return None if options is None else StudyOptions.read(options), inputs


def _check_numerics(place: pathlib.Path, document: Mapping[str, Any]) -> None:
    """Refuse a study whose numbers other code would not give again."""
    if document.get("numerics") != decided_by("study"):
        problem = "its numbers come from another version of the code or of its libraries"
        raise CaseError([Fault(place, "", None, problem, "", _AGAIN)])


def _check_unchanged(case: Case, then: Mapping[str, str]) -> None:
    """Refuse a case that is not the one of the study."""
    now = {f.file: f.sha256 for f in inputs_of(case)}
    changed = sorted(name for name in now.keys() | then.keys() if now.get(name) != then.get(name))
    if changed:
        problem = f"changed since the study: {', '.join(changed)}"
        cure = "run jaxfsi study again: it computes only what follows from the change"
        raise CaseError([Fault(case.path, "", None, problem, "", cure)])
