"""From a case to a 3D run: mesh, boundary blocks, wall, and the state that it starts from.

| where | condition |
|---|---|
| ``aorta_inlet`` | the aortic pressure of the condition |
| ``aorta_outlet`` | Windkessel of the systemic circulation, from cardiac output and pressures |
| an anomalous outlet | five-element coronary bed, its resistances times alpha |
| every other outlet | the bed of the normal artery (`Case.normal_bed`), without alpha |

The normal artery has a bed in the size of the patient's body where the case tells the body; its
outlets share it. Without a body each has the bed of the case.

A segment, a vessel without the aorta, has the aortic pressure at its ``inlet`` and the coronary bed
times alpha behind its outlets; it needs no cardiac output. Several outlets of one artery share its
bed (`calibration.outlets`).

Under stress the rule of the case changes all blocks. In series with the Windkessel stands the
characteristic impedance of the aorta, which sends no wave back; it stays as it is under stress. A
case can have the 10 dyn·s/cm⁵ of the paper instead. With them the inertia of the blood in the aorta
and the compliance behind it swing against each other: where the pressure is given, up to 150 l/min
pass a child's aorta to and fro under dobutamine (36 with the impedance), and their velocity head
adds 13 mmHg to the mean pressure at the ostium (1 mmHg).

Each block starts from the periodic state that it has in 0D behind the aortic pressure (the
anomalous one behind the surrogate of its artery), so that no cycles are lost on filling it; the
blood starts at rest under the pressure of the inlet. The wall carries the diastolic pressure at
rest (that of the condition, where the case has no rest) in the shape of the image, against no
pressure outside, by prestress; a case can have it free of stress there instead, with that pressure
outside.

Source: Puelz et al. 2024, section 2.3.
"""

import dataclasses
import math

from calibration import alpha_closed_form, calibrate_alpha, systemic_windkessel
from calibration.outlets import (
    coronary_outlet,
    network_start,
    outlet_shares,
    periodic_start,
    share_of,
    with_impedance,
)
from jaxfsi import Mesh, Region, submesh
from jaxfsi.core.step.state import initial_state
from jaxfsi.opening import OUTLET, inlet_name, is_anomalous, is_segment, opening_area
from lumped import (
    RCR,
    AbstractElement,
    AorticPressure,
    Coronary,
    StressRule,
    Surrogate,
    VentricularPressure,
)
from lumped.parameters import Parameter
from lumped.waveforms import AbstractWaveform
from study.case.anatomy import IvusAnatomy, SurfaceAnatomy, SyntheticAnatomy
from study.case.condition import Condition
from study.case.faults import CaseError, Fault
from study.case.model import Case
from study.run.case_model import Keep, case_model
from study.run.opening_checks import names_segment
from study.run.patient import Patient, condition_of, load_patient, stress_rules
from study.run.simulation_data import Outlets, Schedule, Setup

STEP = 1.0e-3
"""Length of a step where the case says nothing [s]."""

CYCLES = 4
"""Cycles where the case says nothing, as in the paper."""

_Beds = dict[str, tuple[Coronary, Parameter]]
"""By coronary outlet: the bed of its artery, and the outlet's share of it."""

LARGEST_NU = 0.499
"""Poisson's ratio beyond which the displacement-based wall has no finite stiffness."""


def check_simulation(case: Case, condition: str, *, rigid: bool, dt: float | None) -> None:
    """Refuse a case that a run in 3D cannot use; all faults are listed.

    Raises:
        CaseError: what is missing or out of range.
    """
    faults: list[Fault] = []
    if condition not in case.conditions:
        cure = "name one of these with --condition"
        if not case.conditions:
            cure = f"add [condition.{condition}] with aortic pressures and period"
        problem, known = f"there is no condition {condition!r} to run", ", ".join(case.conditions)
        faults.append(Fault(case.path, "condition", None, problem, known, cure))
    else:
        entry = case.conditions[condition]
        if _output(case, condition) is None and not names_segment(case):
            problem = "the cardiac output is missing; the Windkessel of the aorta follows from it"
            cure = "add cardiac_output_l_per_min below [condition.rest]"
            key = f"condition.{condition}.cardiac_output_l_per_min"
            faults.append(Fault(case.path, key, None, problem, "0.15 to 40 l/min", cure))
        step = dt or case.solver.dt or STEP
        if step > entry.period / 20.0:
            problem = f"a step of {step:g} s is more than a twentieth of the cycle"
            key = "solver.dt_s"
            allowed = (
                f"at most {entry.period / 20.0:g} s; about {entry.period / 800.0:.1g} s is usual"
            )
            faults.append(Fault(case.path, key, step, problem, allowed, "take a smaller step"))
    if not rigid and case.wall.nu > LARGEST_NU:
        problem = "a wall that cannot change its volume has no finite stiffness in this formulation"
        faults.append(
            Fault(
                case.path, "wall.nu", case.wall.nu, problem, f"at most {LARGEST_NU}", "write 0.49"
            )
        )
    if not rigid:
        faults += _without_axis(case)
    if faults:
        raise CaseError(faults)


