"""Forms of the effects at sensors and at the inlet.

Sizes: wires drift by up to 2 to 6 mmHg (Cook 2016, Circ Cardiovasc Interv 9:e002988); a height
counts 0.77 mmHg a centimetre; catheters have natural frequencies of 5 to 25 Hz and damping ratios
of 0.15 to 1.5 (Gardner 1981, Anesthesiology 54:227); lines and filters delay by 1 to 60 ms.
"""

from collections.abc import Callable

import numpy as np
from scipy.signal import lfilter

from benchmarks.foreign.form import EffectForm, either, log_uniform, pick, signed
from benchmarks.foreign.waves import bump

PLACE = "sensor"


def _on_distal(change: Callable) -> Callable:
    return lambda t, P_aorta, P_distal, condition: (P_aorta, P_distal + change(condition))


def wire_drift(rng: np.random.Generator) -> EffectForm:
    """Drift of 0.5 to 8 mmHg at the last condition: even, early, late, or in one jump."""
    form = pick(rng, "even", "early", "late", "jump")
    last = signed(rng, 0.5, 8.0)
    jump = int(rng.integers(1, 3))

    def drift(condition):
        share = condition.order / 3.0
        shapes = {"even": share, "early": np.sqrt(share), "late": share**2}
        return last * shapes.get(form, float(condition.order >= jump))

    return EffectForm("wire_drift", form, {"last_mmHg": last}, PLACE, sensors=_on_distal(drift))


def sensor_height(rng: np.random.Generator) -> EffectForm:
    """A height of 0.5 to 8 cm: fixed, or somewhat other in each condition (the wire was moved)."""
    form = pick(rng, "fixed", "moved")
    cm = signed(rng, 0.5, 8.0)
    moved = 1.0 + 0.15 * rng.normal(size=4) * (form == "moved")
    return EffectForm(
        "sensor_height", form, {"cm": cm}, PLACE,
        sensors=_on_distal(lambda condition: -0.77 * cm * moved[condition.order]),
    )  # fmt: skip


def aortic_zero_error(rng: np.random.Generator) -> EffectForm:
    """A zero error of 0.7 to 9 mmHg.

    The stated pressures come from a cuff or from the transducer itself.
    """
    form = pick(rng, "cuff_stated", "transducer_stated")
    zero = signed(rng, 0.7, 9.0)
    return EffectForm(
        "aortic_zero_error", form, {"mmHg": zero}, PLACE,
        sensors=lambda t, P_aorta, P_distal, condition: (P_aorta + zero, P_distal),
        stated_shift=zero if form == "transducer_stated" else 0.0,
    )  # fmt: skip


def second_order(t: np.ndarray, P: np.ndarray, hertz: float, ratio: float) -> np.ndarray:
    """What a line of a natural frequency and a damping ratio shows, on a uniform grid."""
    h, w = float(t[1] - t[0]), 2.0 * np.pi * hertz
    k = 2.0 / h  # bilinear
    a = np.array([k * k + 2 * ratio * w * k + w * w, 2 * (w * w - k * k)])
    a = np.append(a, k * k - 2 * ratio * w * k + w * w)
    b = w * w * np.array([1.0, 2.0, 1.0])
    mean = float(P.mean())
    return mean + np.asarray(lfilter(b / a[0], a / a[0], P - mean))


def first_order(t: np.ndarray, P: np.ndarray, lag: float) -> np.ndarray:
    """P through a first-order lag [s], on a uniform grid."""
    h, mean = float(t[1] - t[0]), float(P.mean())
    k = 2.0 * lag / h
    return mean + np.asarray(lfilter([1.0 / (1 + k)] * 2, [1.0, (1 - k) / (1 + k)], P - mean))


def catheter_damping(rng: np.random.Generator) -> EffectForm:
    """The aortic line: a lag, an overdamped or an underdamped oscillator."""
    form = pick(rng, "lag", "overdamped", "underdamped")
    lag = log_uniform(rng, 0.0015, 0.05)
    hertz = float(rng.uniform(5.0, 25.0))
    ratio = float(rng.uniform(0.9, 2.0) if form == "overdamped" else rng.uniform(0.12, 0.45))
    size = {"lag_s": lag} if form == "lag" else {"hertz": hertz, "ratio": ratio}

    def sensors(t, P_aorta, P_distal, condition):
        if form == "lag":
            return first_order(t, P_aorta, lag), P_distal
        return second_order(t, P_aorta, hertz, ratio), P_distal

    return EffectForm("catheter_damping", form, size, PLACE, sensors=sensors)


def later(t: np.ndarray, P: np.ndarray, delay: float) -> np.ndarray:
    """P as it was a delay [s] before."""
    return np.interp(t - delay, t, P)


def signal_delay(rng: np.random.Generator) -> EffectForm:
    """One trace is 1 to 60 ms late: the distal or the aortic one, alike or with some jitter."""
    form = pick(rng, "distal_late", "aortic_late", "distal_late_unevenly")
    delay = log_uniform(rng, 0.001, 0.06)
    uneven = 1.0 + 0.15 * rng.normal(size=4) * (form == "distal_late_unevenly")

    def sensors(t, P_aorta, P_distal, condition):
        late = delay * float(uneven[condition.order])
        if form == "aortic_late":
            return later(t, P_aorta, late), P_distal
        return P_aorta, later(t, P_distal, late)

    return EffectForm("signal_delay", form, {"s": delay}, PLACE, sensors=sensors)


def aortic_waveform(rng: np.random.Generator) -> EffectForm:
    """Another shape between the same systolic and diastolic pressures.

    A dicrotic notch, a late systolic wave, a straight diastole, a peak at another time, or an
    anacrotic shoulder.
    """
    form = pick(rng, "notch", "late_wave", "straight_diastole", "other_peak", "shoulder")
    depth = log_uniform(rng, 0.006, 0.25)
    width = float(rng.uniform(0.03, 0.06))
    at = float(rng.uniform(0.34, 0.42))
    rate = either(rng, 1.01, 1.3)

    def inlet(phase, P, high, low, condition):
        pulse = high - low
        Q = P
        if form == "notch":
            Q = P - depth * pulse * bump((phase - at) / width, 1.0)
            Q = Q + 0.5 * depth * pulse * bump((phase - at - 1.8 * width) / (1.5 * width), 1.0)
        elif form == "late_wave":
            Q = P + depth * pulse * bump((phase - at + 0.06) / 0.12, 1.0)
        elif form == "straight_diastole":
            end = np.interp(0.4, phase, P)
            line = end + (P[-1] - end) * np.clip((phase - 0.4) / 0.6, 0.0, 1.0)
            step = 0.5 * depth * pulse * bump((phase - 0.6) / 0.2, 1.0)
            Q = np.where(phase > 0.4, line - step, P)
        elif form == "other_peak":
            Q = np.interp(phase**rate, phase, P)
        elif form == "shoulder":
            Q = P - depth * pulse * bump((phase - 0.17) / 0.07, 1.0)
        return _restored(Q, P)

    size = {"share_of_pulse": depth} if form != "other_peak" else {"rate": rate}
    return EffectForm("aortic_waveform", form, size, "inlet", inlet=inlet)


def _restored(Q: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Q with the largest value of P, its ends kept."""
    low = P[0] + (P[-1] - P[0]) * np.linspace(0.0, 1.0, P.size)
    return low + (Q - low) * float((P - low).max() / (Q - low).max())
