"""Forms of the effects in svZeroDSolver's blocks.

What the blocks do not have comes from iterating on whole beats: a resistance that follows the
aortic pressure (`narrow_...`) and a bed that follows its mean perfusion pressure (`gain`). Sensors
are not svZeroDSolver's matter: their forms are those of `sensing`.
"""

from collections.abc import Callable

import numpy as np

from benchmarks.foreign import outside, sensing
from benchmarks.foreign.form import EffectForm, either, log_uniform, pick, times
from benchmarks.foreign.patient import ForeignCondition, Parameters
from benchmarks.foreign.waves import bump, from_profile
from benchmarks.foreign.zerod_blocks import heart_beat

Change = Callable[[Parameters, ForeignCondition], Parameters]


def _form(effect: str, form: str, size: dict, place: str, change: Change, **how) -> EffectForm:
    return EffectForm(effect, form, size, place, parameters=change, **how)


def quadratic_loss(rng: np.random.Generator) -> EffectForm:
    """The stenosis coefficient of the vessel, alone or with its inertance and some friction."""
    form = pick(rng, "stenosis", "stenosis_and_inertance")
    K = log_uniform(rng, 0.08, 4.0)
    L = float(rng.uniform(0.005, 0.03)) * (form != "stenosis")
    more = 1.0 + 0.1 * (form != "stenosis")

    def change(p, condition):
        return {**p, "K": K, "L": p["L"] + L, "R_0": p["R_0"] * more}

    return _form("quadratic_loss", form, {"mmHg_s2_per_ml2": K}, "ostium", change)


def dynamic_narrowing(rng: np.random.Generator) -> EffectForm:
    """A resistance that rises with the aortic pressure, in a straight line or a power of it."""
    form = pick(rng, "line", "power")
    size = {"most": 1.0 + log_uniform(rng, 0.08, 3.0), "from_mmHg": float(rng.uniform(55.0, 80.0))}
    size["power"] = 1.0 if form == "line" else float(rng.uniform(1.5, 3.0))

    def change(p, condition):
        return {**p, **{f"narrow_{key}": value for key, value in size.items()}}

    return _form("dynamic_narrowing", form, size, "ostium", change)


def proximal_resistance(rng: np.random.Generator) -> EffectForm:
    """Another Poiseuille resistance."""
    factor = either(rng, 1.2, 4.0)

    def change(p, condition):
        return times(R_0=factor)(p)

    return _form("proximal_resistance", "factor", {"factor": factor}, "ostium", change)


def stress_narrowing(rng: np.random.Generator) -> EffectForm:
    """Under stress a narrower vessel: friction alone, or friction and separation."""
    form = pick(rng, "friction", "friction_and_separation")
    factor = log_uniform(rng, 1.1, 3.5)

    def change(p, condition):
        if not condition.stressed:
            return p
        K = 0.3 * (factor - 1.0) * (form != "friction")
        return {**p, "R_0": p["R_0"] * factor, "K": K}

    return _form("stress_narrowing", form, {"factor": factor}, "ostium", change)


def inertance(rng: np.random.Generator) -> EffectForm:
    """The inertance of the vessel."""
    L = log_uniform(rng, 0.005, 0.4)

    def change(p, condition):
        return {**p, "L": L}

    return _form("inertance", "vessel", {"mmHg_s2_per_ml": L}, "ostium", change)


def _dilation(effect: str, rng: np.random.Generator, drugs: tuple[str, ...]) -> EffectForm:
    form = pick(rng, "micro", "arteries_too")
    factor = log_uniform(rng, 0.15, 0.9) if rng.random() < 0.7 else log_uniform(rng, 1.1, 3.5)

    def change(p, condition):
        if condition.drug not in drugs:
            return p
        return times(R_2=factor, R_1=factor if form == "arteries_too" else 1.0)(p)

    return _form(effect, form, {"factor": factor}, "microvasculature", change)


def vasodilation(rng: np.random.Generator) -> EffectForm:
    """Micro resistance under any drug."""
    return _dilation("vasodilation", rng, ("adenosine", "dobutamine"))


