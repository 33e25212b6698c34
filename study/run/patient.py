"""From the case of a patient to the objects of `lumped`: surrogates, conditions, stress rules."""

import dataclasses
import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import study.case.model as case_file
from calibration import LumenLosses, PressureFlowLaw, lumen_losses, systemic_windkessel
from diagnosis import RATIO_SD
from jaxfsi import Calipers, Lumen, read_ivus_contours
from jaxfsi.anatomy import radius_at_ostium, read_centerline, read_sized_line
from lumped import (
    MMHG,
    RCR,
    Coronary,
    HaemodynamicCondition,
    StressRule,
    Surrogate,
    nominal_coronary,
    sampled,
    stress_rule,
)
from lumped.device import quick_jit
from lumped.parameters import is_traced
from study.case.anatomy import IvusAnatomy
from study.case.faults import CaseError, Fault
from study.case.laws import LINEAR, QUADRATIC
from study.case.model import Case
from study.run.refusal import refusing

ASSUMED_R0 = 5.0e3
"""R0 of the linear law where nothing is known: FFR does not depend on it [dyn·s/cm⁵]."""

TANGENT_DROP = 40.0 * MMHG
"""Pressure drop at which the paper takes the slope of the ramp for R0 [dyn/cm²]."""


@dataclasses.dataclass(frozen=True)
class ContouredArtery:
    """The anomalous artery as its contours describe it.

    Attributes:
        lumen: the cross-sections.
        area: of each [cm²].
        calipers: their major and minor axes [cm].
        losses: the parts of the pressure drop over them.
    """

    lumen: Lumen
    area: Float[Array, " frames"]
    calipers: Calipers
    losses: LumenLosses


@dataclasses.dataclass(frozen=True)
class ReducedModel:
    """The surrogate of the patient under one law of the anomalous artery.

    Attributes:
        law: `linear` or `quadratic`.
        surrogate: the surrogate at α = 1.
        origin: where R0 and K come from, in words.
        assumed: whether nothing is known of R0.
    """

    law: str
    surrogate: Surrogate
    origin: str
    assumed: bool = False


@dataclasses.dataclass(frozen=True)
class Patient:
    """A case in the objects of `lumped`.

    Attributes:
        case: the case.
        vessel: the artery from contours, or None.
        models: the surrogates by law; the case's own law comes first.
        conditions: conditions by name, rest first.
        rules: stress rules by name, the case's own first.
        windkessels: aortic Windkessel by condition, where output and stroke volume are known.
    """

    case: Case
    vessel: ContouredArtery | None
    models: dict[str, ReducedModel]
    conditions: dict[str, HaemodynamicCondition]
    rules: dict[str, StressRule]
    windkessels: dict[str, RCR]

    @property
    def model(self) -> ReducedModel:
        """The surrogate under the case's own law."""
        return self.models[self.case.surrogate.law]

    @property
    def stresses(self) -> list[str]:
        """Names of the conditions under stress."""
        return [name for name in self.conditions if name != "rest"]


def load_patient(case: Case) -> Patient:
    """Read the contours of a case, if it has any, and make its surrogates and conditions.

    Raises:
        CaseError: the contours cannot be read, or no resistance is known.
    """
    vessel = read_vessel(case)
    models = {m.law: m for m in (_linear(case, vessel), _quadratic(case, vessel)) if m is not None}
    law = case.surrogate.law
    if law not in models:
        cure = 'give R0 (and K where law = "quadratic") below [surrogate], or an ivus [anatomy]'
        key = "surrogate.R0_dyn_s_per_cm5"
        raise CaseError([Fault(case.path, key, None, "no resistance is known", "", cure)])
    named = {n: case.conditions[n] for n in sorted(case.conditions, key=lambda n: n != "rest")}
    return Patient(
        case=case,
        vessel=vessel,
        models={name: models[name] for name in sorted(models, key=lambda n: n != law)},
        conditions={name: condition_of(entry) for name, entry in named.items()},
        rules=stress_rules(case),
        windkessels={
            name: systemic_windkessel(
                entry.P_systolic, entry.P_diastolic, entry.cardiac_output, entry.stroke_volume
            )
            for name, entry in named.items()
            if entry.cardiac_output is not None and entry.stroke_volume is not None
        },
    )


def read_vessel(case: Case) -> ContouredArtery | None:
    """The artery from the contours of the case; None where it has none.

    Raises:
        CaseError: the contours cannot be read as described.
    """
    anatomy = case.anatomy
    if not isinstance(anatomy, IvusAnatomy):
        return None
    try:
        lumen = read_ivus_contours(anatomy.contours, frame_table=anatomy.first.frame_table)
    except ValueError as error:
        problem = str(error).removeprefix(f"{anatomy.contours}: ")
        cure = "correct the file, or give R0_dyn_s_per_cm5 below [surrogate] without an anatomy"
        raise CaseError([Fault(anatomy.contours, "", None, problem, "", cure)]) from error
    radius = _aortic_radius(anatomy)
    upstream = math.inf if radius is None else math.pi * radius**2
    mu, rho = case.blood.mu, case.blood.rho_f
    return ContouredArtery(*_shape(lumen, mu=mu, rho=rho, area_upstream=upstream))


