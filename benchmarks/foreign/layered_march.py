"""Integrates the layered bed: second-order backward differences, all members side by side.

Each store of volume and each inertance becomes a conductance and a source over one step (a
companion model), with the laws taken at states extrapolated from the last two steps. The circuit
is a tree, so that one step is an elimination from the layers to the aorta. Regular beats run until
they repeat, first in coarse steps.
"""

import dataclasses
from collections.abc import Callable

import numpy as np

from benchmarks.foreign.layered_bed import LayerParameters, filled

COARSE, COARSE_BEATS = 80, 14
"""Steps a beat of the lead-in, and its beats."""

MOST_BEATS = 24
"""Beats in fine steps after which a record counts as not periodic."""

REPEATS_MMHG = 0.004
"""Largest change of the distal pressure from beat to beat of a periodic record."""

ROUGHLY_MMHG = 0.02
"""The same of the lead-in in coarse steps."""

WILD_MMHG = 2000.0
"""Pressure above which an integration counts as lost."""


@dataclasses.dataclass
class Elements:
    """Values of the elements at one step, shapes (members,) or (layers, members).

    Attributes:
        R0, R1, R2, R3: resistances [mmHg·s/mL].
        Pv: pressure behind each R3 [mmHg].
        E0, E1: pressure that drives the flow through R0 and R1 besides the nodes' [mmHg].
        g_A, j_A, g_M, j_M: conductance to zero [mL/(mmHg·s)] and inflow [mL/s] at A and M.
    """

    R0: np.ndarray
    R1: np.ndarray
    R2: np.ndarray
    R3: np.ndarray
    Pv: np.ndarray
    E0: np.ndarray | float = 0.0
    E1: np.ndarray | float = 0.0
    g_A: np.ndarray | float = 0.0
    j_A: np.ndarray | float = 0.0
    g_M: np.ndarray | float = 0.0
    j_M: np.ndarray | float = 0.0


@dataclasses.dataclass
class Moment:
    """States at one step, extrapolated from the last two.

    Attributes:
        phase: of the beat.
        P_ao, P_lv: aortic pressure and pressure in the ventricle, now [mmHg].
        Q: flow through the proximal vessel [mL/s].
        P_D, P_A, P_M: pressures of the nodes [mmHg].
    """

    phase: float
    P_ao: np.ndarray
    P_lv: np.ndarray
    Q: np.ndarray
    P_D: np.ndarray
    P_A: np.ndarray
    P_M: np.ndarray


def add_quadratic(e: Elements, which: str, k: np.ndarray | float, Q: np.ndarray) -> None:
    """Add a pressure loss k Q |Q| to R0 ("0") or R1 ("1"), linear around the extrapolated flow.

    Args:
        e: elements of the step.
        which: "0" or "1".
        k: coefficient [mmHg·s²/mL²].
        Q: extrapolated flow [mL/s].
    """
    R, E = f"R{which}", f"E{which}"
    setattr(e, R, getattr(e, R) + 2.0 * k * np.abs(Q))
    setattr(e, E, getattr(e, E) + k * Q * np.abs(Q))


Law = Callable[[Elements, Moment, LayerParameters], None]
"""Changes the elements of a step."""

Tone = Callable[[LayerParameters, np.ndarray, np.ndarray], np.ndarray]
"""(elements, mean P_A, mean P_M) → factors of R2, shape (layers, members), over many beats."""

Drive = Callable[[np.ndarray, int], tuple[np.ndarray, np.ndarray]]
"""(phases, beat) → aortic and ventricular pressure, shapes (phases, members); −1: mean beat."""


@dataclasses.dataclass
class LayeredState:
    """Volumes, flows and node pressures of the last two steps."""

    V: np.ndarray
    I: np.ndarray  # noqa: E741
    x: np.ndarray
    V_old: np.ndarray
    I_old: np.ndarray
    x_old: np.ndarray

    def restart(self) -> None:
        """Forget the step before the last, where the step changes."""
        self.V_old, self.I_old, self.x_old = self.V.copy(), self.I.copy(), self.x.copy()