def adenosine_vasodilation(rng: np.random.Generator) -> EffectForm:
    """Micro resistance under adenosine."""
    return _dilation("adenosine_vasodilation", rng, ("adenosine",))


def r1_r3_dilation(rng: np.random.Generator) -> EffectForm:
    """Arterial and venous resistances under any drug, by one factor or by two."""
    first = float(rng.uniform(0.3, 0.95))
    form = pick(rng, "one_factor", "two_factors")
    last = first if form == "one_factor" else float(rng.uniform(0.4, 0.9))

    def change(p, condition):
        return times(R_1=first, R_3=last)(p) if condition.stressed else p

    size = {"R_1_factor": first, "R_3_factor": last}
    return _form("r1_r3_dilation", form, size, "microvasculature", change)


def autoregulation(rng: np.random.Generator) -> EffectForm:
    """The bed follows the mean distal pressure by a power."""
    gain, usual = float(rng.uniform(0.1, 1.2)), float(rng.uniform(75.0, 95.0))
    form = pick(rng, "micro", "arteries_too")

    def change(p, condition):
        return {**p, "gain": gain, "usual": usual, "gain_arteries": float(form != "micro")}

    size = {"gain": gain, "usual_mmHg": usual}
    return _form("autoregulation", form, size, "microvasculature", change)


def stress_compliance(rng: np.random.Generator) -> EffectForm:
    """Compliances under stress."""
    factor, form = either(rng, 1.1, 4.0), pick(rng, "both", "muscle")

    def change(p, condition):
        first = factor if form == "both" else 1.0
        return times(C_a=first, C_im=factor)(p) if condition.stressed else p

    return _form("stress_compliance", form, {"factor": factor}, "microvasculature", change)


def back_pressure(rng: np.random.Generator) -> EffectForm:
    """A venous pressure behind the bed, or behind a deep layer of it alone."""
    P, form = float(rng.uniform(3.0, 32.0)), pick(rng, "venous", "deep_layer")

    def change(p, condition):
        return {**p, "P_v": P} if form == "venous" else {**p, "deep_P_v": 1.5 * P, "P_v": 0.3 * P}

    return _form("back_pressure", form, {"mmHg": P}, "microvasculature", change)


def collateral_flow(rng: np.random.Generator) -> EffectForm:
    """A vessel from the aorta or a steady source, to the sensor's node or behind R_1."""
    form = pick(rng, "aorta_to_distal", "aorta_to_artery", "steady_to_artery")
    share, P = log_uniform(rng, 0.08, 0.7), float(rng.uniform(75.0, 100.0))

    def change(p, condition):
        found = {**p, "collateral_R": (p["R_1"] + p["R_2"] + p["R_3"]) / share}
        found["collateral_P"] = P if form.startswith("steady") else 0.0
        found["at_artery"] = float(form.endswith("artery"))
        return found

    return _form("collateral_flow", form, {"share_of_bed": share}, "microvasculature", change)


def intramyocardial_pump(rng: np.random.Generator) -> EffectForm:
    """A squeeze of another strength, or one that also raises the micro resistance in systole."""
    factor, form = either(rng, 1.05, 2.0), pick(rng, "factor", "factor", "resistance_too")
    most = max(factor, 1.0) ** 1.5

    def change(p, condition):
        found = {**p, "squeeze": p["squeeze"] * factor}
        if form == "resistance_too":
            found |= {"R_2_most": most, "contraction": 0.2, "relaxation": 0.2}
        return found

    return _form("intramyocardial_pump", form, {"factor": factor}, "pump", change)


def dobutamine_inotropy(rng: np.random.Generator) -> EffectForm:
    """A stronger squeeze under dobutamine, alike or with the dose."""
    factor, form = log_uniform(rng, 1.04, 1.8), pick(rng, "factor", "with_dose")

    def change(p, condition):
        if condition.drug != "dobutamine":
            return p
        power = condition.dose if form == "with_dose" else 1.0
        return {**p, "squeeze": p["squeeze"] * factor**power}

    return _form("dobutamine_inotropy", form, {"factor": factor}, "pump", change)


