"""All that a study found, as a plain class."""

import dataclasses
import pathlib

from calibration import LoopFit
from jaxfsi import Mesh
from jaxfsi.anatomy import Anatomy
from study.case.model import Case
from study.run.fitted_ramp import FittedRamp
from study.run.reduced_results import CaseResult, Intervals
from study.run.results import Run3D, calibrated_runs
from study.run.study_choice import StudyChoice
from study.run.study_parts import Computed, MeshErrorPart, MotionPart, Sensitivity


@dataclasses.dataclass(frozen=True)
class StudyResult:
    """All that a study found.

    Attributes:
        case: the case; its surrogate is the curve of the ramp.
        mesh: its mesh.
        anatomy: the anatomy; None where the case names a finished mesh.
        folder: where stages and runs are kept.
        choice: how it was made.
        ramp: the ramp and its curve.
        reduced: everything in 0D with that curve.
        loop: the calibration in 3D.
        rest: id of the run at rest that it chose.
        runs: the 3D runs, those at rest first, in order.
        motion: lumen and wall over a cycle, by id of the run.
        sensitivities: what moves the ratio of a run, by id of the run.
        failures: why a run has none, by the same.
        collapsed: when and where the lumen collapsed, by id of the run under stress that it ended.
        computed: when each part was computed, and by which code.
        mesh_error: what a second mesh says of the ramp, or why it says nothing; None: not asked
            for.
        uncertainty: FFR in 3D with its interval, of each condition under stress that has a run;
            None: not asked for.
    """

    case: Case
    mesh: Mesh
    anatomy: Anatomy | None
    folder: pathlib.Path
    choice: StudyChoice
    ramp: FittedRamp
    reduced: CaseResult
    loop: LoopFit
    rest: str
    runs: list[Run3D]
    motion: dict[str, MotionPart]
    sensitivities: dict[str, Sensitivity]
    failures: dict[str, str]
    collapsed: dict[str, str]
    computed: Computed
    mesh_error: MeshErrorPart | str | None = None
    uncertainty: Intervals | None = None

    @property
    def calibrated(self) -> list[Run3D]:
        """Runs with α as calibrated, rest first."""
        return calibrated_runs(self.runs, self.rest)
