"""Causes outside the list of effects, for the own circuit.

Sizes: stenoses beyond the sensor that lose 3 to 15 mmHg; bridges that halve the lumen in systole;
venous a- and v-waves of 3 to 8 mmHg; whip of 3 to 8 mmHg at 10 to 20 Hz; alternans of 4 to 10 mmHg.
"""

from collections.abc import Callable

import numpy as np

from benchmarks.foreign.circuit import Physics
from benchmarks.foreign.form import EffectForm, log_uniform, signed
from benchmarks.foreign.sensing import first_order
from benchmarks.foreign.waves import bump


def _named(kind: str, size: dict[str, float], place: str, **how) -> EffectForm:
    return EffectForm(f"outside:{kind}", kind, size, place, **how)


def distal_stenosis(rng: np.random.Generator) -> EffectForm:
    """A stenosis behind the sensor: R_1 gets a quadratic part."""
    drop = float(rng.uniform(3.0, 15.0))
    K = drop / 4.0

    def arterial(p, across):
        a, k = p["R_1"], np.maximum(p["on"] * K, 1e-9)
        return np.sign(across) * (np.sqrt(a * a + 4.0 * k * np.abs(across)) - a) / (2.0 * k)

    physics = Physics(arterial=arterial, linear=False)
    return _named("distal_stenosis", {"drop_at_2_ml_per_s": drop}, "artery", physics=physics)


def bridge(rng: np.random.Generator) -> EffectForm:
    """A myocardial bridge behind the sensor: the muscle narrows the artery in systole."""
    times = float(rng.uniform(2.0, 9.0))

    def tone(p, P_D, P_im, z):
        return 1.0 + p["on"] * times * np.clip(P_im / 110.0, 0.0, None) ** 2, 1.0

    physics = Physics(tone=tone, linear=False)
    return _named("bridge", {"times": times}, "artery", physics=physics)


def venous_pulsation(rng: np.random.Generator) -> EffectForm:
    """Venous a- and v-waves."""
    mean, a, v = rng.uniform(4.0, 9.0), rng.uniform(3.0, 10.0), rng.uniform(3.0, 12.0)

    def venous(p, P_M, P_im, phase):
        P = mean + a * bump((phase - 0.9) / 0.09, 1.0) + v * bump((phase - 0.38) / 0.12, 1.0)
        return (P_M - p["P_v"] - p["on"] * P) / p["R_3"]

    physics = Physics(venous=venous, linear=False)
    return _named("venous_pulsation", {"mean_mmHg": float(mean)}, "vein", physics=physics)


def vessel_collapse(rng: np.random.Generator) -> EffectForm:
    """A soft vessel that collapses where the pressure behind the ostium falls."""
    at, times = float(rng.uniform(60.0, 80.0)), float(rng.uniform(1.0, 5.0))

    def loss(p, Q, P_ao, P_D, z):
        below = (at - P_D) / 8.0
        soft = np.logaddexp(0.0, np.clip(below, -30.0, 30.0))
        return p["R_0"] * Q * (1.0 + p["on"] * times * soft / (1.0 + 0.2 * soft))

    physics = Physics(loss=loss, linear=False)
    return _named("vessel_collapse", {"below_mmHg": at, "times": times}, "ostium", physics=physics)


def atrial_kick(rng: np.random.Generator) -> EffectForm:
    """The ventricle's filling presses on the bed in late diastole."""
    share = float(rng.uniform(0.06, 0.25))

    def squeeze(phase, shape, condition):
        return shape + share * bump((phase - 0.9) / 0.09, 1.0) + 0.3 * share * (phase > 0.45)

    return _named("atrial_kick", {"share": share}, "pump", squeeze=squeeze)


