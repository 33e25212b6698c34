"""Verification of the lumped models: example elements and exact solutions.

`BLOCKS` and `VESSELS` drive the generic tests: a new element is tested by adding a line there and
its impedance to `IMPEDANCES`. The exact solutions are written out by hand from the equations of
each block, in NumPy, and share no code with the networks that they verify.
"""

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from lumped.blocks import RC, RCR, RCRL, Coronary, Resistance
from lumped.elements import AbstractElement
from lumped.extended_coronary import ExtendedCoronary
from lumped.parameters import Parameter, Range, check_range, parameter, real
from lumped.units import MMHG
from lumped.vessels import Vessel, VesselCRL
from lumped.waveforms import AbstractWaveform, Constant, Sinusoid

PERIOD = 0.8
"""Cycle length of the examples [s]."""

BLOCKS: dict[str, AbstractElement] = {
    "resistance": Resistance(R=1.6e3, P_ref=5.0 * MMHG),
    "rc": RC(R=1.4e3, C=9e-4, P_ref=5.0 * MMHG),
    "rcr": RCR(R_proximal=120.0, C=9e-4, R_distal=1.4e3, P_ref=5.0 * MMHG),
    "rcrl": RCRL(R_proximal=120.0, C=9e-4, R_distal=1.4e3, L=8.0, P_ref=5.0 * MMHG),
    "coronary": Coronary(
        R_1=8.0e3,
        R_2=1.6e4,
        R_3=6.7e4,
        C_a=4.5e-7,
        C_im=3e-6,
        P_im=Sinusoid(mean=40.0 * MMHG, amplitude=55.0 * MMHG, period=PERIOD, phase=-2.0),
        im_factor=0.7,
        P_venous=6.0 * MMHG,
    ),
    "extended coronary": ExtendedCoronary(
        R_1=8.0e3,
        R_2=1.6e4,
        R_3=6.7e4,
        C_a=4.5e-7,
        C_im=3e-6,
        P_im=Sinusoid(mean=30.0 * MMHG, amplitude=40.0 * MMHG, period=PERIOD, phase=-2.0),
        P_source=Constant(90.0 * MMHG),
        P_venous=6.0 * MMHG,
        G_collateral=3e-6,
        G_bypass=2e-6,
        elastic_share=0.5,
        wall_time=0.03,
    ),
}
"""Example boundary blocks: a systemic and a coronary bed of an adult at rest."""

VESSELS: dict[str, AbstractElement] = {
    "R": Vessel(R_viscous=60.0),
    "RC": Vessel(R_viscous=60.0, C=2e-5),
    "RL": Vessel(R_viscous=60.0, L=2.0),
    "RCL": Vessel(R_viscous=60.0, C=2e-5, L=2.0),
    "stenosis": Vessel(R_viscous=60.0, C=2e-5, L=2.0, K_stenosis=4.0),
    "CRL": VesselCRL(R_viscous=60.0, C=2e-5, L=2.0),
    "CRL stenosis": VesselCRL(R_viscous=60.0, C=2e-5, L=2.0, K_stenosis=4.0),
}
"""Example vessels: a piece of a large artery, with every set of optional parts."""


def _coronary_impedance(b: Any, s: Any) -> Any:
    return b.R_1 + 1.0 / (b.C_a * s + 1.0 / (b.R_2 + 1.0 / (b.C_im * s + 1.0 / b.R_3)))


def _extended_impedance(b: Any, s: Any) -> Any:
    wall = b.C_a * s * (b.elastic_share + (1.0 - b.elastic_share) / (1.0 + s * b.wall_time))
    bed = 1.0 / (b.R_2 + 1.0 / (b.C_im * s + 1.0 / b.R_3))
    return b.R_1 + 1.0 / (wall + b.G_collateral + b.G_bypass + bed)


IMPEDANCES: dict[type[AbstractElement], Callable[[Any, Any], Any]] = {
    Resistance: lambda b, s: b.R + 0.0 * s,
    RC: lambda b, s: 1.0 / (1.0 / b.R + b.C * s),
    RCR: lambda b, s: b.R_proximal + 1.0 / (1.0 / b.R_distal + b.C * s),
    RCRL: lambda b, s: (
        b.L * s / (1.0 + b.L * s / b.R_proximal) + 1.0 / (1.0 / b.R_distal + b.C * s)
    ),
    Coronary: _coronary_impedance,
    ExtendedCoronary: _extended_impedance,
}
"""Impedance Z(s) of each kind of block, as a function of block and Laplace variable s [1/s]."""


def _numbers(element: Any) -> Any:
    """The element with NumPy numbers for parameters."""
    return jax.tree.map(np.asarray, element)


