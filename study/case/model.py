"""The case of one patient: what its file says, in CGS, and what each command needs of it.

A case file is TOML; `study.case.template` shows every key. All faults of a file are
reported together.
"""

import dataclasses
import os
import pathlib
from collections.abc import Callable, Mapping
from typing import Any, Literal

from study.case.anatomy import Anatomy, IvusAnatomy
from study.case.beat import Beat
from study.case.faults import CaseError, Fault
from study.case.schema import FREE_TEXT
from study.case.table_reader import Context
from study.case.tables import key_homes, read_tables
from study.case.toml_file import read_document

Number = Any
"""A float, or an array of JAX where a result is differentiated by it; cases do without JAX."""


@dataclasses.dataclass(frozen=True)
class BloodParameters:
    """Newtonian blood: viscosity `mu` [poise] and density `rho_f` [g/cm³]."""

    mu: float = 0.04
    rho_f: float = 1.06


@dataclasses.dataclass(frozen=True)
class WallParameters:
    """The vessel wall.

    Attributes:
        E: Young's modulus [dyn/cm²].
        nu: Poisson's ratio [-].
        rho_s: density [g/cm³].
        material: elastic law in 3D.
        element: elements of the wall in 3D: linear, or quadratic ones, which bend.
        prestress: whether the shape in the image carries the diastolic pressure, or no stress.
        thickness_per_radius: wall thickness over local lumen radius [-].
        thickness_min: smallest thickness [cm], if bounded.
        thickness_max: largest thickness [cm], if bounded.
    """

    E: float = 1.5e7
    nu: float = 0.49
    rho_s: float = 1.0
    material: Literal["linear", "saint_venant_kirchhoff", "neo_hookean"] = "saint_venant_kirchhoff"
    element: Literal["linear", "quadratic"] = "linear"
    prestress: Literal["diastole", "none"] = "diastole"
    thickness_per_radius: float = 0.1
    thickness_min: float | None = None
    thickness_max: float | None = None


@dataclasses.dataclass(frozen=True)
class Condition:
    """One haemodynamic condition of the patient.

    Attributes:
        name: its name in the file.
        kind: `rest` for the condition named so, `stress` for all others.
        P_systolic: systolic aortic pressure [dyn/cm²]; an array where it is differentiated.
        P_diastolic: diastolic aortic pressure [dyn/cm²].
        period: length of the cardiac cycle [s].
        cardiac_output: cardiac output [cm³/s], if known.
        stroke_volume: stroke volume [cm³], if known.
        ffr: measured ratio of the mean distal and aortic pressures [-], if known; at rest this is
            the resting Pd/Pa.
        ffr_sd: standard deviation of that ratio [-], if known.
        waveform: a measured beat of aortic pressure, if there is one.
    """

    name: str
    kind: Literal["rest", "stress"]
    P_systolic: Number
    P_diastolic: Number
    period: float
    cardiac_output: float | None = None
    stroke_volume: float | None = None
    ffr: float | None = None
    ffr_sd: float | None = None
    waveform: Beat | None = None


@dataclasses.dataclass(frozen=True)
class CoronaryParameters:
    """The five-element coronary outlet at rest, before calibration.

    Attributes:
        R_1: proximal arterial resistance [dyn·s/cm⁵].
        R_2: distal arterial resistance [dyn·s/cm⁵].
        R_3: venous resistance [dyn·s/cm⁵].
        C_a: arterial compliance [cm⁵/dyn].
        C_im: intramyocardial compliance [cm⁵/dyn].
        P_venous: venous pressure [dyn/cm²].
        im_factor: factor of the ventricular pressure that acts on `C_im` [-].
    """

    R_1: float = 3.1992e4
    R_2: float = 6.3984e4
    R_3: float = 2.666e5
    C_a: float = 4.5e-7
    C_im: float = 3.0e-6
    P_venous: float = 0.0
    im_factor: float = 1.0


@dataclasses.dataclass(frozen=True)
class SurrogateParameters:
    """The 0D stand-in for the anomalous artery, dP = R0 Q + K Q·abs(Q).

    Attributes:
        R0: linear resistance [dyn·s/cm⁵]; None where it is to come from the anatomy.
        K: quadratic loss [dyn·s²/cm⁸]; None where it is not given.
        C0: compliance [cm⁵/dyn].
        law: `linear` leaves K out.
        R0_sd_log: standard deviation of log R0 [-], if known.
    """

    R0: float | None = None
    K: float | None = None
    C0: float = 1.0e-7
    law: Literal["linear", "quadratic"] = "linear"
    R0_sd_log: float | None = None


@dataclasses.dataclass(frozen=True)
class StressParameters:
    """How the outlet changes from rest to stress: a named rule, or the user's factors.

    Attributes:
        rule: `printed` and `all` are the readings of the paper; `factors` uses `factors`.
        factors: factor of each of R_1, R_2, R_3, C_a, C_im [-]; None with a named rule.
    """

    rule: Literal["printed", "all", "factors"] = "printed"
    factors: dict[str, float] | None = None


@dataclasses.dataclass(frozen=True)
class WindkesselParameters:
    """The Windkessel behind the aorta of a 3D run.

    Attributes:
        characteristic: its resistance in series: the characteristic `impedance` of the aorta at its
            outlet, or the 10 dyn·s/cm⁵ of the `paper`.
    """

    characteristic: Literal["impedance", "paper"] = "impedance"