def _without_axis(case: Case) -> list[Fault]:
    """Moduli of parts of the wall that cannot be told apart."""
    if isinstance(case.anatomy, IvusAnatomy | SurfaceAnatomy | SyntheticAnatomy):
        return []
    given = {name: getattr(case.wall, name) for name in ("E_coronary", "E_septum")}
    problem = "only an anatomy with an axis of the anomalous artery says where this part lies"
    kinds, cure = "kind ivus, synthetic or surface", "leave it out, or give such an anatomy"
    return [
        Fault(case.path, f"wall.{name}_dyn_per_cm2", value, problem, kinds, cure)
        for name, value in given.items()
        if value is not None
    ]


def plan_steps(
    case: Case, condition: str, *, dt: float | None = None, cycles: float | None = None
) -> Schedule:
    """Steps of a run: a cycle has a whole number of frames, a frame a whole number of steps."""
    period = case.conditions[condition].period
    frames = case.solver.frames_per_cycle
    wanted = dt or case.solver.dt or STEP
    frames = min(frames, math.ceil(period / wanted))
    per_frame = max(1, math.ceil(period / frames / wanted - 1e-9))
    per_cycle = per_frame * frames
    n_cycles = cycles or case.solver.cycles or CYCLES
    n_steps = max(1, round(n_cycles * per_cycle))
    return Schedule(period / per_cycle, n_steps, per_cycle, per_frame, period)


def prepare_simulation(
    case: Case,
    mesh: Mesh,
    condition: str,
    schedule: Schedule,
    *,
    rigid: bool = False,
    alpha: float | None = None,
    keep: Keep | None = None,
) -> Setup:
    """Put model and start of a run together.

    Args:
        case: a case that passed `check_simulation`.
        mesh: its mesh, that passed `check_openings`.
        condition: name of the condition.
        schedule: see `plan_steps`.
        rigid: leave the wall out.
        alpha: scale of the anomalous outlet; None: as calibrated, 1 where that is not possible.
        keep: see `case_model`.

    Raises:
        CaseError: the case cannot be calibrated.
        RuntimeError: a periodic state or the prestress was not found.
    """
    if rigid:
        mesh = submesh(mesh, Region.FLUID).mesh
    entry = case.conditions[condition]
    inlet = aortic_pressure(entry)
    rule = None if entry.kind == "rest" else stress_rules(case)[case.stress.rule]
    outlets = outlets_of(case, condition, mesh, alpha, rule)
    ports = outlets.ports(inlet, mesh.openings)
    model = case_model(case, mesh, ports, image_pressure(case, condition), rigid=rigid, keep=keep)
    state = initial_state(model, p=inlet(0.0), blocks=outlets.starts_of(model.names))
    return Setup(mesh, model, state, inlet, outlets, schedule)


def image_pressure(case: Case, condition: str) -> float:
    """Pressure of the blood in the image: diastolic at rest, where the case has one [dyn/cm²]."""
    return float(case.conditions.get("rest", case.conditions[condition]).P_diastolic)


def aortic_pressure(entry: Condition) -> AbstractWaveform:
    """The beat of aortic pressure of a condition."""
    known = condition_of(entry)
    if known.waveform is not None:
        return known.waveform
    return AorticPressure(entry.P_systolic, entry.P_diastolic, entry.period)


def _output(case: Case, condition: str) -> Condition | None:
    """The condition whose cardiac output sets the Windkessel: itself, else rest."""
    for name in (condition, "rest"):
        entry = case.conditions.get(name)
        if entry is not None and entry.cardiac_output is not None:
            return entry
    return None


def outlets_of(
    case: Case,
    condition: str,
    mesh: Mesh,
    alpha: Parameter | None,
    rule: StressRule | None,
) -> Outlets:
    """What lies behind the outlets; the pressures of the condition, α and rule may be traced.

    Args:
        case: the case.
        condition: name of the condition.
        mesh: the mesh, for its openings.
        alpha: scale of the anomalous outlet; None: as calibrated, 1 where that is not possible.
        rule: stress rule; None at rest.

    Raises:
        CaseError: the case cannot be calibrated.
        RuntimeError: a periodic state was not found.
    """
    entry = case.conditions[condition]
    inlet = aortic_pressure(entry)
    patient = _patient(case)
    alpha, origin = _alpha(patient, alpha)
    own = None if patient is None else patient.model.surrogate
    beds = _beds(case, condition, mesh, alpha, rule)
    blocks = _blocks(case, condition, mesh, rule, beds)
    starts = {}
    for name, block in blocks.items():
        if own is not None and name in _scaled(mesh):
            bed, _ = beds[name]  # the states are pressures: alike in every share
            before = Surrogate(R0=own.R0, K=own.K, C0=case.surrogate.C0, coronary=bed)
            network = before.network(condition_of(entry), inlet=inlet)
            starts[name] = network_start(network, entry.period)
        else:
            whole = beds[name][0] if name in beds else block
            starts[name] = periodic_start(inlet, entry.period, whole)
    return Outlets(alpha, origin, blocks, starts)


