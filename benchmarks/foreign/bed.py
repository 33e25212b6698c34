"""Forms of the effects in the microvasculature, the pump and the wall.

Sizes: flow reserve of 1.5 to 4.5 against 1.1 of the rule; zero-flow pressures of 10 to 30 mmHg and
intramyocardial compliances that double with tone (Chilian & Marcus 1984, Am J Physiol 247:H984);
collateral conductances of 5 to 35 % of the bed's (Seiler; Wustmann 2003); autoregulation gains of
0.3 to 1 (Mosher 1964); phase lags of the arterial wall of 6 to 12° at a heart rate.
"""

import numpy as np

from benchmarks.foreign.circuit import Physics
from benchmarks.foreign.form import EffectForm, either, log_uniform, pick, times

PLACE = "microvasculature"


def _dilation(effect: str, rng: np.random.Generator, drugs: tuple[str, ...]) -> EffectForm:
    form = pick(rng, "R_2", "R_1_and_R_2", "graded_R_2")
    factor = log_uniform(rng, 0.15, 0.9) if rng.random() < 0.7 else log_uniform(rng, 1.1, 3.5)

    def parameters(p, condition):
        if condition.drug not in drugs:
            return p
        power = condition.dose if form == "graded_R_2" else 1.0
        more = {"R_1": factor**power} if form == "R_1_and_R_2" else {}
        return times(R_2=factor**power, **more)(p)

    return EffectForm(effect, form, {"factor": factor}, PLACE, parameters=parameters)


def vasodilation(rng: np.random.Generator) -> EffectForm:
    """Micro resistance under any drug, alone, with the arterial one, or graded with the dose."""
    return _dilation("vasodilation", rng, ("adenosine", "dobutamine"))


def adenosine_vasodilation(rng: np.random.Generator) -> EffectForm:
    """The same under adenosine alone."""
    return _dilation("adenosine_vasodilation", rng, ("adenosine",))


def r1_r3_dilation(rng: np.random.Generator) -> EffectForm:
    """Arterial and venous resistances fall under stress.

    Alike, the arterial one more, or with the dose.
    """
    form = pick(rng, "alike", "arteries_more", "with_dose")
    factor = float(rng.uniform(0.3, 0.95))

    def parameters(p, condition):
        if not condition.stressed:
            return p
        power = condition.dose if form == "with_dose" else 1.0
        first = factor**1.6 if form == "arteries_more" else factor**power
        return times(R_1=first, R_3=factor**power)(p)

    return EffectForm("r1_r3_dilation", form, {"factor": factor}, PLACE, parameters=parameters)


def autoregulation(rng: np.random.Generator) -> EffectForm:
    """Resistance follows the perfusion pressure with a lag of 0.3 to 4 s.

    A power, a saturating curve, or one that acts on the arteries as well.
    """
    form = pick(rng, "power", "saturating", "arteries_too")
    gain = float(rng.uniform(0.1, 1.2))
    lag = log_uniform(rng, 0.3, 4.0)
    usual = float(rng.uniform(75.0, 95.0))

    def curve(P):
        share = np.log(np.maximum(P, 5.0) / usual)
        if form == "saturating":
            share = 0.45 * np.tanh(share / 0.45)
        return np.exp(1.6 * gain * share)

    def tone(p, P_D, P_im, z):
        f = np.where(p["on"] > 0.0, curve(z[0]), 1.0)
        return (f if form == "arteries_too" else 1.0), f

    def extra(p, P_ao, P_D, P_A, Q, z):
        return [(P_D - z[0]) / lag]

    physics = Physics(tone=tone, extra=extra, start=(usual,), linear=False)
    size = {"gain": gain, "lag_s": lag, "usual_mmHg": usual}
    return EffectForm("autoregulation", form, size, PLACE, physics=physics)


def stress_compliance(rng: np.random.Generator) -> EffectForm:
    """Compliances under stress differ from the rule: both, that of the muscle, or of the artery."""
    form = pick(rng, "both", "muscle", "artery")
    factor = either(rng, 1.1, 4.0)

    def parameters(p, condition):
        which = {"both": ("C_a", "C_im"), "muscle": ("C_im",), "artery": ("C_a", "C_0")}[form]
        return times(**dict.fromkeys(which, factor))(p) if condition.stressed else p

    return EffectForm("stress_compliance", form, {"factor": factor}, PLACE, parameters=parameters)


def back_pressure(rng: np.random.Generator) -> EffectForm:
    """A venous pressure, a waterfall at a zero-flow pressure, or one that falls under stress."""
    form = pick(rng, "venous", "waterfall", "less_under_stress")
    P = float(rng.uniform(3.0, 32.0))
    if form != "waterfall":

        def parameters(p, condition):
            less = 0.6 if form == "less_under_stress" and condition.stressed else 1.0
            return {**p, "P_v": P * less}

        return EffectForm("back_pressure", form, {"mmHg": P}, PLACE, parameters=parameters)

    def venous(p, P_M, P_im, phase):
        over = P_M - P
        through = 0.5 * (over + np.sqrt(over**2 + 4.0))
        return np.where(p["on"] > 0.0, through, P_M - p["P_v"]) / p["R_3"]

    physics = Physics(venous=venous, linear=False)
    return EffectForm("back_pressure", form, {"mmHg": P}, PLACE, physics=physics)