def impedance(block: AbstractElement, s: ArrayLike) -> np.ndarray:
    """Z(s) of a block [dyn·s/cm⁵] by the rules of series and parallel elements.

    Z(0) is the resistance to steady flow, Z(iω) the transfer impedance, and Z(1/dt) the slope
    dP/dQ of a backward-Euler step: three views of a linear block are one function.
    """
    return IMPEDANCES[type(block)](_numbers(block), np.asarray(s))


def vessel_impedance(vessel: Any, load: ArrayLike, s: ArrayLike) -> np.ndarray:
    """Z(s) at the inlet of a linear vessel that ends in a load Z_load(s) [dyn·s/cm⁵]."""
    v, s = _numbers(vessel), np.asarray(s)
    C, L = (0.0 if part is None else part for part in (v.C, v.L))
    if isinstance(vessel, VesselCRL):
        return 1.0 / (C * s + 1.0 / (v.R_viscous + L * s + load))
    return v.R_viscous + 1.0 / (C * s + 1.0 / (L * s + load))


class CoronaryWaveforms(NamedTuple):
    """Exact periodic waveforms of a five-element coronary block, each of shape (k,).

    Attributes:
        P: pressure at the port [dyn/cm²].
        P_a: pressure at C_a [dyn/cm²].
        y: pressure across C_im [dyn/cm²].
        Q: flow into the block [cm³/s].
    """

    P: np.ndarray
    P_a: np.ndarray
    y: np.ndarray
    Q: np.ndarray


def coronary_driven_by_flow(t: ArrayLike, block: Coronary, flow: Sinusoid) -> CoronaryWaveforms:
    """Exact periodic state of a coronary block under a sinusoidal flow and a sinusoidal P_im.

    By superposition of the means and of one harmonic of each source; see `_harmonic`.

    Args:
        t: times [s], shape (k,).
        block: the block; its P_im is a `Sinusoid`.
        flow: flow into the block [cm³/s].
    """
    b, drive = _numbers(block), _numbers(flow)
    squeeze = b.im_factor * _phasor(b.P_im)
    return _sum(
        _steady(b, drive.mean),
        _oscillation(t, b, drive.period, _phasor(drive), 0.0),
        _oscillation(t, b, b.P_im.period, 0.0, squeeze),
    )


def coronary_behind_vessel(
    t: ArrayLike, block: Coronary, inlet: Sinusoid, R0: float, C0: float
) -> CoronaryWaveforms:
    """Exact periodic state of a coronary block behind R0 and C0, all sources sinusoidal.

    Circuit: P_aorta ── R0 ──┬── block
                             C0

    The port obeys d = Z q + e, e being its pressure at zero flow due to P_im, and the vessel
    (1/R0 + iω C0) d + q = P_aorta/R0; so q = (P_aorta/R0 − g e)/(1 + g Z), g = 1/R0 + iω C0.

    Args:
        t: times [s], shape (k,).
        block: the block; its P_im is a `Sinusoid`.
        inlet: aortic pressure [dyn/cm²].
        R0: resistance of the vessel [dyn·s/cm⁵].
        C0: compliance of the vessel [cm⁵/dyn].
    """
    b, aorta = _numbers(block), _numbers(inlet)
    squeeze = b.im_factor * _phasor(b.P_im)

    def flow(period: float, P_aorta: complex, m: complex) -> complex:
        omega = 2.0 * np.pi / period
        e, Z = _harmonic(b, omega, 0.0, m)[0], _harmonic(b, omega, 1.0, 0.0)[0]
        g = 1.0 / R0 + 1j * omega * C0
        return (P_aorta / R0 - g * e) / (1.0 + g * Z)

    return _sum(
        _steady(b, (aorta.mean - b.P_venous) / (R0 + b.R_1 + b.R_2 + b.R_3)),
        _oscillation(t, b, aorta.period, flow(aorta.period, _phasor(aorta), 0.0), 0.0),
        _oscillation(t, b, b.P_im.period, flow(b.P_im.period, 0.0, squeeze), squeeze),
    )


def _phasor(source: Any) -> complex:
    """Complex amplitude: the source oscillates as Re(phasor · exp(iωt))."""
    return source.amplitude * np.exp(1j * source.phase)


