"""Five-element coronary bed extended by collateral and bypass flow and a viscoelastic wall."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from lumped.elements import AbstractElement
from lumped.parameters import Parameter, Range, check_range, optional_parameter, parameter, real
from lumped.waveforms import AbstractWaveform

Port = Float[Array, " 1"]


class ExtendedCoronary(AbstractElement):
    """Five-element coronary bed with collateral and bypass flow and an optional viscoelastic wall.

    Circuit: port ── R_1 ──┬── R_2 ──┬── R_3 ── P_venous
                           │        C_im
             P_source ─ G ─┤         ⏚  P_im(t)
           P_venous ─ G_p ─┤
                          C_a (wall_time)
                           ⏚

    Equations (y = P̃ − P_im; w: volume of C_a over C_a; P_b: pressure
    of its delayed part):

        C_a  dw/dt = Q + G (P_source − P_a) − G_p (P_a − P_venous) − (P_a − P̃)/R_2
        C_im dy/dt = (P_a − P̃)/R_2 − (P̃ − P_venous)/R_3
        wall_time dP_b/dt = P_a − P_b,    w = e P_a + (1 − e) P_b
        P = P_a + R_1 Q

    In harmonics the wall is iωC_a (e + (1 − e)/(1 + iω wall_time)), a standard linear solid.
    Without `wall_time` P_a = w, and with G = G_p = 0 as well this is `Coronary`.

    Twins: `lumped.blocks.Coronary` without the extensions, and `diagnosis.circuit.solve` in the
    frequency domain. `tests/diagnosis/test_boundary.py` compares it with the latter.

    Internal states: w, y [dyn/cm²], and P_b [dyn/cm²] where `wall_time` is given.

    Source: as `Coronary`; the wall as Alastruey et al. 2011 (J Biomech 44:2250), here with a share
    that responds at once.

    Attributes:
        R_1, R_2, R_3: arterial, microvascular and venous resistance [dyn·s/cm⁵].
        C_a: arterial compliance at rest [cm⁵/dyn].
        C_im: intramyocardial compliance [cm⁵/dyn].
        P_im: intramyocardial pressure [dyn/cm²] as a function of time.
        P_source: pressure where collaterals begin [dyn/cm²] as a function of time.
        P_venous: pressure behind R_3 [dyn/cm²].
        G_collateral: conductance of the collaterals [cm⁵/(dyn·s)].
        G_bypass: conductance G_p of vessels outside the muscle [cm⁵/(dyn·s)]; a negative value
            reduces the flow through R_2 and R_3.
        elastic_share: share e of C_a that responds at once [-].
        wall_time: relaxation time of the rest [s], or None.
    """

    n_ports: ClassVar[int] = 1
    P_im: AbstractWaveform
    P_source: AbstractWaveform
    R_1: Parameter = parameter()
    R_2: Parameter = parameter()
    R_3: Parameter = parameter()
    C_a: Parameter = parameter()
    C_im: Parameter = parameter()
    P_venous: Parameter = parameter(default=0.0)
    G_collateral: Parameter = parameter(default=0.0)
    G_bypass: Parameter = parameter(default=0.0)
    elastic_share: Parameter = parameter(default=1.0)
    wall_time: Parameter | None = optional_parameter()

    ranges: ClassVar[Range] = Range(
        above=("R_2", "R_3", "C_a", "C_im", "elastic_share", "wall_time"),
        least=("R_1", "G_collateral"),
        finite=("P_venous", "G_bypass"),
    )

    def __check_init__(self):
        check_range(self)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Internal states, in order."""
        return ("w", "y_im") if self.wall_time is None else ("w", "y_im", "P_b")

    @property
    def is_linear(self) -> bool:
        """True: rates and closure are linear."""
        return True

    def mass(self) -> Float[Array, " n"]:
        """Capacitances, and the relaxation time of the wall."""
        late = [] if self.wall_time is None else [self.wall_time]
        return jnp.stack([self.C_a, self.C_im, *late])

    def _arterial(self, x: Float[Array, " n"]) -> Array:
        """P_a [dyn/cm²]."""
        if self.wall_time is None:
            return x[0]
        return (x[0] - (1.0 - self.elastic_share) * x[2]) / self.elastic_share

    def rate(self, t: Parameter, x: Float[Array, " n"], P: Port, Q: Port) -> Float[Array, " n"]:
        """Net flow into each capacitance; pressure across the delayed part of the wall."""
        P_a, P_tilde = self._arterial(x), x[1] + self.P_im(t)
        through = (P_a - P_tilde) / self.R_2
        arriving = Q[0] + self.G_collateral * (self.P_source(t) - P_a)
        arriving = arriving - self.G_bypass * (P_a - self.P_venous)
        late = [] if self.wall_time is None else [P_a - x[2]]
        leaving = (P_tilde - self.P_venous) / self.R_3
        return jnp.stack([arriving - through, through - leaving, *late])

    def closure(self, t: Parameter, x: Float[Array, " n"], P: Port, Q: Port) -> Port:
        """Pressure balance of the port."""
        return P - self._arterial(x)[None] - self.R_1 * Q

    def external_pressure(self, t: Parameter) -> Float[Array, " n"]:
        """Pressure outside the walls of the states."""
        zero = jnp.zeros(())
        outside = [zero, real(self.P_im(t)), zero]
        return jnp.stack(outside[: len(self.state_names)])
