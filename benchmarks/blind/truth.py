"""Hidden truths of the blind benchmark: circuits stepped through time, with other forms of effects.

All cases and conditions are lanes of one explicit Runge-Kutta march (fourth order, `STEPS` steps a
beat, `BEATS` beats). Where the diagnosis guesses an equation the truth has another one: a loss with
exponent 1.85, a tube law for the narrowing, two branches for the wall, saturating regulation, a
catheter of second order, and so on. Units mmHg, mL, s.
"""

from typing import Any

import numpy as np

STEPS = 5000
"""Steps a beat."""

BEATS = 7
"""Beats until the state repeats (slowest memory 0.16 a beat)."""

SAMPLED = 128
"""Samples kept of the last beat."""

RANGES: dict[str, tuple[float, float, bool]] = {
    "quadratic_loss": (1.5, 12.0, False),
    "dynamic_narrowing": (0.3, 2.0, False),
    "proximal_resistance": (0.25, 0.7, True),
    "stress_narrowing": (0.2, 0.8, True),
    "inertance": (0.03, 0.15, False),
    "vasodilation": (0.2, 0.8, True),
    "adenosine_vasodilation": (0.2, 0.8, True),
    "r1_r3_dilation": (0.3, 1.0, False),
    "autoregulation": (0.4, 1.6, False),
    "stress_compliance": (0.3, 1.0, True),
    "back_pressure": (4.0, 20.0, False),
    "collateral_flow": (0.08, 0.4, False),
    "intramyocardial_pump": (0.15, 0.6, True),
    "dobutamine_inotropy": (0.15, 0.8, False),
    "wall_viscoelasticity": (0.010, 0.060, False),
    "wire_drift": (1.0, 4.0, True),
    "sensor_height": (1.5, 7.0, True),
    "sensor_gain": (0.03, 0.10, True),
    "aortic_zero_error": (1.5, 7.0, True),
    "catheter_damping": (0.005, 0.030, False),
    "distal_damping": (0.005, 0.030, False),
    "signal_delay": (0.006, 0.040, True),
    "aortic_waveform": (2.0, 9.0, True),
}
"""Range of each effect's size, drawn evenly in its logarithm; whether the sign is drawn too."""

OUTSIDE: dict[str, tuple[float, float]] = {
    "systolic_resistance": (0.5, 2.0),
    "waterfall": (0.15, 0.4),
    "stiffening_wall": (0.5, 1.5),
    "threshold_collapse": (1.0, 4.0),
    "echo": (0.08, 0.25),
    "whip": (2.0, 8.0),
    "clipping": (0.75, 0.93),
    "long_ejection": (0.05, 0.15),
    "diastolic_suction": (4.0, 15.0),
    "shear_thinning": (0.3, 1.0),
}
"""Effects outside the catalogue and their ranges."""

_MMHG = 1333.22
_R_1, _R_2, _R_3 = 3.1992e4 / _MMHG, 6.3984e4 / _MMHG, 2.666e5 / _MMHG
_C_A, _C_IM, _C_0 = 4.5e-7 * _MMHG, 3e-6 * _MMHG, 1e-7 * _MMHG

Lanes = dict[str, Any]


def _bump(g: np.ndarray, k: float) -> np.ndarray:
    inside = np.abs(g) < 1.0
    gap = np.where(inside, 1.0 - np.where(inside, g, 0.0) ** 2, 1.0)
    return np.where(inside, np.exp(k - k / gap), 0.0)


def aortic(phase: np.ndarray, high: np.ndarray, low: np.ndarray) -> np.ndarray:
    """Aortic pressure at a phase of the beat (Puelz et al. 2024)."""
    rise = (high - low) * _bump(phase / 0.3 - 1.0, 2.0) + low
    valve = (high - low) * _bump(np.full_like(phase, 0.35 / 0.3 - 1.0), 2.0) + low
    return np.where(phase < 0.35, rise, valve * (low / valve) ** ((phase - 0.35) / 0.65))


def ventricle(phase: np.ndarray, peak: np.ndarray, late: np.ndarray) -> np.ndarray:
    """Ventricular pressure; `late` lengthens ejection [beats]."""
    end = 0.4 + late
    return peak * _bump(2.0 * (phase - 0.0692) / (end - 0.0692) - 1.0, 0.3)