def _harmonic(b: Any, omega: float, q: complex, m: complex) -> tuple[complex, ...]:
    """Amplitudes (P, P_a, y, Q) of one harmonic with flow amplitude q and im_factor · P̂_im = m.

    Harmonic balance of the two nodes, p at C_a and p̃ at C_im:

        (1/R_2 + iω C_a) p                −  p̃/R_2  = q
        −p/R_2  +  (1/R_2 + 1/R_3 + iω C_im) p̃       = iω C_im m

    The right-hand side of the second row is the term C_im dP_im/dt.
    """
    upper = 1.0 / b.R_2 + 1j * omega * b.C_a
    lower = 1.0 / b.R_2 + 1.0 / b.R_3 + 1j * omega * b.C_im
    squeeze = 1j * omega * b.C_im * m
    determinant = upper * lower - 1.0 / b.R_2**2
    p = (lower * q + squeeze / b.R_2) / determinant
    p_tilde = (upper * squeeze + q / b.R_2) / determinant
    return p + b.R_1 * q, p, p_tilde - m, q


def _steady(b: Any, Q: float) -> tuple[float, ...]:
    """Means (P, P_a, y, Q) under the mean flow Q."""
    P_tilde = b.P_venous + b.R_3 * Q
    P_a = P_tilde + b.R_2 * Q
    return P_a + b.R_1 * Q, P_a, P_tilde - b.im_factor * b.P_im.mean, Q


def _oscillation(
    t: ArrayLike, b: Any, period: float, q: complex, m: complex
) -> tuple[np.ndarray, ...]:
    """One harmonic of (P, P_a, y, Q) at the times t."""
    omega = 2.0 * np.pi / period
    turn = np.exp(1j * omega * np.asarray(t))
    return tuple((amplitude * turn).real for amplitude in _harmonic(b, omega, q, m))


def _sum(*parts: tuple[Any, ...]) -> CoronaryWaveforms:
    P, P_a, y, Q = (
        np.sum(np.broadcast_arrays(*column), axis=0) for column in zip(*parts, strict=True)
    )
    return CoronaryWaveforms(P, P_a, y, Q)


class Pulse(AbstractWaveform):
    """A value that is `height` in [t_on, t_off) of the cycle and 0 elsewhere: a source that jumps.

    Attributes:
        height: value of the pulse.
        t_on, t_off: its start and end [s], 0 < t_on < t_off < period.
        period: length of the cycle [s].
    """

    height: Parameter = parameter()
    t_on: Parameter = parameter()
    t_off: Parameter = parameter()
    period: Parameter = parameter()

    ranges: ClassVar[Range] = Range(above=("t_on", "t_off", "period"), finite=("height",))

    def __check_init__(self):
        check_range(self)

    def __call__(self, t: Parameter) -> Array:
        """Value at time t [s]."""
        phase = jnp.mod(t, self.period)
        return jnp.where((phase >= self.t_on) & (phase < self.t_off), self.height, 0.0)

    def repeats_after(self) -> Parameter | None:
        """Its period [s]."""
        return self.period

    def breakpoints(self) -> Float[Array, " 2"]:
        """Start and end of the pulse [s]."""
        return jnp.stack([real(self.t_on), real(self.t_off)])


def pulsed_coronary(t: ArrayLike, block: Coronary, Q: float) -> np.ndarray:
    """Exact periodic states (P_a, y) of a coronary block under constant flow and a `Pulse` P_im.

    Between the jumps x' = A (x − x_eq) with x_eq = (P_a, y) at rest under the pulse or without;
    x is continuous where P_im jumps. Hence, with Φ(t) = exp(A t) and the pulse of length w,

        x(t_on) = (I − Φ(T))⁻¹ ((I − Φ(T − w)) x_low + Φ(T − w) (I − Φ(w)) x_high).

    Args:
        t: times [s] in [0, period), shape (k,).
        block: the block; its P_im is a `Pulse`.
        Q: flow into the block [cm³/s].

    Returns:
        The states, shape (k, 2).
    """
    b = _numbers(block)
    between, out = 1.0 / b.R_2, 1.0 / b.R_3
    A = np.array(
        [
            [-between / b.C_a, between / b.C_a],
            [between / b.C_im, -(between + out) / b.C_im],
        ]
    )
    rates, modes = np.linalg.eig(A)
    T, w, eye = b.P_im.period, b.P_im.t_off - b.P_im.t_on, np.eye(2)
    P_tilde = b.P_venous + b.R_3 * Q
    low = np.array([P_tilde + b.R_2 * Q, P_tilde])
    high = low - np.array([0.0, b.im_factor * b.P_im.height])

    def phi(s: float) -> np.ndarray:
        return (modes * np.exp(rates * s)) @ np.linalg.inv(modes)

    cycle = (eye - phi(T - w)) @ low + phi(T - w) @ (eye - phi(w)) @ high
    x_on = np.linalg.solve(eye - phi(T), cycle)
    x_off = high + phi(w) @ (x_on - high)
    since = np.mod(np.asarray(t) - b.P_im.t_on, T)
    return np.stack(
        [
            high + phi(s) @ (x_on - high) if s < w else low + phi(s - w) @ (x_off - low)
            for s in since
        ]
    )
