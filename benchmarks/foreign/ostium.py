"""Forms of the effects at the ostium.

Losses of short constrictions rise with a power of 1.5 (laminar, separated) to 2 (turbulent) of the
flow (Young & Tsai 1973, J Biomech 6:395; Idelchik's handbook). The intramural course narrows where
the aorta's pressure is high: areas fall by up to 50 % between diastole and systole (intravascular
ultrasound of anomalous coronaries). Inertance ρ l/A: 0.005 to 0.4 mmHg·s²/mL.
"""

import numpy as np

from benchmarks.foreign.circuit import Physics
from benchmarks.foreign.form import EffectForm, either, log_uniform, pick

PLACE = "ostium"
FLOW = 2.0
"""Flow at which a loss is sized [mL/s]."""


def _power(Q, n):
    return Q * (Q * Q + 1e-4) ** (0.5 * (n - 1.0))


def quadratic_loss(rng: np.random.Generator) -> EffectForm:
    """A loss of 0.3 to 16 mmHg at 2 mL/s.

    A power, Young and Tsai's sum, a one-way expansion, or a coefficient that falls with the
    Reynolds number.
    """
    form = pick(rng, "power", "young_tsai", "one_way", "reynolds")
    drop = log_uniform(rng, 0.3, 16.0)
    n = float(rng.uniform(1.6, 2.0))
    size = {"drop_at_2_ml_per_s": drop, "exponent": 2.0}
    inertia = float(rng.uniform(0.005, 0.03))
    if form == "power":
        size["exponent"] = n

        def loss(p, Q, P_ao, P_D, z):
            return p["R_0"] * Q + p["on"] * drop * _power(Q / FLOW, n)

    elif form == "young_tsai":
        viscous = float(rng.uniform(0.0, 0.15))
        size["viscous_share"] = viscous

        def loss(p, Q, P_ao, P_D, z):
            u = Q / FLOW
            return p["R_0"] * Q + p["on"] * drop * (viscous * u + (1.0 - viscous) * _power(u, 2.0))

    elif form == "one_way":

        def loss(p, Q, P_ao, P_D, z):
            way = np.where(Q > 0.0, 1.0, 0.4)
            return p["R_0"] * Q + p["on"] * drop * way * _power(Q / FLOW, 2.0)

    else:

        def loss(p, Q, P_ao, P_D, z):
            u = np.abs(Q) / FLOW
            return p["R_0"] * Q + p["on"] * drop * _power(Q / FLOW, 2.0) * 1.4 / (
                1.0 + 0.4 / (u + 0.05) ** 0.5
            )

    def parameters(p, condition):
        return {**p, "L": p["L"] + (inertia if form == "young_tsai" else 0.0)}

    physics = Physics(loss=loss, linear=False)
    return EffectForm("quadratic_loss", form, size, PLACE, physics=physics, parameters=parameters)


def dynamic_narrowing(rng: np.random.Generator) -> EffectForm:
    """An area that falls with the aortic pressure.

    At once, with a lag, in a sigmoid, or with the pressure across the shared wall; the resistance
    goes with a power of the area.
    """
    form = pick(rng, "area_law", "lagged_area", "sigmoid", "transmural")
    depth = log_uniform(rng, 0.03, 0.5)
    power = float(rng.uniform(1.5, 2.5))
    lag = float(rng.uniform(0.015, 0.06))
    start, span = float(rng.uniform(60.0, 80.0)), float(rng.uniform(50.0, 75.0))
    size = {"area_loss": depth, "power": power, "from_mmHg": start, "span_mmHg": span}
    if form == "lagged_area":
        size["lag_s"] = lag

    def area(P):
        share = (P - start) / span
        if form == "sigmoid":
            return 1.0 - depth / (1.0 + np.exp(-6.0 * (share - 0.5)))
        smooth = 0.5 * (share + np.sqrt(share**2 + 0.01))
        return np.maximum(1.0 - depth * smooth, 0.2)

    def loss(p, Q, P_ao, P_D, z):
        P = z[0] if form == "lagged_area" else P_ao
        if form == "transmural":
            P = P_ao + 1.5 * (P_ao - P_D)
        narrow = np.where(p["on"] > 0.0, area(P) ** -power, 1.0)
        return p["R_0"] * Q * narrow

    def extra(p, P_ao, P_D, P_A, Q, z):
        return [(P_ao - z[0]) / lag]

    lagged = {"extra": extra, "start": (90.0,)} if form == "lagged_area" else {}
    physics = Physics(loss=loss, linear=False, **lagged)
    return EffectForm("dynamic_narrowing", form, size, PLACE, physics=physics)


