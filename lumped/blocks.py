"""Boundary blocks: 0D models of the circulation downstream of a port.

Every block is one element with one port. P is the pressure at the port, Q the flow into the
block; P_ref is the pressure behind the last resistance. All numbers are differentiated array
leaves in CGS units; nothing but the names is static.
"""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from lumped.elements import AbstractElement
from lumped.parameters import Parameter, Range, check_range, parameter
from lumped.waveforms import AbstractWaveform

Port = Float[Array, " 1"]


class Resistance(AbstractElement):
    """A resistance to a reference pressure.

    Circuit: port ── R ── P_ref

    Equation: P = P_ref + R Q.

    Input file (svZeroDSolver): ``{"bc_type": "RESISTANCE", "bc_values": {"R": 100, "Pd": 0}}``

    Internal states: none.

    Attributes:
        R: resistance [dyn·s/cm⁵], zero or positive.
        P_ref: reference pressure [dyn/cm²].
    """

    n_ports: ClassVar[int] = 1
    R: Parameter = parameter()
    P_ref: Parameter = parameter(default=0.0)

    ranges: ClassVar[Range] = Range(least=("R",), finite=("P_ref",))

    def __check_init__(self):
        check_range(self)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Internal states, in order."""
        return ()

    @property
    def is_linear(self) -> bool:
        """True: rates and closure are linear."""
        return True

    def mass(self) -> Float[Array, " 0"]:
        """Capacitances and inertances of the states."""
        return jnp.zeros(0)

    def rate(self, t: Parameter, x: Float[Array, " 0"], P: Port, Q: Port) -> Float[Array, " 0"]:
        """Net flow into each capacitance, pressure across each inertance."""
        return jnp.zeros(0)

    def closure(self, t: Parameter, x: Float[Array, " 0"], P: Port, Q: Port) -> Port:
        """Pressure balance of the port."""
        return P - self.P_ref - self.R * Q

    def external_pressure(self, t: Parameter) -> Float[Array, " 0"]:
        """Pressure outside the walls of the states."""
        return jnp.zeros(0)


class RC(AbstractElement):
    """Two-element Windkessel: a compliance beside a resistance.

    Circuit: port ──┬── R ── P_ref
                    C
                    ⏚

    Equations: C dP_wk/dt = Q − (P_wk − P_ref)/R,   P = P_wk.

    Internal states: P_wk [dyn/cm²]. It has no resistance between port and compliance: two of
    them on one node share a state and are refused by the vector field (merge them).

    Source: Frank 1899 (Z Biol 37:483).

    Attributes:
        R: resistance [dyn·s/cm⁵].
        C: compliance [cm⁵/dyn].
        P_ref: reference pressure [dyn/cm²].
    """

    n_ports: ClassVar[int] = 1
    R: Parameter = parameter()
    C: Parameter = parameter()
    P_ref: Parameter = parameter(default=0.0)

    ranges: ClassVar[Range] = Range(above=("R", "C"), finite=("P_ref",))

    def __check_init__(self):
        check_range(self)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Internal states, in order."""
        return ("P_wk",)

    @property
    def is_linear(self) -> bool:
        """True: rates and closure are linear."""
        return True

    def mass(self) -> Float[Array, " 1"]:
        """Capacitances and inertances of the states."""
        return jnp.stack([self.C])

    def rate(self, t: Parameter, x: Float[Array, " 1"], P: Port, Q: Port) -> Float[Array, " 1"]:
        """Net flow into each capacitance, pressure across each inertance."""
        return Q - (x - self.P_ref) / self.R

    def closure(self, t: Parameter, x: Float[Array, " 1"], P: Port, Q: Port) -> Port:
        """Pressure balance of the port."""
        return P - x

    def external_pressure(self, t: Parameter) -> Float[Array, " 1"]:
        """Pressure outside the walls of the states."""
        return jnp.zeros(1)