def outlet_blocks(
    case: Case, condition: str, mesh: Mesh, alpha: Parameter, rule: StressRule | None
) -> dict[str, AbstractElement]:
    """The block of each port but the inlet; arguments as in `outlets_of`, but for a known α."""
    return _blocks(case, condition, mesh, rule, _beds(case, condition, mesh, alpha, rule))


def _blocks(
    case: Case, condition: str, mesh: Mesh, rule: StressRule | None, beds: _Beds
) -> dict[str, AbstractElement]:
    blocks: dict[str, AbstractElement] = {}
    if not is_segment(mesh.openings):
        blocks[OUTLET] = _windkessel(case, condition, rule, opening_area(mesh, OUTLET))
    return blocks | {name: share_of(bed, share) for name, (bed, share) in beds.items()}


def _scaled(mesh: Mesh) -> list[str]:
    """Outlets of the anomalous artery; all of a segment."""
    segment = is_segment(mesh.openings)
    return [name for name in _coronary_outlets(mesh) if segment or is_anomalous(name)]


def _coronary_outlets(mesh: Mesh) -> list[str]:
    return [n for n in mesh.openings if n not in (inlet_name(mesh.openings), OUTLET)]


def _beds(
    case: Case, condition: str, mesh: Mesh, alpha: Parameter, rule: StressRule | None
) -> _Beds:
    entry, others, scaled = case.conditions[condition], _coronary_outlets(mesh), _scaled(mesh)
    shares = outlet_shares({name: opening_area(mesh, name) for name in scaled})
    whole = [] if case.from_body.normal_bed is None else [n for n in others if n not in shares]
    normal_shares = outlet_shares({name: opening_area(mesh, name) for name in whole})
    ventricle = VentricularPressure(entry.P_systolic, entry.period)
    plain = Coronary(P_im=ventricle, **dataclasses.asdict(case.coronary))
    normal = Coronary(P_im=ventricle, **dataclasses.asdict(case.normal_bed))
    beds: _Beds = {}
    for name in others:
        scale, own = (alpha, plain) if name in shares else (1.0, normal)
        share = shares.get(name, normal_shares.get(name, 1.0))
        beds[name] = coronary_outlet(own, ventricle, scale, rule), share
    return beds


def _patient(case: Case) -> Patient | None:
    """The surrogates of the case; None where it gives no resistance."""
    try:
        return load_patient(case)
    except CaseError:
        return None


def _alpha(patient: Patient | None, given: Parameter | None) -> tuple[Parameter, str]:
    if given is not None:
        return given, "given"
    rest = None if patient is None else patient.case.conditions.get("rest")
    if patient is None or rest is None or rest.ffr is None:
        return 1.0, "nominal: the case has no resting ratio or no resistance to calibrate with"
    surrogate = patient.model.surrogate
    condition = patient.conditions["rest"]
    try:
        if surrogate.K is None:
            found = alpha_closed_form(surrogate, condition, rest.ffr)
        else:
            found = calibrate_alpha(surrogate, condition, rest.ffr).alpha
    except ValueError as error:
        problem = f"cannot be reached by the {patient.model.law} law: {error}"
        cure = "check ffr, or give --alpha"
        fault = Fault(patient.case.path, "condition.rest.ffr", rest.ffr, problem, "", cure)
        raise CaseError([fault]) from error
    return float(found), f"calibrated at rest with the {patient.model.law} surrogate"


def _windkessel(case: Case, condition: str, rule: StressRule | None, area: float) -> RCR:
    entry = _output(case, condition)
    assert entry is not None, "checked by check_simulation"
    assert entry.cardiac_output is not None
    volume = entry.stroke_volume or entry.cardiac_output * entry.period
    block = systemic_windkessel(entry.P_systolic, entry.P_diastolic, entry.cardiac_output, volume)
    stressed = block if rule is None or entry.name == condition else rule(block)
    if case.windkessel.characteristic == "paper":
        return stressed
    wall = case.wall
    return with_impedance(
        stressed, area, case.blood.rho_f, wall.E, wall.nu, wall.thickness_per_radius
    )