def collateral_flow(rng: np.random.Generator) -> EffectForm:
    """A collateral from the aorta or a steady source.

    Into the artery, the muscle, or the node of the distal sensor.
    """
    form = pick(rng, "aorta_to_artery", "aorta_to_muscle", "steady_to_artery", "steady_to_distal")
    share = log_uniform(rng, 0.08, 0.7)
    source = float(rng.uniform(75.0, 100.0))
    aorta, node = form.split("_to_")

    def parameters(p, condition):
        return {**p, "conductance": share / (p["R_1"] + p["R_2"] + p["R_3"])}

    def side(p, P_ao, P_D, P_A, P_M, z):
        P = {"artery": P_A, "muscle": P_M, "distal": P_D}[node]
        flow = p["on"] * p["conductance"] * ((P_ao if aorta == "aorta" else source) - P)
        return tuple(flow if node == name else 0.0 for name in ("distal", "artery", "muscle"))

    return EffectForm(
        "collateral_flow", form, {"share_of_bed": share, "source_mmHg": source}, PLACE,
        physics=Physics(side=side), constants={"conductance": 0.0}, parameters=parameters,
    )  # fmt: skip


def _late(shift: float, power: float):
    def squeeze(phase, shape, condition):
        return np.interp(phase - shift, phase, shape, left=0.0) ** power

    return squeeze


def intramyocardial_pump(rng: np.random.Generator) -> EffectForm:
    """A squeeze of 0.5 to 2 times the assumed one.

    Of the same shape, a half sine, or one that starts late and rises more slowly.
    """
    form = pick(rng, "same_shape", "half_sine", "late")
    factor = either(rng, 1.05, 2.0)
    shift = float(rng.uniform(0.01, 0.04))

    def half_sine(phase, shape, condition):
        inside = (phase > 0.05) & (phase < 0.42)
        return np.where(inside, np.sin(np.pi * (phase - 0.05) / 0.37), 0.0)

    squeeze = {"half_sine": half_sine, "late": _late(shift, 1.5)}.get(form)
    return EffectForm(
        "intramyocardial_pump", form, {"factor": factor}, "pump", squeeze=squeeze,
        parameters=lambda p, condition: {**p, "squeeze": p["squeeze"] * factor},
    )  # fmt: skip


def dobutamine_inotropy(rng: np.random.Generator) -> EffectForm:
    """A stronger squeeze under dobutamine: in all of systole, with the dose, or faster as well."""
    form = pick(rng, "factor", "with_dose", "faster")
    factor = log_uniform(rng, 1.04, 1.8)

    def parameters(p, condition):
        if condition.drug != "dobutamine":
            return p
        power = condition.dose if form == "with_dose" else 1.0
        return {**p, "squeeze": p["squeeze"] * factor**power}

    def faster(phase, shape, condition):
        if condition.drug != "dobutamine":
            return shape
        return np.interp(0.0692 + (phase - 0.0692) * 1.15, phase, shape)

    squeeze = faster if form == "faster" else None
    return EffectForm(
        "dobutamine_inotropy", form, {"factor": factor}, "pump",
        parameters=parameters, squeeze=squeeze,
    )  # fmt: skip


def wall_viscoelasticity(rng: np.random.Generator) -> EffectForm:
    """A viscous wall.

    Voigt's of the arteries, of the proximal vessel as well, or a standard solid (a part of the
    compliance follows late).
    """
    form = pick(rng, "voigt", "voigt_both", "standard_solid")
    lag = log_uniform(rng, 0.004, 0.15)
    share = float(rng.uniform(0.3, 0.7))
    if form != "standard_solid":

        def parameters(p, condition):
            W_0 = lag / p["C_0"] if form == "voigt_both" else 0.0
            return {**p, "W_a": lag / p["C_a"], "W_0": W_0}

        return EffectForm(
            "wall_viscoelasticity", form, {"lag_s": lag}, "wall",
            physics=Physics(voigt=True), constants={"W_a": 0.0, "W_0": 0.0}, parameters=parameters,
        )  # fmt: skip

    def solid(p, condition):
        late = p["C_a"] * share
        return {**p, "C_a": p["C_a"] - late, "C_late": late}

    def side(p, P_ao, P_D, P_A, P_M, z):
        return 0.0, -p["on"] * p["C_late"] * (P_A - z[0]) / lag, 0.0

    def extra(p, P_ao, P_D, P_A, Q, z):
        return [(P_A - z[0]) / lag]

    return EffectForm(
        "wall_viscoelasticity", form, {"lag_s": lag, "late_share": share}, "wall",
        physics=Physics(side=side, extra=extra, start=(80.0,)), constants={"C_late": 0.0},
        parameters=solid,
    )  # fmt: skip