class LayeredCircuit:
    """The circuit of several members under one law.

    Args:
        p: elements of the members, stacked along the last axis.
        period: of each member [s].
        drive: pressures of a beat.
        law: what an effect does to the elements at every step.
        tone: what an effect does to the arterioles over many beats.
    """

    def __init__(
        self,
        p: LayerParameters,
        period: np.ndarray,
        drive: Drive,
        law: Law | None = None,
        tone: Tone | None = None,
    ):
        self.p, self.period, self.drive, self.law, self.tone = p, period, drive, law, tone
        self.factor = np.ones_like(p["R2"])
        self.fills = bool(np.any(p["power"]))
        self.mean_beats: dict[int, tuple[np.ndarray, np.ndarray]] = {}

    def start(self) -> LayeredState:
        """Steady state under the mean pressures."""
        p = self.p
        P_ao, P_lv = (part.mean(axis=0) for part in self.drive(np.arange(200) / 200, -1))
        chain = p["R2"] + p["R3"]
        g = (1.0 / chain).sum(axis=0)
        P_A = P_ao / (1.0 + (p["R0"] + p["R1"]) * g)
        Q = P_A * g
        P_D = P_A + p["R1"] * Q
        P_M = P_A * p["R3"] / chain
        P = np.concatenate([np.stack([P_D, P_D, P_A, P_A]), P_M - p["squeeze"] * P_lv])
        V, I = p["C"] * P, np.stack([Q, Q])  # noqa: E741
        x = np.concatenate([np.stack([Q, P_D, P_A]), P_M])
        return LayeredState(V, I, x, V.copy(), I.copy(), x.copy())

    def beat(self, s: LayeredState, number: int, steps: int) -> np.ndarray:
        """March one beat.

        Args:
            s: state at its start; becomes that at its end.
            number: of the beat, −1 for the mean beat.
            steps: in the beat.

        Returns:
            aortic pressure, Q, P_D, P_A and P_M after each step, shape (steps, 4 + layers,
            members).
        """
        phases = np.arange(1, steps + 1) / steps
        if number >= 0:
            P_ao, P_lv = self.drive(phases, number)
        else:
            if steps not in self.mean_beats:
                self.mean_beats[steps] = self.drive(phases, number)
            P_ao, P_lv = self.mean_beats[steps]
        b = 2.0 * self.period / steps / 3.0
        p = self.p
        under = 1.0 / (b + p["eta"] * p["C"])
        fixed = (b, under, p["C"] * under, 1.0 / np.where(p["C"] > 0.0, p["C"], 1.0)[4:])
        out = np.empty((steps, s.x.shape[0] + 1, self.period.size))
        for k in range(steps):
            self._step(s, float(phases[k]), P_ao[k], P_lv[k], fixed)
            out[k, 0], out[k, 1:] = P_ao[k], s.x
        if not np.abs(s.x).max() < WILD_MMHG:
            raise RuntimeError("The layered bed lost its solution. Draw a smaller effect.")
        return out

    def elements(self, s: LayeredState, phase: float, P_ao, P_lv, over_C) -> Elements:
        """Values of the elements at the extrapolated state of the coming step."""
        p = self.p
        R2, R3 = p["R2"] * self.factor, p["R3"]
        if self.fills:
            P_tm = (2.0 * s.V[4:] - s.V_old[4:]) * over_C
            volume = filled(P_tm, p)
            R2 = R2 * volume ** -p["power"][0]
            R3 = R3 * volume ** -p["power"][1]
        e = Elements(p["R0"], p["R1"], R2, R3, p["Pv"])
        if self.law is not None:
            x = 2.0 * s.x - s.x_old
            self.law(e, Moment(phase, P_ao, P_lv, x[0], x[1], x[2], x[3:]), p)
        return e

    def _step(self, s: LayeredState, phase: float, P_ao, P_lv, fixed) -> None:
        b, under, Y, over_C = fixed
        p = self.p
        e = self.elements(s, phase, P_ao, P_lv, over_C)
        V_h, I_h = (4.0 * s.V - s.V_old) / 3.0, (4.0 * s.I - s.I_old) / 3.0
        J = V_h * under
        P_ext = p["squeeze"] * P_lv
        g2, g3 = 1.0 / e.R2, 1.0 / e.R3
        Y_M = Y[4:]
        below = 1.0 / (g2 + g3 + Y_M + e.g_M)
        held = (g3 * e.Pv + Y_M * P_ext + J[4:] + e.j_M) * below
        into = g2 * below
        # inertances: a resistance and a source over the step
        x0, x1 = p["L0"] / (b + p["L0"] * p["Y0"]), p["L1"] / b
        g0, g1 = 1.0 / (e.R0 + x0), 1.0 / (e.R1 + x1)
        s0, s1 = g0 * (x0 * I_h[0] + e.E0), g1 * (x1 * I_h[1] + e.E1)
        A_own = (g2 - g2 * into).sum(axis=0) + Y[2] + Y[3] + e.g_A + g1
        A_held = ((g2 * held).sum(axis=0) + J[2] + J[3] + e.j_A + s1) / A_own
        A_into = g1 / A_own
        D_own = g0 + Y[0] + Y[1] + g1 - g1 * A_into
        P_D = (g0 * P_ao + s0 + J[0] + J[1] + g1 * A_held - s1) / D_own
        P_A = A_held + A_into * P_D
        P_M = held + into * P_A
        Q, Q1 = g0 * (P_ao - P_D) + s0, g1 * (P_D - P_A) + s1
        s.V_old, s.I_old, s.x_old = s.V, s.I, s.x
        P = np.concatenate([(P_D, P_D, P_A, P_A), P_M - P_ext])
        s.V = V_h + b * (Y * P - J)
        share = b / (b + p["L0"] * p["Y0"])
        s.I = np.array([I_h[0] + share * (Q - I_h[0]), Q1])
        s.x = np.concatenate([(Q, P_D, P_A), P_M])

    def settle(self, steps: int) -> tuple[LayeredState, np.ndarray]:
        """Run the mean beat until it repeats.

        Args:
            steps: in a beat.

        Returns:
            the state at its start, and the beat as `beat` returns it.

        Raises:
            RuntimeError: it does not repeat, or the solution is lost.
        """
        s = self.start()
        last = self.beat(s, -1, COARSE)
        for k in range(COARSE_BEATS):
            self._adapt(last, 0.6 if k > 0 else 0.0)
            now = self.beat(s, -1, COARSE)
            change, last = np.abs(now[:, 2] - last[:, 2]).max(), now
            if change < ROUGHLY_MMHG and k > 1:
                break
        s.restart()
        last = self.beat(s, -1, steps)
        for _ in range(MOST_BEATS):
            self._adapt(last, 0.7)
            now = self.beat(s, -1, steps)
            if np.abs(now[:, 2] - last[:, 2]).max() < REPEATS_MMHG:
                return s, now
            last = now
        raise RuntimeError("The layered bed does not become periodic. Draw a smaller effect.")

    def _adapt(self, beat: np.ndarray, share: float) -> None:
        """Move the arterioles towards the tone that the mean pressures of a beat ask for."""
        if self.tone is not None and share > 0.0:
            means = beat.mean(axis=0)
            wanted = self.tone(self.p, means[3], means[4:])
            self.factor = self.factor * (wanted / self.factor) ** share