class RCR(AbstractElement):
    """Three-element Windkessel.

    Circuit: port ── R_proximal ──┬── R_distal ── P_ref
                                  C
                                  ⏚

    Equations:

        C dP_wk/dt = Q − (P_wk − P_ref)/R_distal,   P = P_wk + R_proximal Q.

    The method paper prints Q/R_c in the second; its unit asks for R_c Q.

    Input file (svZeroDSolver):
    ``{"bc_type": "RCR", "bc_values": {"Rp": 100, "C": 1e-4, "Rd": 1000, "Pd": 0}}``

    Internal states: P_wk [dyn/cm²], the pressure at the compliance.

    Source: Westerhof et al. 1971 (Med Biol Eng 9:35); Puelz et al. 2024.

    Attributes:
        R_proximal: characteristic resistance [dyn·s/cm⁵], zero or positive.
        C: compliance [cm⁵/dyn].
        R_distal: peripheral resistance [dyn·s/cm⁵].
        P_ref: pressure behind the periphery [dyn/cm²].
    """

    n_ports: ClassVar[int] = 1
    R_proximal: Parameter = parameter()
    C: Parameter = parameter()
    R_distal: Parameter = parameter()
    P_ref: Parameter = parameter(default=0.0)

    ranges: ClassVar[Range] = Range(
        above=("C", "R_distal"), least=("R_proximal",), finite=("P_ref",)
    )

    def __check_init__(self):
        check_range(self)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Internal states, in order."""
        return ("P_wk",)

    @property
    def is_linear(self) -> bool:
        """True: rates and closure are linear."""
        return True

    def mass(self) -> Float[Array, " 1"]:
        """Capacitances and inertances of the states."""
        return jnp.stack([self.C])

    def rate(self, t: Parameter, x: Float[Array, " 1"], P: Port, Q: Port) -> Float[Array, " 1"]:
        """Net flow into each capacitance, pressure across each inertance."""
        return Q - (x - self.P_ref) / self.R_distal

    def closure(self, t: Parameter, x: Float[Array, " 1"], P: Port, Q: Port) -> Port:
        """Pressure balance of the port."""
        return P - x - self.R_proximal * Q

    def external_pressure(self, t: Parameter) -> Float[Array, " 1"]:
        """Pressure outside the walls of the states."""
        return jnp.zeros(1)


class RCRL(AbstractElement):
    """Four-element Windkessel: an inertance beside the characteristic resistance.

    Circuit: port ──┬─ R_proximal ─┬──┬── R_distal ── P_ref
                    └────── L ─────┘  C
                                      ⏚

    Equations (Q_L: flow through the inertance):

        C dP_wk/dt = Q − (P_wk − P_ref)/R_distal
        L dQ_L/dt  = R_proximal (Q − Q_L)
        P = P_wk + R_proximal (Q − Q_L)

    At zero frequency the inertance carries all flow: the total resistance is R_distal.

    Internal states: P_wk [dyn/cm²], Q_L [cm³/s].

    Source: Stergiopulos, Westerhof & Westerhof 1999 (Am J Physiol 276:H81).

    Attributes:
        R_proximal: characteristic resistance [dyn·s/cm⁵].
        C: compliance [cm⁵/dyn].
        R_distal: peripheral resistance [dyn·s/cm⁵].
        L: total arterial inertance [dyn·s²/cm⁵].
        P_ref: pressure behind the periphery [dyn/cm²].
    """

    n_ports: ClassVar[int] = 1
    R_proximal: Parameter = parameter()
    C: Parameter = parameter()
    R_distal: Parameter = parameter()
    L: Parameter = parameter()
    P_ref: Parameter = parameter(default=0.0)

    ranges: ClassVar[Range] = Range(above=("R_proximal", "C", "R_distal", "L"), finite=("P_ref",))

    def __check_init__(self):
        check_range(self)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Internal states, in order."""
        return ("P_wk", "Q_L")

    @property
    def is_linear(self) -> bool:
        """True: rates and closure are linear."""
        return True

    def mass(self) -> Float[Array, " 2"]:
        """Capacitances and inertances of the states."""
        return jnp.stack([self.C, self.L])

    def rate(self, t: Parameter, x: Float[Array, " 2"], P: Port, Q: Port) -> Float[Array, " 2"]:
        """Net flow into each capacitance, pressure across each inertance."""
        charging = Q[0] - (x[0] - self.P_ref) / self.R_distal
        return jnp.stack([charging, self.R_proximal * (Q[0] - x[1])])

    def closure(self, t: Parameter, x: Float[Array, " 2"], P: Port, Q: Port) -> Port:
        """Pressure balance of the port."""
        return P - x[:1] - self.R_proximal * (Q - x[1:])

    def external_pressure(self, t: Parameter) -> Float[Array, " 2"]:
        """Pressure outside the walls of the states."""
        return jnp.zeros(2)