def wall_viscoelasticity(rng: np.random.Generator) -> EffectForm:
    """A part of the arterial compliance behind a resistance: all of it, or some."""
    form = pick(rng, "voigt", "standard_solid")
    lag = log_uniform(rng, 0.004, 0.15)
    share = 0.98 if form == "voigt" else float(rng.uniform(0.3, 0.7))

    def change(p, condition):
        late = p["C_a"] * share
        found = {**p, "C_a": p["C_a"] - late, "late_C": late, "late_R": lag / late}
        return {**found, "at_artery": 1.0}

    size = {"lag_s": lag, "late_share": share}
    return _form("wall_viscoelasticity", form, size, "wall", change)


def aortic_waveform(rng: np.random.Generator) -> EffectForm:
    """The aortic pressure of a beating heart with valves, mixed with the assumed one."""
    beat = heart_beat(rng)
    rise = np.roll(beat, -int(np.argmin(beat)))
    lead = int(rng.integers(8, 20))
    family = from_profile(np.roll(rise, lead) if rise[-lead] < rise.mean() else rise)
    share = log_uniform(rng, 0.02, 0.8)

    def inlet(phase, P, high, low, condition):
        mixed = (1.0 - share) * P + share * family(phase, high, low, low)
        return low + (mixed - low) * (high - low) / float((mixed - low).max())

    return EffectForm("aortic_waveform", "heart", {"share": share}, "inlet", inlet=inlet)


def fistula(rng: np.random.Generator) -> EffectForm:
    """A fistula from the node of the sensor into a low pressure."""
    share = float(rng.uniform(0.1, 0.6))

    def change(p, condition):
        return {**p, "fistula_R": (p["R_1"] + p["R_2"] + p["R_3"]) / share}

    return _form("outside:fistula", "fistula", {"share_of_bed": share}, "artery", change)


def distal_stenosis(rng: np.random.Generator) -> EffectForm:
    """A stenosis coefficient behind the sensor."""
    K = float(rng.uniform(0.8, 4.0))

    def change(p, condition):
        return {**p, "K_beyond": K}

    size = {"mmHg_s2_per_ml2": K}
    return _form("outside:distal_stenosis", "distal_stenosis", size, "artery", change)


def bridge(rng: np.random.Generator) -> EffectForm:
    """A bridge: the resistance in the muscle rises in systole."""
    most = float(rng.uniform(2.0, 8.0))

    def change(p, condition):
        return {**p, "R_2_most": most, "contraction": 0.22, "relaxation": 0.25}

    return _form("outside:bridge", "bridge", {"times": most}, "artery", change)


def atrial_kick(rng: np.random.Generator) -> EffectForm:
    """The ventricle's filling presses on the bed in late diastole."""
    share = float(rng.uniform(0.08, 0.25))
    return EffectForm(
        "outside:atrial_kick", "atrial_kick", {"share": share}, "pump",
        squeeze=lambda phase, shape, c: shape + share * bump((phase - 0.88) / 0.11, 1.0),
    )  # fmt: skip


_SENSED = ("wire_drift", "sensor_height", "aortic_zero_error", "catheter_damping", "signal_delay")
_CIRCUIT = (
    quadratic_loss, dynamic_narrowing, proximal_resistance, stress_narrowing, inertance,
    vasodilation, adenosine_vasodilation, r1_r3_dilation, autoregulation, stress_compliance,
    back_pressure, collateral_flow, intramyocardial_pump, dobutamine_inotropy,
    wall_viscoelasticity, aortic_waveform,
)  # fmt: skip
_OUTSIDE = {
    **{one.__name__: one for one in (fistula, distal_stenosis, bridge, atrial_kick)},
    **{
        name: outside.KINDS[name]
        for name in ("damped_distal", "whipping", "moving_wire", "flow_error", "distal_gain")
    },
}

KINDS = tuple(_OUTSIDE)
"""Causes outside the list that this generator has."""

DRAWERS: dict[str, Callable[[np.random.Generator], EffectForm]] = {
    "none": lambda rng: EffectForm(),
    **{one.__name__: one for one in _CIRCUIT},
    **{name: getattr(sensing, name) for name in _SENSED},
    **{f"outside:{name}": drawer for name, drawer in _OUTSIDE.items()},
}
"""A function for each truth that draws a form and a size."""