@dataclasses.dataclass(frozen=True)
class SolverOptions:
    """Numerical choices; None where the command's own choice is meant.

    Attributes:
        dt: time step of a 3D run [s].
        cycles: cardiac cycles of a 3D run.
        n_steps: samples of a cycle in 0D.
        frames_per_cycle: fields written in a cycle of a 3D run.
        checkpoint_every: steps between two checkpoints of a 3D run.
        tolerance: by how much the residual of a step is reduced in 3D.
        max_halvings: how often a step that fails may be halved.
        change_limit: largest change of a step; None takes steps of equal length.
    """

    dt: float | None = None
    cycles: int | None = None
    n_steps: int | None = None
    frames_per_cycle: int | None = None
    checkpoint_every: int | None = None
    tolerance: float | None = None
    max_halvings: int | None = None
    change_limit: float | None = None


@dataclasses.dataclass(frozen=True)
class MeshOptions:
    """How the anatomy is meshed and in which unit the mesh is written.

    Attributes:
        preset: fineness, about 30 000, 150 000 or 500 000 tetrahedra.
        elements_across: least number of elements across the width of the lumen, if asked for.
        wall_layers: layers of elements through the wall.
        backend: the mesher of volumes.
        unit: length unit of written meshes.
    """

    preset: Literal["coarse", "medium", "fine"] = "medium"
    elements_across: int | None = None
    wall_layers: int = 2
    backend: Literal["netgen", "gmsh", "tetgen"] = "netgen"
    unit: Literal["cm", "mm"] = "cm"


@dataclasses.dataclass(frozen=True)
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
        notes: remarks, by table.
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
    notes: dict[str, str] = dataclasses.field(default_factory=dict)


def read_case(path: str | os.PathLike[str]) -> Case:
    """Read a case file.

    Args:
        path: the TOML file.

    Returns:
        The case, in CGS.

    Raises:
        CaseError: the file cannot be read or holds faults; all of them are listed.
    """
    file = pathlib.Path(path)
    document = read_document(file)
    context = Context(file, [], {key: {} for key in FREE_TEXT}, key_homes())
    values = read_tables(document, context)
    if context.faults:
        raise CaseError(context.faults)
    return _build(file, values, context.texts)


_COUNTS = ("cycles", "n_steps", "frames_per_cycle", "checkpoint_every", "max_halvings")


def _build(file: pathlib.Path, values: Mapping[str, Any], texts: dict[str, dict[str, str]]) -> Case:
    wall, blood = values["wall"], values["blood"]
    wall = {"rho_s" if name == "density" else name: value for name, value in wall.items()}
    return Case(
        path=file,
        id=values["patient"]["id"],
        anatomy=values["anatomy"],
        wall=WallParameters(**wall),
        conditions={n: Condition(name=n, **entry) for n, entry in values["condition"].items()},
        coronary=CoronaryParameters(**values["coronary"]),
        surrogate=SurrogateParameters(**values["surrogate"]),
        solver=SolverOptions(**_whole(values["solver"], *_COUNTS)),
        source=texts["source"],
        blood=BloodParameters(mu=blood["viscosity"], rho_f=blood["density"]),
        stress=StressParameters(**values["stress"]),
        windkessel=WindkesselParameters(**values["windkessel"]),
        mesh=MeshOptions(**_whole(values["mesh"], "elements_across", "wall_layers")),
        notes=texts["notes"],
    )


def _whole(values: Mapping[str, Any], *names: str) -> dict[str, Any]:
    """Values with some of them as integers."""
    counts = {name: None if values[name] is None else int(values[name]) for name in names}
    return {**values, **counts}


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
    if case.surrogate.R0 is not None or isinstance(case.anatomy, IvusAnatomy):
        return None
    problem = "the resistance of the anomalous artery is missing, and no contours to get it from"
    cure = 'give it below [surrogate], or an [anatomy] with kind = "ivus"'
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
    problem = 'law = "quadratic" needs the loss K, and no contours to get it from'
    cure = 'give K below [surrogate], or an [anatomy] with kind = "ivus", or write law = "linear"'
    return Fault(case.path, "surrogate.K_dyn_s2_per_cm8", None, problem, "0 or above", cure)


def _anatomy(case: Case) -> Fault | None:
    if case.anatomy is not None:
        return None
    cure = 'add [anatomy] with kind = "ivus", "synthetic", "surface" or "mesh"'
    return Fault(case.path, "anatomy", None, "there is nothing to mesh", "", cure)


def _ivus_key(key: str, name: str, why: str) -> Requirement:
    """A requirement of an ivus anatomy alone."""

    def missing(case: Case) -> Fault | None:
        if not isinstance(case.anatomy, IvusAnatomy) or getattr(case.anatomy, name) is not None:
            return None
        cure = f"add {key} = ... below [anatomy]"
        return Fault(case.path, f"anatomy.{key}", None, why, "", cure)

    return missing


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


_LINE = "the centre line is missing; it places the contours in space"
_RADIUS = "the radius of the aorta is missing; the coronary is joined to it"

REQUIREMENTS: dict[str, tuple[Requirement, ...]] = {
    "run": (_rest, _rest_ffr, _resistance_for_ffr, _quadratic_loss),
    "calibrate": (_rest, _rest_ffr, _resistance, _quadratic_loss),
    "sweep": (_rest, _resistance, _quadratic_loss),
    "mesh": (
        _anatomy,
        _ivus_key("centerline", "centerline", _LINE),
        _ivus_key("aorta_radius_mm", "aorta_radius", _RADIUS),
        _tissue,
    ),
    "simulate": (
        _anatomy,
        _ivus_key("centerline", "centerline", _LINE),
        _ivus_key("aorta_radius_mm", "aorta_radius", _RADIUS),
        _tissue,
    ),
    "study": (
        _rest,
        _rest_ffr,
        _anatomy,
        _ivus_key("centerline", "centerline", _LINE),
        _ivus_key("aorta_radius_mm", "aorta_radius", _RADIUS),
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