class Coronary(AbstractElement):
    """Five-element coronary bed, compressed by the heart muscle.

    Circuit: port ── R_1 ──┬── R_2 ──┬── R_3 ── P_venous
                          C_a       C_im
                           ⏚        P_im(t) · im_factor

    Equations (y = P̃ − im_factor P_im, the pressure across C_im):

        C_a  dP_a/dt = Q − (P_a − P̃)/R_2
        C_im dy/dt   = (P_a − P̃)/R_2 − (P̃ − P_venous)/R_3
        P = P_a + R_1 Q

    With y as state the derivative of P_im never appears: a jump of P_im is harmless, and C_im y is
    the blood volume that a change of C_im conserves. The method paper prints Q/R_1 in the last
    line; its unit asks for R_1 Q.

    Input file (svZeroDSolver): ``{"bc_type": "CORONARY", "bc_values": {"Ra1": R_1, "Ra2": R_2,
    "Rv1": R_3, "Ca": C_a, "Cc": C_im, "Pim": [...], "t": [...], "P_v": 0}}``

    Internal states: P_a, y [dyn/cm²].

    Twins: `lumped.extended_coronary.ExtendedCoronary` and `diagnosis.circuit.solve` repeat these
    equations; `tests/lumped/test_views.py` and `tests/diagnosis/test_circuit.py` compare them.

    Source: Mantero et al. 1992 (J Biomech Eng 114:109); Kim et al. 2010 (Ann Biomed Eng 38:3195);
    Puelz et al. 2024.

    Attributes:
        R_1, R_2, R_3: arterial, microvascular and venous resistance [dyn·s/cm⁵].
        C_a: arterial compliance [cm⁵/dyn].
        C_im: intramyocardial compliance [cm⁵/dyn].
        P_im: intramyocardial pressure [dyn/cm²] as a function of time, before scaling.
        im_factor: share of P_im that acts on C_im [-].
        P_venous: pressure behind R_3 [dyn/cm²].
    """

    n_ports: ClassVar[int] = 1
    P_im: AbstractWaveform
    R_1: Parameter = parameter()
    R_2: Parameter = parameter()
    R_3: Parameter = parameter()
    C_a: Parameter = parameter()
    C_im: Parameter = parameter()
    im_factor: Parameter = parameter(default=1.0)
    P_venous: Parameter = parameter(default=0.0)

    ranges: ClassVar[Range] = Range(
        above=("R_2", "R_3", "C_a", "C_im"), least=("R_1", "im_factor"), finite=("P_venous",)
    )

    def __check_init__(self):
        check_range(self)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Internal states, in order."""
        return ("P_a", "y_im")

    @property
    def is_linear(self) -> bool:
        """True: rates and closure are linear."""
        return True

    def mass(self) -> Float[Array, " 2"]:
        """Capacitances and inertances of the states."""
        return jnp.stack([self.C_a, self.C_im])

    def rate(self, t: Parameter, x: Float[Array, " 2"], P: Port, Q: Port) -> Float[Array, " 2"]:
        """Net flow into each capacitance, pressure across each inertance."""
        P_tilde = x[1] + self.im_factor * self.P_im(t)
        through = (x[0] - P_tilde) / self.R_2
        return jnp.stack([Q[0] - through, through - (P_tilde - self.P_venous) / self.R_3])

    def closure(self, t: Parameter, x: Float[Array, " 2"], P: Port, Q: Port) -> Port:
        """Pressure balance of the port."""
        return P - x[:1] - self.R_1 * Q

    def external_pressure(self, t: Parameter) -> Float[Array, " 2"]:
        """Pressure outside the walls of the states."""
        return jnp.stack([jnp.zeros(()), self.im_factor * self.P_im(t)])

    @property
    def R_total(self) -> Parameter:
        """R_1 + R_2 + R_3 [dyn·s/cm⁵]."""
        return self.R_1 + self.R_2 + self.R_3
