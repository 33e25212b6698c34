"""Effects of the sensors and of the aortic waveform on records of the layered bed.

Sources: fluid-filled catheters as second-order systems: Gardner 1981; drift of pressure wires:
Wakasa et al. 2016; hydrostatic error: Härle et al. 2017; contour of the aortic pulse: Murgo 1980.
"""

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.signal import lfilter, lfiltic

from benchmarks.foreign.clock import GRID_S
from benchmarks.foreign.form import Traces, log_uniform, signed
from benchmarks.foreign.layered_kinds import LayeredKind, Size
from benchmarks.foreign.patient import ForeignCondition
from benchmarks.foreign.waves import assumed_aorta

MMHG_PER_CM = 0.77
"""Pressure of a column of blood."""

DRUGS = 3
"""Measurements after the first."""


def second_order(x: np.ndarray, slowness: float, damping: float) -> np.ndarray:
    """A trace behind a system y'' s² + 2 ζ s y' + y = x, by the bilinear rule.

    Args:
        x: trace over a grid of `GRID_S`.
        slowness: s = 1/(2π f) of its natural frequency [s].
        damping: ζ.
    """
    u = 2.0 * slowness / GRID_S
    v = 2.0 * damping * u
    forward = np.array([1.0, 2.0, 1.0])
    back = np.array([u * u + v + 1.0, 2.0 - 2.0 * u * u, u * u - v + 1.0])
    rest = np.full(2, x[0])
    start = lfiltic(forward, back, rest, rest)
    return np.asarray(lfilter(forward, back, x, zi=start)[0])


def first_order(x: np.ndarray, time: float) -> np.ndarray:
    """A trace behind a system τ y' + y = x with τ in s, by the bilinear rule."""
    u = 2.0 * time / GRID_S
    start = lfiltic([1.0, 1.0], [1.0 + u, 1.0 - u], x[:1], x[:1])
    return np.asarray(lfilter([1.0, 1.0], [1.0 + u, 1.0 - u], x, zi=start)[0])


def distal_plus(offset):
    """Sensors that add a number of mmHg to the distal trace, by condition."""

    def sensors(t, P_aorta, P_distal, c: ForeignCondition) -> Traces:
        return P_aorta, P_distal + offset(c)

    return {"sensors": sensors}


def _walk(size: Size) -> dict:
    steps = [size[f"step_{k}_mmHg"] for k in range(1, DRUGS + 1)]
    return distal_plus(lambda c: sum(steps[: c.order]))


def _zero_error(size: Size) -> dict:
    def sensors(t, P_aorta, P_distal, c: ForeignCondition) -> Traces:
        return P_aorta + size["mmHg"], P_distal

    return {"sensors": sensors}


def _overdamped(size: Size) -> dict:
    def sensors(t, P_aorta, P_distal, c: ForeignCondition) -> Traces:
        return second_order(P_aorta, 1e-3 * size["slowness_ms"], size["damping"]), P_distal

    return {"sensors": sensors}


def _bubble(size: Size) -> dict:
    def sensors(t, P_aorta, P_distal, c: ForeignCondition) -> Traces:
        return first_order(P_aorta, 1e-3 * size["ms"]), P_distal

    return {"sensors": sensors}


def _shifted(size: Size) -> dict:
    def sensors(t, P_aorta, P_distal, c: ForeignCondition) -> Traces:
        at = t - 1e-3 * size["ms"]
        at = np.where(at > t[-1], at - c.period, at)  # the next beat is like the last
        at = np.where(at < t[0], at + c.period, at)
        return P_aorta, np.interp(at, t, P_distal)

    return {"sensors": sensors}


def _mixed(unit, share: float) -> dict:
    """An aortic pressure that moves by a share towards another contour of the same extremes."""

    def inlet(phase, P, high: float, low: float, c: ForeignCondition) -> np.ndarray:
        usual = assumed_aorta(phase, high, low, low)
        return P + share * (low + (high - low) * unit(phase % 1.0) - usual)

    return {"inlet": inlet}


def _normalised(phase: np.ndarray, P: np.ndarray):
    """A contour from 0 at its start to 1 at its peak, closed at the end of the beat."""
    P = P - P[0] - (P[-1] - P[0]) * np.clip((phase - 0.5) / 0.5, 0.0, 1.0)
    return lambda x: np.interp(x, phase, P / P.max())


def _landmarks(size: Size) -> dict:
    """A contour through foot, shoulder, peak, incisura, dicrotic wave and diastole."""
    peak, notch = size["peak_phase"], size["notch_phase"]
    level, wave = size["notch_level"], size["dicrotic_rise"]
    at = [0.0, 0.45 * peak, peak, notch, notch + 0.06, 0.5 + 0.5 * notch, 1.0]
    value = [0.0, size["shoulder"], 1.0, level, level + wave, 0.4 * level, 0.0]
    phase = np.linspace(0.0, 1.0, 801)
    return _mixed(_normalised(phase, PchipInterpolator(at, value)(phase)), size["share"])