def damped_distal(rng: np.random.Generator) -> EffectForm:
    """The distal trace is damped (a bubble, a clot)."""
    lag = log_uniform(rng, 0.01, 0.08)
    return _named(
        "damped_distal", {"lag_s": lag}, "sensor",
        sensors=lambda t, P_aorta, P_distal, condition: (P_aorta, first_order(t, P_distal, lag)),
    )  # fmt: skip


def whipping(rng: np.random.Generator) -> EffectForm:
    """The wire whips: bursts of an oscillation in systole."""
    size, hertz = float(rng.uniform(2.0, 8.0)), float(rng.uniform(9.0, 20.0))

    def sensors(t, P_aorta, P_distal, condition):
        phase = np.mod(t / condition.period, 1.0)
        burst = bump((phase - 0.25) / 0.2, 1.0) * np.sin(2.0 * np.pi * hertz * phase)
        return P_aorta, P_distal + size * (1.0 + 0.5 * condition.stressed) * burst

    return _named("whipping", {"mmHg": size, "hertz": hertz}, "sensor", sensors=sensors)


def moving_wire(rng: np.random.Generator) -> EffectForm:
    """The sensor slips towards the aorta and back while a condition is recorded."""
    share, hertz = float(rng.uniform(0.3, 0.9)), float(rng.uniform(0.15, 0.4))

    def sensors(t, P_aorta, P_distal, condition):
        back = share * 0.5 * (1.0 - np.cos(2.0 * np.pi * hertz * t))
        return P_aorta, P_distal + back * (P_aorta - P_distal)

    return _named("moving_wire", {"share": share}, "sensor", sensors=sensors)


def flow_error(rng: np.random.Generator) -> EffectForm:
    """The flow measurement is calibrated wrongly, in another way in each condition."""
    factors = np.exp(0.45 * rng.normal(size=4))
    return _named(
        "flow_error", {"rest_factor": float(factors[0])}, "sensor",
        flow=lambda flow, condition: flow * float(factors[condition.order]),
    )  # fmt: skip


def distal_gain(rng: np.random.Generator) -> EffectForm:
    """The gain of the wire is wrong."""
    gain = 1.0 + signed(rng, 0.02, 0.07)
    return _named(
        "distal_gain", {"gain": gain}, "sensor",
        sensors=lambda t, P_aorta, P_distal, condition: (P_aorta, P_distal * gain),
    )  # fmt: skip


def pulsus_alternans(rng: np.random.Generator) -> EffectForm:
    """Every second beat is weaker."""
    size = float(rng.uniform(3.0, 10.0))

    def beats(place, condition):
        return (size if place % 2 else -size), 0.3 * (size if place % 2 else -size)

    return _named("pulsus_alternans", {"mmHg": size}, "inlet", beats=beats)


def thermal_trend(rng: np.random.Generator) -> EffectForm:
    """The wire warms up while it records: a trend within each trace."""
    slope = signed(rng, 0.15, 1.0)
    return _named(
        "thermal_trend", {"mmHg_per_s": slope}, "sensor",
        sensors=lambda t, P_aorta, P_distal, condition: (P_aorta, P_distal + slope * t),
    )  # fmt: skip


def arrhythmia(rng: np.random.Generator) -> EffectForm:
    """Pressures that follow the filling time, beat by beat, without a rhythm."""
    size = float(rng.uniform(4.0, 9.0))
    course = rng.normal(size=(4, 64))

    def beats(place, condition):
        one = float(np.clip(course[condition.order, place % 64], -1.8, 1.8))
        return size * one, -0.4 * size * one

    return _named("arrhythmia", {"mmHg": size}, "inlet", beats=beats)


KINDS: dict[str, Callable[[np.random.Generator], EffectForm]] = {
    one.__name__: one
    for one in (
        distal_stenosis, bridge, venous_pulsation, vessel_collapse, atrial_kick, damped_distal,
        whipping, moving_wire, flow_error, distal_gain, pulsus_alternans, thermal_trend, arrhythmia,
    )
}  # fmt: skip
"""Causes outside the list by name."""
