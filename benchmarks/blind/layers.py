"""Tier 2: another topology than the diagnosis has; two layers of muscle and a side branch.

    P_in ─ ostium ─ P_0 ─┬─ R_1 ─┬─ P_2 ─┬─ R_2/w ─┬─ R_3/v ─ back      (inner layer, P_m · 1.25)
                        C_0     C_a     │       C_im/2
                         │              └─ R_2/(1−w) ─┬─ R_3/(1−v) ─ back  (outer, P_m · 0.6)
                         └─ R_b ─┬─ R_out ─ back     C_im/2
                                C_b

The inner layer is squeezed harder and has the larger share of the conductance (w = 0.6 of R_2,
v = 0.5 of R_3); the branch takes about a sixth of the flow and lies outside the muscle.
Sources: pressure falls from the cavity's at the inner wall to nearly none outside (Hoffman & Spaan
1990, Physiol Rev 70:331); the shares are assumed.
"""

import numpy as np

from benchmarks.blind.truth import Lanes, TruthCircuit, march

SQUEEZE = (1.25, 0.6)
"""Pressure on the vessels of inner and outer layer over that of one layer."""

SHARES_2, SHARES_3 = (0.6, 0.4), (0.5, 0.5)
"""Shares of the layers in the conductances 1/R_2 and 1/R_3."""

BRANCH, BRANCH_NEAR = 5.0, 0.15
"""Resistance of the branch over R_1 + R_2 + R_3, and the share of it before its compliance."""


class Layered:
    """The lanes' parameters in the other topology, and the rate of change of the states."""

    def __init__(self, plain: TruthCircuit):
        """Take the parameters of one layer."""
        self.plain = plain
        whole = BRANCH * (plain.R_1 + plain.R_2 + plain.R_3)
        self.R_near, self.R_out = BRANCH_NEAR * whole, (1.0 - BRANCH_NEAR) * whole
        self.C_b = 0.2 * plain.C_a

    def rate(self, phase: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rate of change of P_0, P_2, Q_L, branch volume, P_b, y of both layers; and the flow."""
        c = self.plain
        P_0, P_2, Q_L, V_b, P_b = x[:5]
        P_in = c.inlet(phase)
        Q = c.flow(phase, P_in, P_0, Q_L)
        R_2, back, C_a, P_m = c.bed(phase, P_2)
        into_wall, elastic = c.wall(C_a, P_2, V_b)
        through, rates = np.zeros(c.n), []
        for y, squeeze, w, v in zip(x[5:], SQUEEZE, SHARES_2, SHARES_3, strict=True):
            P_3 = y + squeeze * P_m
            into = w * (P_2 - P_3) / R_2
            through = through + into
            rates.append((into - v * (P_3 - back) / c.R_3) / (0.5 * c.C_im))
        arriving = (P_0 - P_2) / c.R_1 + c.G * (P_in - P_2)
        aside = (P_0 - P_b) / self.R_near
        return np.stack(
            [
                (Q - (P_0 - P_2) / c.R_1 - aside) / c.C_0,
                (arriving - through - into_wall) / elastic,
                c.accelerated(P_in, P_0, Q_L),
                into_wall,
                (aside - (P_b - back) / self.R_out) / self.C_b,
                *rates,
            ]
        ), Q

    def start(self) -> np.ndarray:
        """First states."""
        x = self.plain.start()
        return np.stack([*x[:4], 0.8 * x[0], x[4], x[4]])


def two_layers(lanes: Lanes) -> dict[str, np.ndarray]:
    """Tier 2: samples of the last beat, see `truth.march`."""
    plain = TruthCircuit(lanes)
    return march(Layered(plain), plain)