def _aortic_radius(anatomy: IvusAnatomy) -> float | None:
    """Radius of the aorta at the ostium [cm], from its centre line or as given; None: unknown.

    Raises:
        CaseError: a centre line cannot be read, or does not pass the ostium.
    """
    if anatomy.aorta_centerline is None or anatomy.centerline is None:
        return anatomy.aorta_radius
    with refusing(anatomy.aorta_centerline, anatomy.centerline):
        line = read_centerline(anatomy.centerline)
        end = anatomy.ostium_end or "auto"
        return radius_at_ostium(line, read_sized_line(anatomy.aorta_centerline), ostium_end=end)


@quick_jit
def _shape(lumen: Lumen, **blood: float) -> tuple[Lumen, Array, Calipers, LumenLosses]:
    return lumen, lumen.area, lumen.calipers, lumen_losses(lumen, **blood)


def ratio_error(condition: case_file.Condition) -> float:
    """Standard deviation of a measured ratio [-], assumed where it is not given.

    `RATIO_SD` is of a difference of two measurements; one has 1/√2 of it.
    """
    return condition.ffr_sd or RATIO_SD / math.sqrt(2.0)


def condition_of(entry: case_file.Condition) -> HaemodynamicCondition:
    """Pressures and period of a condition, with its measured beat where there is one."""
    waveform = None
    if entry.waveform is not None:
        beat = entry.waveform
        waveform = sampled(beat.t, jnp.asarray(beat.P_aorta), entry.period)
    return HaemodynamicCondition(
        entry.P_systolic, entry.P_diastolic, entry.period, waveform=waveform
    )


def moved_entry(
    entry: case_file.Condition, condition: HaemodynamicCondition
) -> case_file.Condition:
    """A condition of a case with the pressures and period of another; its beat goes along.

    Args:
        entry: the condition of the case.
        condition: the other one, such as `HaemodynamicCondition.moved` gives; its pressures may be
            traced.
    """
    beat, wave = entry.waveform, condition.waveform
    if beat is not None and wave is not None:
        t = np.array(beat.t) * float(condition.period / entry.period)
        P = wave(jnp.asarray(t))
        samples = tuple(P if is_traced(P) else P.tolist())
        beat = dataclasses.replace(beat, t=tuple(t.tolist()), P_aorta=samples)
    names = ("P_systolic", "P_diastolic", "period")
    numbers = {name: getattr(condition, name) for name in names}
    known = {name: x if is_traced(x) else float(x) for name, x in numbers.items()}
    return dataclasses.replace(entry, **known, waveform=beat)


def stress_rules(case: Case) -> dict[str, StressRule]:
    """Both readings of the published rule, and the factors of the case if it has any."""
    rules = {name: stress_rule(name) for name in ("printed", "all")}
    if case.stress.factors is not None:
        rules = {"factors": StressRule(**case.stress.factors), **rules}
    return {case.stress.rule: rules[case.stress.rule], **rules}


def _coronary(case: Case) -> Coronary:
    return nominal_coronary(**dataclasses.asdict(case.coronary))


def _linear(case: Case, vessel: ContouredArtery | None) -> ReducedModel | None:
    """R0 of the linear law; where the case itself asks for the quadratic one, its slope.

    Where nothing is known it is assumed, from the body where the case tells it: α tuned at rest
    goes with R0 (α/R0 is what the resting ratio fixes), and the ratio under stress stays what it
    is.
    """
    given, assumed = case.surrogate, False
    if given.R0 is not None and given.K is not None and given.law == QUADRATIC:
        R0 = PressureFlowLaw(R0=given.R0, K=given.K).tangent(TANGENT_DROP)
        origin = "R0 = slope of the given quadratic law at a drop of 40 mmHg"
    elif given.R0 is not None:
        R0, origin = given.R0, "R0 given in the case"
    elif vessel is not None:
        R0 = vessel.losses.law.tangent(TANGENT_DROP)
        origin = "R0 = slope of the lumen's pressure-flow law at a drop of 40 mmHg"
    elif given.law == LINEAR:
        usual, assumed = case.from_body.assumed.get("surrogate.R0"), True
        R0 = ASSUMED_R0 if usual is None else usual.value
        told = "assumed" if usual is None else "from the usual flow of the patient's body"
        origin = f"R0 {told}; FFR does not depend on it, alpha and flow do"
    else:
        return None
    surrogate = Surrogate(R0=R0, C0=given.C0, coronary=_coronary(case))
    return ReducedModel(LINEAR, surrogate, origin, assumed)


def _quadratic(case: Case, vessel: ContouredArtery | None) -> ReducedModel | None:
    """R0 and K of the quadratic law.

    A resistance given without K is a ramp's slope at one drop, not the resistance at zero flow; it
    is used here only where the case asks for this law.
    """
    given, asked = case.surrogate, case.surrogate.law == QUADRATIC
    law = None if vessel is None else vessel.losses.law
    a, b = (None, None) if law is None else (law.R0, law.K)
    K = b if given.K is None else given.K
    own = given.R0 is not None and (asked or given.K is not None)
    R0 = given.R0 if own else a
    if K is None or R0 is None:
        return None
    words = {True: "given in the case", False: "from the lumen's pressure-flow law"}
    given_K = given.K is not None
    origin = f"R0 and K {words[own]}" if own == given_K else f"R0 {words[own]}, K {words[given_K]}"
    return ReducedModel(
        QUADRATIC, Surrogate(R0=R0, C0=given.C0, coronary=_coronary(case), K=K), origin
    )
