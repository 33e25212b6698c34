"""The case of one patient, in CGS, and what each command needs of it."""

import dataclasses
import pathlib
from collections.abc import Callable

from pydantic.dataclasses import dataclass

from study.case.anatomy import Anatomy, IvusAnatomy
from study.case.assumed import FromBody
from study.case.blood import BloodParameters
from study.case.body import BodyParameters
from study.case.condition import Condition
from study.case.faults import CaseError, Fault
from study.case.operation import Operation
from study.case.parameters import (
    CoronaryParameters,
    MeshOptions,
    SolverOptions,
    StressParameters,
    SurrogateParameters,
    WallParameters,
    WindkesselParameters,
)
from study.case.uncertainty import UncertaintyParameters


@dataclass(frozen=True)
class Case:
    """A patient, as read from a case file.

    Attributes:
        path: the file.
        id: name of the patient, fit for a file name.
        anatomy: the vessel, or None.
        wall: the vessel wall.
        conditions: conditions by name, in the order of the file.
        coronary: the coronary outlet.
        surrogate: what is known of the 0D stand-in.
        solver: numerical choices.
        source: where the values of each table come from, by table (`condition.rest`).
        blood: the blood.
        stress: how the outlet changes under stress.
        windkessel: behind the aorta.
        mesh: how the anatomy is meshed.
        uncertainty: how well the numbers are known.
        notes: remarks, by table.
        body: the body of the patient.
        from_body: what the case takes from it.
        operation: that the anatomy undergoes before anything is made of it; no key of the file.
    """

    path: pathlib.Path
    id: str
    anatomy: Anatomy | None
    wall: WallParameters
    conditions: dict[str, Condition]
    coronary: CoronaryParameters
    surrogate: SurrogateParameters
    solver: SolverOptions
    source: dict[str, str]
    blood: BloodParameters = BloodParameters()
    stress: StressParameters = StressParameters()
    windkessel: WindkesselParameters = WindkesselParameters()
    mesh: MeshOptions = MeshOptions()
    uncertainty: UncertaintyParameters = UncertaintyParameters()
    notes: dict[str, str] = dataclasses.field(default_factory=dict)
    body: BodyParameters = BodyParameters()
    from_body: FromBody = FromBody()
    operation: Operation | None = None

    @property
    def normal_bed(self) -> CoronaryParameters:
        """Bed of the normal coronary artery: in the size of the body, else that of [coronary]."""
        return dataclasses.replace(self.coronary, **(self.from_body.normal_bed or {}))

    @property
    def beds(self) -> tuple[CoronaryParameters, ...]:
        """The bed of the anomalous artery, and that of the normal one where it is another."""
        return (self.coronary, *([] if self.from_body.normal_bed is None else [self.normal_bed]))


Requirement = Callable[[Case], Fault | None]
"""Something that a command needs; gives the fault where the case lacks it."""


def _rest(case: Case) -> Fault | None:
    if "rest" in case.conditions:
        return None
    cure = "add [condition.rest] with P_systolic_mmHg, P_diastolic_mmHg and period_s"
    return Fault(case.path, "condition.rest", None, "the condition at rest is missing", "", cure)


def _rest_ffr(case: Case) -> Fault | None:
    rest = case.conditions.get("rest")
    if rest is not None and rest.ffr is not None:
        return None
    problem = "the measured resting ratio is missing; the outlet is tuned to it"
    cure = "add ffr = ... below [condition.rest]: mean distal over mean aortic pressure at rest"
    return Fault(case.path, "condition.rest.ffr", None, problem, "0 to 1, both excluded", cure)


def _resistance(case: Case) -> Fault | None:
    from_body = case.surrogate.law == "linear" and "surrogate.R0" in case.from_body.assumed
    if case.surrogate.R0 is not None or isinstance(case.anatomy, IvusAnatomy) or from_body:
        return None
    problem = "the resistance of the anomalous artery is missing; no contours to derive it from"
    cure = 'give it below [surrogate], or an [anatomy] with kind = "ivus", or a [body] and the '
    cure += "resting ratio"
    return Fault(case.path, "surrogate.R0_dyn_s_per_cm5", None, problem, "above 0", cure)


def _resistance_for_ffr(case: Case) -> Fault | None:
    """Under the linear law the ratio at rest fixes that under stress, whatever R0 is."""
    stress = any(entry.kind == "stress" for entry in case.conditions.values())
    if case.surrogate.law == "linear" and stress:
        return None
    fault = _resistance(case)
    if fault is None or case.surrogate.law != "linear":
        return fault
    cure = f"{fault.cure}; or add a condition under stress: its FFR does not depend on R0"
    return dataclasses.replace(fault, cure=cure)


