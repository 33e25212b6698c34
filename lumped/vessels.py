"""0D vessels: elements with an inlet and an outlet port.

A compliance or inertance that is `None` is not there: its state disappears, so that the vector
field never divides by zero. An array of zeros is refused for the same reason.
"""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from lumped.elements import AbstractElement
from lumped.parameters import Parameter, Range, check_range, optional_parameter, parameter, real

Ports = Float[Array, " 2"]


def quadratic_drop(R: Parameter, K: Parameter | None, Q: Array) -> Array:
    """Pressure drop R Q + K Q |Q| [dyn/cm²] (Young & Tsai 1973, J Biomech 6:395)."""
    return R * Q if K is None else R * Q + K * Q * jnp.abs(Q)


class Vessel(AbstractElement):
    """A vessel segment: resistance, then compliance, then inertance.

    Circuit: inlet ── R_viscous, K_stenosis ──┬── L ── outlet
                                              C
                                              ⏚

    Equations (P_c: pressure at the compliance, Q_L: flow through the inertance):

        P_in − P_c = R_viscous Q_in + K_stenosis Q_in |Q_in|
        C dP_c/dt  = Q_in − Q_out
        L dQ_L/dt  = P_c − P_out,   Q_out = Q_L

    Without C: Q_in = Q_out. Without L: P_out = P_c.

    Input file (svZeroDSolver): ``{"zero_d_element_type": "BloodVessel", "zero_d_element_values":
    {"R_poiseuille": R_viscous, "C": C, "L": L, "stenosis_coefficient": K_stenosis}}``

    Internal states: P_c [dyn/cm²] where C is given, Q_L [cm³/s] where L is given.

    Source: Milišić & Quarteroni 2004 (M2AN 38:613); Young & Tsai 1973 for the quadratic loss.

    Attributes:
        R_viscous: viscous resistance [dyn·s/cm⁵], zero or positive.
        C: compliance [cm⁵/dyn] or None.
        L: inertance [dyn·s²/cm⁵] or None.
        K_stenosis: quadratic loss [dyn·s²/cm⁸] or None; fits to measured flow give it either sign.
    """

    n_ports: ClassVar[int] = 2
    R_viscous: Parameter = parameter()
    C: Parameter | None = optional_parameter()
    L: Parameter | None = optional_parameter()
    K_stenosis: Parameter | None = optional_parameter()

    ranges: ClassVar[Range] = Range(above=("C", "L"), least=("R_viscous",), finite=("K_stenosis",))

    def __check_init__(self):
        check_range(self)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Internal states, in order."""
        return _state_names(self.C, self.L)

    @property
    def is_linear(self) -> bool:
        """Whether there is no quadratic loss."""
        return self.K_stenosis is None

    def mass(self) -> Float[Array, " n"]:
        """Compliance and inertance, where given."""
        return _mass(self.C, self.L)

    def rate(self, t: Parameter, x: Float[Array, " n"], P: Ports, Q: Ports) -> Float[Array, " n"]:
        """Net flow into the compliance, pressure across the inertance."""
        P_c = x[0] if self.C is not None else self._proximal_pressure(P, Q)
        rows = [] if self.C is None else [Q[0] + Q[1]]
        rows += [] if self.L is None else [P_c - P[1]]
        return jnp.stack(rows) if rows else jnp.zeros(0)

    def closure(self, t: Parameter, x: Float[Array, " n"], P: Ports, Q: Ports) -> Ports:
        """Pressure drop of the resistance; continuity at the outlet."""
        P_c = x[0] if self.C is not None else self._proximal_pressure(P, Q)
        if self.C is not None:
            inlet = P[0] - P_c - quadratic_drop(self.R_viscous, self.K_stenosis, Q[0])
        else:
            inlet = Q[0] + Q[1]
        outlet = Q[1] + x[-1] if self.L is not None else P_c - P[1]
        return jnp.stack([inlet, outlet])

    def _proximal_pressure(self, P: Ports, Q: Ports) -> Array:
        return P[0] - quadratic_drop(self.R_viscous, self.K_stenosis, Q[0])

    def external_pressure(self, t: Parameter) -> Float[Array, " n"]:
        """Nothing outside."""
        return jnp.zeros(len(self.state_names))


class VesselCRL(AbstractElement):
    """A vessel segment with its compliance at the inlet: compliance, resistance, inertance.

    Circuit: inlet ──┬── R_viscous, K_stenosis ── L ── outlet
                     C
                     ⏚

    Equations:

        C dP_c/dt = Q_in − Q_out,   P_c = P_in
        L dQ_L/dt = P_c − P_out − R_viscous Q_out − K_stenosis Q_out |Q_out|,   Q_out = Q_L

    A pressure source at the inlet fixes P_c (index 2): such a network has periodic states and
    implicit steps, but no vector field.

    Input file (svZeroDSolver): as `Vessel`, with ``"zero_d_element_type": "BloodVesselCRL"``.

    Internal states: P_c [dyn/cm²] where C is given, Q_L [cm³/s] where L is given.

    Attributes:
        R_viscous: viscous resistance [dyn·s/cm⁵], zero or positive.
        C: compliance [cm⁵/dyn] or None.
        L: inertance [dyn·s²/cm⁵] or None.
        K_stenosis: quadratic loss [dyn·s²/cm⁸] or None; fits to measured flow give it either sign.
    """

    n_ports: ClassVar[int] = 2
    R_viscous: Parameter = parameter()
    C: Parameter | None = optional_parameter()
    L: Parameter | None = optional_parameter()
    K_stenosis: Parameter | None = optional_parameter()

    ranges: ClassVar[Range] = Range(above=("C", "L"), least=("R_viscous",), finite=("K_stenosis",))

    def __check_init__(self):
        check_range(self)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Internal states, in order."""
        return _state_names(self.C, self.L)

    @property
    def is_linear(self) -> bool:
        """Whether there is no quadratic loss."""
        return self.K_stenosis is None

    def mass(self) -> Float[Array, " n"]:
        """Compliance and inertance, where given."""
        return _mass(self.C, self.L)

    def rate(self, t: Parameter, x: Float[Array, " n"], P: Ports, Q: Ports) -> Float[Array, " n"]:
        """Net flow into the compliance, pressure across the inertance."""
        rows = [] if self.C is None else [Q[0] + Q[1]]
        rows += [] if self.L is None else [self._driving_pressure(P, Q)]
        return jnp.stack(rows) if rows else jnp.zeros(0)

    def closure(self, t: Parameter, x: Float[Array, " n"], P: Ports, Q: Ports) -> Ports:
        """Continuity at the inlet; pressure drop or continuity at the outlet."""
        inlet = P[0] - x[0] if self.C is not None else Q[0] + Q[1]
        outlet = Q[1] + x[-1] if self.L is not None else self._driving_pressure(P, Q)
        return jnp.stack([inlet, outlet])

    def _driving_pressure(self, P: Ports, Q: Ports) -> Array:
        return P[0] - P[1] - quadratic_drop(self.R_viscous, self.K_stenosis, -Q[1])

    def external_pressure(self, t: Parameter) -> Float[Array, " n"]:
        """Nothing outside."""
        return jnp.zeros(len(self.state_names))


def _state_names(C: Parameter | None, L: Parameter | None) -> tuple[str, ...]:
    return (() if C is None else ("P_c",)) + (() if L is None else ("Q_L",))


def _mass(C: Parameter | None, L: Parameter | None) -> Array:
    values = [real(value) for value in (C, L) if value is not None]
    return jnp.stack(values) if values else jnp.zeros(0)