def _draw_landmarks(rng: np.random.Generator) -> Size:
    return {
        "share": float(rng.uniform(0.2, 1.0)),
        "peak_phase": float(rng.uniform(0.15, 0.25)),
        "shoulder": float(rng.uniform(0.7, 0.9)),
        "notch_phase": float(rng.uniform(0.36, 0.42)),
        "notch_level": float(rng.uniform(0.45, 0.65)),
        "dicrotic_rise": float(rng.uniform(0.0, 0.08)),
    }


def _reflected(size: Size) -> dict:
    """A forward wave that a tube of the given travel time returns, over a diastolic decay."""
    phase = np.linspace(0.0, 1.0, 801)

    def forward(x: np.ndarray) -> np.ndarray:
        inside = np.clip(x / 0.36, 0.0, 1.0)
        ejected = np.sin(np.pi * inside ** size["skew"]) ** 1.2 * (inside < 1.0)
        return np.where(x > 0.0, ejected, 0.0)

    P = forward(phase) + size["reflection"] * forward(phase - size["travel"])
    step = phase[1]
    store = np.asarray(lfilter([step], [1.0, step / size["decay"] - 1.0], P)) / 0.2
    return _mixed(_normalised(phase, P + size["windkessel"] * store), size["share"])


def _draw_reflected(rng: np.random.Generator) -> Size:
    return {
        "share": float(rng.uniform(0.2, 1.0)),
        "skew": float(rng.uniform(0.7, 1.0)),
        "reflection": float(rng.uniform(0.1, 0.5)),
        "travel": float(rng.uniform(0.08, 0.2)),
        "decay": float(rng.uniform(0.35, 0.8)),
        "windkessel": float(rng.uniform(0.6, 1.4)),
    }


def _draw_walk(rng: np.random.Generator) -> Size:
    lean = signed(rng, 0.8, 2.0)
    return {f"step_{k}_mmHg": float(lean + 1.2 * rng.normal()) for k in range(1, DRUGS + 1)}


_NO_STEPS = {f"step_{k}_mmHg": 0.0 for k in range(1, DRUGS + 1)}

READING = (
    LayeredKind(
        "wire_drift", "steady", "wire",
        lambda rng: {"mmHg_each": signed(rng, 1.2, 3.5)},
        lambda size: distal_plus(lambda c: size["mmHg_each"] * c.order), {"mmHg_each": 0.0},
    ),
    LayeredKind("wire_drift", "walk", "wire", _draw_walk, _walk, _NO_STEPS),
    LayeredKind(
        "sensor_height", "column", "wire",
        lambda rng: {"cm": signed(rng, 1.5, 7.5)},
        lambda size: distal_plus(lambda c: -MMHG_PER_CM * size["cm"]), {"cm": 0.0},
    ),
    LayeredKind(
        "aortic_zero_error", "stated_by_it", "transducer",
        lambda rng: {"mmHg": signed(rng, 1.5, 8.0)},
        lambda size: {**_zero_error(size), "stated_shift": size["mmHg"]}, {"mmHg": 0.0},
    ),
    LayeredKind(
        "aortic_zero_error", "stated_by_cuff", "transducer",
        lambda rng: {"mmHg": signed(rng, 1.5, 8.0)}, _zero_error, {"mmHg": 0.0},
    ),
    LayeredKind(
        "catheter_damping", "overdamped", "catheter",
        lambda rng: {
            "slowness_ms": log_uniform(rng, 2.0, 16.0), "damping": float(rng.uniform(0.8, 1.6)),
        },
        _overdamped, {"slowness_ms": 0.0, "damping": 1.0},
    ),
    LayeredKind(
        "catheter_damping", "bubble", "catheter",
        lambda rng: {"ms": log_uniform(rng, 1.5, 22.0)}, _bubble, {"ms": 0.0},
    ),
    LayeredKind(
        "signal_delay", "distal_shifted", "clock",
        lambda rng: {"ms": float(rng.choice([rng.uniform(2.0, 30.0), -rng.uniform(2.0, 20.0)]))},
        _shifted, {"ms": 0.0},
    ),
    LayeredKind(
        "aortic_waveform", "landmarks", "aorta", _draw_landmarks, _landmarks,
        {"share": 0.0, "peak_phase": 0.2, "shoulder": 0.8, "notch_phase": 0.4, "notch_level": 0.5,
         "dicrotic_rise": 0.05},
    ),
    LayeredKind(
        "aortic_waveform", "reflected", "aorta", _draw_reflected, _reflected,
        {"share": 0.0, "skew": 0.8, "reflection": 0.3, "travel": 0.1, "decay": 0.5,
         "windkessel": 1.0},
    ),
)  # fmt: skip
"""Forms of the effects of sensors and waveform."""
