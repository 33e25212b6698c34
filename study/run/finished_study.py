"""A finished study, opened again: its case as its command changed it, its mesh, and its curve."""

import pathlib
from collections.abc import Mapping
from typing import Any, NamedTuple

from study.case.faults import CaseError, Fault
from study.case.model import Case, read_case
from study.run.algorithm import check_study, open_bench, with_curve
from study.run.progress import Progress
from study.run.run_3d import Bench
from study.run.study_options import study_case, study_choice
from study.store.numerics import decided_by
from study.store.options import StudyOptions, case_path
from study.store.provenance import inputs_of
from study.store.stored_document import load_document, readable

_AGAIN = "run jaxfsi study again in the same folder: it computes what is no longer valid"


class FinishedStudy(NamedTuple):
    """A finished study.

    Attributes:
        bench: what its runs shared; the surrogate of its case is the curve of the ramp.
        document: what it wrote.
    """

    bench: Bench
    document: Mapping[str, Any]

    @property
    def alpha(self) -> float:
        """α as calibrated in 3D [-]."""
        return float(self.document["loop"]["alpha"])


def finished_study(place: pathlib.Path, progress: Progress) -> FinishedStudy:
    """Open a finished study.

    Args:
        place: its folder, or its `study.json`.
        progress: told of the mesh, which is made again where the cache has lost it.

    Raises:
        CaseError: it is no study, or its case is not where its command says or was changed since.
    """
    document = load_document(place)
    if document.get("kind") != "study":
        cure = "give the folder of a finished jaxfsi study"
        raise CaseError([Fault(place, "", None, "this is no study", "", cure)])
    readable(place, document, lambda: _needed(document))
    options = _options(place, document)
    case = study_case(read_case(case_path(options)), options)
    _check_unchanged(case, document)
    _check_numerics(place, document)
    choice = study_choice(case, options)
    check_study(case, choice)
    folder = place.parent if place.suffix == ".json" else place
    bench, _ = open_bench(case, folder, choice.run, progress)
    ramp = document["ramp"]
    return FinishedStudy(with_curve(bench, float(ramp["a"]), float(ramp["b"])), document)


def _needed(document: Mapping[str, Any]) -> None:
    """Read all that is gone on from, so that damage is found here."""
    _ = [float(document["ramp"][name]) for name in "ab"], float(document["loop"]["alpha"])
    provenance = document["provenance"]
    _ = {entry["file"]: entry["sha256"] for entry in provenance["inputs"]}
    if provenance.get("options") is not None:
        StudyOptions.read(provenance["options"])


def _options(place: pathlib.Path, document: Mapping[str, Any]) -> StudyOptions:
    """Options of the command that made it."""
    stored = document["provenance"].get("options")
    if stored is None:
        problem = "an earlier version of jaxfsi made it, which did not store its options"
        raise CaseError([Fault(place, "", None, problem, "", _AGAIN)])
    return StudyOptions.read(stored)


def _check_numerics(place: pathlib.Path, document: Mapping[str, Any]) -> None:
    """Refuse a study whose numbers other code would not give again."""
    if document.get("numerics") != decided_by("study"):
        problem = "its numbers come from another version of the code or of its libraries"
        raise CaseError([Fault(place, "", None, problem, "", _AGAIN)])


def _check_unchanged(case: Case, document: Mapping[str, Any]) -> None:
    """Refuse a case that is not the one of the study."""
    now = {f["file"]: f["sha256"] for f in inputs_of(case)}
    then = {f["file"]: f["sha256"] for f in document["provenance"]["inputs"]}
    changed = sorted(name for name in now.keys() | then.keys() if now.get(name) != then.get(name))
    if changed:
        problem = f"changed since the study: {', '.join(changed)}"
        cure = "run jaxfsi study again: it computes only what follows from the change"
        raise CaseError([Fault(case.path, "", None, problem, "", cure)])
