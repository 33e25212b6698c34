"""A finished study, opened again: its case as its command changed it, its mesh, and its curve."""

import argparse
import pathlib
from collections.abc import Mapping
from typing import Any, NamedTuple

from study.case.demo import demo_case_path
from study.case.faults import CaseError, Fault
from study.case.model import Case, read_case
from study.cli.arguments import parse
from study.run.algorithm import check_study, open_bench, with_curve
from study.run.progress import Progress
from study.run.run_3d import Bench
from study.run.study_options import study_case, study_choice
from study.store.numerics import decided_by
from study.store.provenance import input_files, origin
from study.store.stored_document import load_document, readable


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
    path = demo_case_path() if options.demo else options.case
    case = study_case(read_case(path), options)
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
    if not all(isinstance(word, str) for word in [*provenance["command"]]):
        raise TypeError


def _options(place: pathlib.Path, document: Mapping[str, Any]) -> argparse.Namespace:
    """Options of the command that made it."""
    command = document["provenance"]["command"]
    try:
        return parse(command[1:])
    except SystemExit as error:
        problem = f"its command is not understood any more: {' '.join(command)}"
        raise CaseError([Fault(place, "", None, problem, "", "run jaxfsi study again")]) from error


def _check_numerics(place: pathlib.Path, document: Mapping[str, Any]) -> None:
    """Refuse a study whose numbers other code would not give again."""
    if document.get("numerics") != decided_by("study"):
        problem = "its numbers come from another version of the code or of its libraries"
        cure = "run jaxfsi study again in the same folder: it computes what is no longer valid"
        raise CaseError([Fault(place, "", None, problem, "", cure)])


def _check_unchanged(case: Case, document: Mapping[str, Any]) -> None:
    """Refuse a case that is not the one of the study."""
    now = {
        f["file"]: f["sha256"] for f in origin(input_files(case), case.path.parent, ())["inputs"]
    }
    then = {f["file"]: f["sha256"] for f in document["provenance"]["inputs"]}
    changed = sorted(name for name in now.keys() | then.keys() if now.get(name) != then.get(name))
    if changed:
        problem = f"changed since the study: {', '.join(changed)}"
        cure = "run jaxfsi study again: it computes only what follows from the change"
        raise CaseError([Fault(case.path, "", None, problem, "", cure)])