def proximal_resistance(rng: np.random.Generator) -> EffectForm:
    """A resistance 1.2 to 4 times the computed one, or its inverse.

    As a factor, as one more in series, or as one of a shear-thinning blood.
    """
    form = pick(rng, "factor", "in_series", "shear_thinning")
    factor = either(rng, 1.2, 4.0)
    added = float(rng.uniform(1.0, 8.0))
    thinning = float(rng.uniform(0.08, 0.25))
    if form == "factor":
        return EffectForm(
            "proximal_resistance", form, {"factor": factor}, PLACE,
            parameters=lambda p, condition: {**p, "R_0": p["R_0"] * factor},
        )  # fmt: skip
    if form == "in_series":
        return EffectForm(
            "proximal_resistance", form, {"mmHg_s_per_ml": added}, PLACE,
            parameters=lambda p, condition: {**p, "R_0": p["R_0"] + added},
        )  # fmt: skip

    def loss(p, Q, P_ao, P_D, z):
        thin = factor * ((np.abs(Q) + 0.2) / 1.5) ** -thinning
        return p["R_0"] * Q * np.where(p["on"] > 0.0, thin, 1.0)

    return EffectForm(
        "proximal_resistance", form, {"factor": factor, "thinning": thinning}, PLACE,
        physics=Physics(loss=loss, linear=False),
    )  # fmt: skip


def stress_narrowing(rng: np.random.Generator) -> EffectForm:
    """A proximal resistance that changes under stress.

    Alike under all drugs, with the dose, or with the systolic pressure.
    """
    form = pick(rng, "all_drugs", "with_dose", "with_pressure")
    wider = rng.random() < 0.2
    factor = 1.0 / log_uniform(rng, 1.1, 2.5) if wider else log_uniform(rng, 1.1, 3.5)

    def parameters(p, condition):
        how = condition.dose
        if form == "all_drugs":
            how = float(condition.stressed)
        elif form == "with_pressure":
            how = float(condition.stressed) * (0.4 + max(condition.P_systolic - 95.0, 0.0) / 60.0)
        return {**p, "R_0": p["R_0"] * factor**how}

    return EffectForm("stress_narrowing", form, {"factor": factor}, PLACE, parameters=parameters)


def inertance(rng: np.random.Generator) -> EffectForm:
    """An inertance.

    Alone, with the friction of an oscillating flow beside it, or one that holds forward flow back
    twice as much as backward flow.
    """
    form = pick(rng, "inertance", "oscillating", "one_way")
    L = log_uniform(rng, 0.005, 0.4)
    size = {"mmHg_s2_per_ml": L}
    if form == "inertance":
        return EffectForm(
            "inertance", form, size, PLACE, parameters=lambda p, condition: {**p, "L": L}
        )
    if form == "one_way":

        def directed(p, Q, P_ao, P_D, z):
            drop = P_ao - P_D - p["R_0"] * Q
            # what the state's inertance would do is scaled by the loss term
            share = p["on"] * 0.5 / (1.0 + np.exp(-8.0 * Q))
            return p["R_0"] * Q + drop * share

        return EffectForm(
            "inertance", form, size, PLACE, parameters=lambda p, condition: {**p, "L": 0.5 * L},
            physics=Physics(loss=directed, linear=False),
        )  # fmt: skip

    lag = float(rng.uniform(0.02, 0.08))

    def oscillating(p, Q, P_ao, P_D, z):
        # the part of the flow that the boundary layer has not followed yet sees more friction
        return p["R_0"] * Q + p["on"] * 0.6 * p["R_0"] * (Q - z[0])

    def extra(p, P_ao, P_D, P_A, Q, z):
        return [(Q - z[0]) / lag]

    return EffectForm(
        "inertance", form, {**size, "layer_s": lag}, PLACE,
        parameters=lambda p, condition: {**p, "L": L},
        physics=Physics(loss=oscillating, extra=extra, start=(1.0,)),
    )  # fmt: skip