def _quadratic_loss(case: Case) -> Fault | None:
    given = case.surrogate.K is not None or isinstance(case.anatomy, IvusAnatomy)
    if case.surrogate.law == "linear" or given:
        return None
    problem = 'law = "quadratic" needs the loss K; there are no contours to derive it from'
    cure = 'give K below [surrogate], or an [anatomy] with kind = "ivus", or write law = "linear"'
    return Fault(case.path, "surrogate.K_dyn_s2_per_cm8", None, problem, "0 or above", cure)


def _anatomy(case: Case) -> Fault | None:
    if case.anatomy is not None:
        return None
    cure = 'add [anatomy] with kind = "ivus", "synthetic", "surface" or "mesh"'
    return Fault(case.path, "anatomy", None, "there is nothing to mesh", "", cure)


def _contours(case: Case) -> Fault | None:
    if isinstance(case.anatomy, IvusAnatomy):
        return None
    problem = "the lumens of several states are measured by ultrasound; there are none"
    cure = 'add [anatomy] with kind = "ivus" and tables [anatomy.states.NAME]'
    return Fault(case.path, "anatomy.kind", None, problem, "ivus", cure)


def _ivus_key(key: str, name: str, why: str) -> Requirement:
    """A requirement of an ivus anatomy alone."""

    def missing(case: Case) -> Fault | None:
        if not isinstance(case.anatomy, IvusAnatomy) or getattr(case.anatomy, name) is not None:
            return None
        cure = f"add {key} = ... below [anatomy]"
        return Fault(case.path, f"anatomy.{key}", None, why, "", cure)

    return missing


def _aorta(case: Case) -> Fault | None:
    anatomy = case.anatomy
    if not isinstance(anatomy, IvusAnatomy) or anatomy.aorta_centerline is not None:
        return None
    if anatomy.aorta_radius is not None:
        return None
    cure = "add aorta_centerline = ... or aorta_radius_mm = ... below [anatomy]"
    return Fault(case.path, "anatomy.aorta_radius_mm", None, _AORTA, "", cure)


def _tissue(case: Case) -> Fault | None:
    anatomy = case.anatomy
    if not isinstance(anatomy, IvusAnatomy) or anatomy.septum is not None:
        return None
    without = [name for name, state in anatomy.states.items() if state.frame_table is None]
    if not without:
        return None
    problem = f"the tissue between aorta and coronary is not known in {', '.join(without)}"
    cure = "add frame_table = ... with the column measurement_1, or septum_mm below [anatomy]"
    return Fault(case.path, "anatomy.frame_table", None, problem, "", cure)


def _support(case: Case) -> Fault | None:
    tissue = case.wall.tissue
    if tissue.stiffness or not tissue.damping:
        return None
    problem = "tissue with damping but no stiffness has no effect in a static equilibrium"
    cure = "add stiffness_dyn_per_cm3 to [tissue], where the fit starts, or leave the table out"
    return Fault(case.path, "tissue.stiffness_dyn_per_cm3", 0.0, problem, "above 0", cure)


_LINE = "the centre line is missing; it places the contours in space"
_AORTA = "the aorta is missing; the coronary is joined to it"

REQUIREMENTS: dict[str, tuple[Requirement, ...]] = {
    "run": (_rest, _rest_ffr, _resistance_for_ffr, _quadratic_loss),
    "calibrate": (_rest, _rest_ffr, _resistance, _quadratic_loss),
    "sweep": (_rest, _resistance, _quadratic_loss),
    "mesh": (
        _anatomy,
        _ivus_key("centerline", "centerline", _LINE),
        _aorta,
        _tissue,
    ),
    "calibrate-wall": (
        _contours,
        _support,
        _ivus_key("centerline", "centerline", _LINE),
        _aorta,
        _tissue,
    ),
    "simulate": (
        _anatomy,
        _ivus_key("centerline", "centerline", _LINE),
        _aorta,
        _tissue,
    ),
    "study": (
        _rest,
        _rest_ffr,
        _anatomy,
        _ivus_key("centerline", "centerline", _LINE),
        _aorta,
        _tissue,
    ),
}
"""What each command needs; a new command adds its line."""


def require(case: Case, command: str) -> None:
    """Check that a case holds what a command needs.

    Args:
        case: the case.
        command: name of the command, one of `REQUIREMENTS`.

    Raises:
        CaseError: something is missing; everything that is missing is listed.
        ValueError: there is no such command.
    """
    if command not in REQUIREMENTS:
        known = ", ".join(REQUIREMENTS)
        raise ValueError(f"no command {command!r} has requirements of a case; try one of {known}")
    faults = [fault for needs in REQUIREMENTS[command] if (fault := needs(case)) is not None]
    if faults:
        raise CaseError(faults)