class TruthCircuit:
    """The lanes, their parameters, and the rate of change of the states of one layer."""

    def __init__(self, lanes: Lanes):
        """Take lanes as arrays: settings, patient values and one size per effect (0: absent)."""
        self.v = lanes
        self.n = lanes["period"].size
        e = lanes["sizes"]
        s, a, d = lanes["stress"], lanes["adenosine"], lanes["dobutamine"]

        def size(name: str) -> np.ndarray:
            return e.get(name, np.zeros(self.n))

        self.size = size
        dilated = np.exp(-s * size("vasodilation") - a * size("adenosine_vasodilation"))
        outer = s * size("r1_r3_dilation")
        alpha = lanes["alpha"] * dilated
        self.R_1 = _R_1 * alpha * 2.0 ** (-0.8 * outer)
        self.R_2 = _R_2 * alpha * (1.0 - 0.5 * s)
        self.R_3 = _R_3 * alpha * 2.0 ** (-outer)
        stiff = np.exp(s * size("stress_compliance")) * (1.0 + s)
        self.C_a = _C_A * lanes["C_a"] * stiff
        self.C_im = _C_IM * lanes["C_im"] * stiff
        self.C_0 = _C_0 * lanes["C0"]
        self.R_0 = lanes["R0"] * np.exp(size("proximal_resistance"))
        self.R_0 = self.R_0 * np.exp(s * size("stress_narrowing"))
        self.L = size("inertance")
        self.has_L = self.L > 0.0
        self.K = size("quadratic_loss")
        self.curved = np.flatnonzero(self.K > 0.0)
        tau = size("wall_viscoelasticity")
        self.viscous = tau > 0.0
        self.tau = np.where(self.viscous, tau / 0.7, 1.0)
        self.G = size("collateral_flow") / (_R_1 + _R_2 + _R_3) / alpha
        self.squeeze = size("intramyocardial_pump") + d * size("dobutamine_inotropy")
        self.late = size("long_ejection")
        self.mean_2 = np.full(self.n, 70.0)

    def inlet(self, phase: np.ndarray) -> np.ndarray:
        """True aortic pressure."""
        notch = np.exp(-0.5 * ((phase - 0.405) / 0.036) ** 2)
        under = np.exp(-0.5 * ((phase - 0.345) / 0.025) ** 2)
        extra = self.size("aortic_waveform") * (notch - 0.25 * under)
        return aortic(phase, self.v["P_systolic"], self.v["P_diastolic"]) + extra

    def muscle(self, phase: np.ndarray) -> np.ndarray:
        """True pressure of the muscle on its vessels."""
        plain = ventricle(phase, self.v["P_systolic"], self.late)
        fuller = self.v["P_systolic"] * _bump((phase - 0.235) / 0.17, 0.45)
        suction = self.size("diastolic_suction") * _bump((phase - 0.48) / 0.08, 1.0)
        return plain + self.squeeze * (0.7 * plain + 0.3 * fuller) - suction

    def flow(
        self, phase: np.ndarray, P_in: np.ndarray, P_0: np.ndarray, Q_L: np.ndarray
    ) -> np.ndarray:
        """Flow into the ostium at a phase of the beat; an ostium that varies in time needs it."""
        u = self.size("dynamic_narrowing") * (P_in - 80.0) / 80.0
        area = 1.0 - 0.5 * np.tanh(u / 0.8)
        R = self.R_0 * area**-1.6
        collapse = self.size("threshold_collapse")
        R = R * (1.0 + collapse / (1.0 + np.exp(np.clip((P_0 - 55.0) / 2.0, -50, 50))))
        slow = 1.0 / (1.0 + np.abs(P_in - P_0) / (0.7 * self.R_0))
        R = R * (1.0 + self.size("shear_thinning") * slow)
        Q = np.where(self.has_L, Q_L, (P_in - P_0) / R)
        at = self.curved
        if at.size:
            drop, R_at, K = (P_in - P_0)[at], R[at], self.K[at]
            q = np.abs(drop) / (R_at + K * np.sqrt(np.abs(drop) / K + 1e-12))
            for _ in range(4):
                power = K * (q + 1e-12) ** 0.85
                q = np.maximum(q - (R_at * q + power * q - np.abs(drop)) / (R_at + 1.85 * power), 0)
            # beside an inertance the flow is a state, and the loss is a part of what slows it
            inert = self.has_L[at]
            R[at] += np.where(inert, K * np.abs(Q_L[at]) ** 0.85, 0.0)
            Q[at] = np.where(inert, Q_L[at], np.sign(drop) * q)
        self.R_seen = R
        return Q

    def bed(self, phase: np.ndarray, P_2: np.ndarray) -> tuple[np.ndarray, ...]:
        """R_2, pressure behind R_3, compliance C_a, and pressure of the muscle, at an instant."""
        P_m = self.muscle(phase)
        gain = np.tanh(1.5 * (self.mean_2 - 70.0) / 70.0) / 1.5
        R_2 = self.R_2 * np.exp(self.size("autoregulation") * gain)
        R_2 = R_2 * (1.0 + self.size("systolic_resistance") * _bump((phase - 0.22) / 0.2, 1.0))
        back = self.size("back_pressure") * (1.0 + 0.3 * np.sin(2.0 * np.pi * phase))
        back = np.maximum(back, self.size("waterfall") * P_m)
        C_a = self.C_a * np.exp(-self.size("stiffening_wall") * (P_2 - 70.0) / 70.0)
        return R_2, back, C_a, P_m

    def wall(self, C_a: np.ndarray, P_2: np.ndarray, V_b: np.ndarray) -> tuple[np.ndarray, ...]:
        """Flow into the wall's viscous branch, and the compliance that is left elastic."""
        into = np.where(self.viscous, (P_2 - V_b / (0.7 * C_a)) * 0.7 * C_a / self.tau, 0.0)
        return into, np.where(self.viscous, 0.3, 1.0) * C_a

    def accelerated(self, P_in: np.ndarray, P_0: np.ndarray, Q_L: np.ndarray) -> np.ndarray:
        """Rate of change of the flow through an ostium with inertance."""
        rate = (P_in - P_0 - self.R_seen * Q_L) / np.maximum(self.L, 1e-3)
        return np.where(self.has_L, rate, 0.0)

    def rate(self, phase: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rate of change of P_0, P_2, Q_L, branch volume, y; and the flow."""
        P_0, P_2, Q_L, V_b, y = x
        P_in = self.inlet(phase)
        Q = self.flow(phase, P_in, P_0, Q_L)
        R_2, back, C_a, P_m = self.bed(phase, P_2)
        into_branch, elastic = self.wall(C_a, P_2, V_b)
        P_3 = y + P_m
        through = (P_2 - P_3) / R_2
        arriving = (P_0 - P_2) / self.R_1 + self.G * (P_in - P_2)
        return np.stack(
            [
                (Q - (P_0 - P_2) / self.R_1) / self.C_0,
                (arriving - through - into_branch) / elastic,
                self.accelerated(P_in, P_0, Q_L),
                into_branch,
                (through - (P_3 - back) / self.R_3) / self.C_im,
            ]
        ), Q

    def start(self) -> np.ndarray:
        """First states, of size in the order of `rate`."""
        mean = 0.6 * self.v["P_diastolic"] + 0.4 * self.v["P_systolic"]
        V_b = np.where(self.viscous, 0.7 * self.C_a * 0.8 * mean, 0.0)
        return np.stack([0.9 * mean, 0.8 * mean, np.zeros(self.n), V_b, 0.5 * mean])


def march(system: Any, plain: TruthCircuit) -> dict[str, np.ndarray]:
    """Samples of the last beat: true aortic and distal pressure, and flow.

    Args:
        system: has `start` and `rate`; states begin with P_0 and P_2.
        plain: the lanes' parameters, which the system shares.
    """
    x = system.start()
    h, one = plain.v["period"] / STEPS, np.ones(plain.n)
    at = np.round(np.arange(SAMPLED) * STEPS / SAMPLED).astype(int)
    wanted = frozenset(at.tolist())
    kept: dict[int, tuple[np.ndarray, np.ndarray]] = {}
    for beat in range(BEATS):
        total = np.zeros(plain.n)
        for k in range(STEPS):
            p = k / STEPS * one
            k1, Q = system.rate(p, x)
            if beat == BEATS - 1 and k in wanted:
                kept[k] = (x[0].copy(), Q.copy())
            total += x[1]
            half = p + 0.5 / STEPS
            k2, _ = system.rate(half, x + 0.5 * h * k1)
            k3, _ = system.rate(half, x + 0.5 * h * k2)
            k4, _ = system.rate(p + 1.0 / STEPS, x + h * k3)
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        plain.mean_2 = total / STEPS
    P_in = np.stack([plain.inlet(k / STEPS * one) for k in at], axis=-1)
    P_0, Q = (np.stack([kept[k][part] for k in at], axis=-1) for part in (0, 1))
    if not (np.isfinite(P_0).all() and np.isfinite(Q).all()):
        raise RuntimeError("The march went unstable: raise STEPS.")
    return {"P_aorta": P_in, "P_distal": P_0, "Q": Q}


def one_layer(lanes: Lanes) -> dict[str, np.ndarray]:
    """Tier 1: the topology of the diagnosis, other equations."""
    plain = TruthCircuit(lanes)
    return march(plain, plain)
