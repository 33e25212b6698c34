"""Periodic waveforms in time, with the instants at which they are not smooth.

A waveform is a function of time with a period and with *breakpoints*: the instants within the
period where a derivative jumps. Solvers place step ends there and so keep their order; the start
of the cycle is always a step end and need not be listed.
"""

import abc
from collections.abc import Sequence
from typing import ClassVar, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from lumped.parameters import Parameter, Range, check_range, is_traced, parameter, real

VALVE_CLOSURE = 0.35
"""Closure of the aortic valve as a share of the cycle (Puelz et al. 2024: t_peak + 0.05 T)."""


class AbstractWaveform(eqx.Module):
    """A scalar function of time: `waveform(t)`."""

    @abc.abstractmethod
    def __call__(self, t: Parameter) -> Array:
        """Value at time t [s]."""

    @abc.abstractmethod
    def repeats_after(self) -> Parameter | None:
        """Time after which it repeats [s]; infinite where never, None where it never changes."""

    @abc.abstractmethod
    def breakpoints(self) -> Float[Array, " k"]:
        """Instants in (0, period) where a derivative jumps [s], in ascending order."""


class Constant(AbstractWaveform):
    """The same value at all times.

    Attributes:
        value: the value, in the unit of what it stands for.
    """

    value: Parameter = parameter()

    ranges: ClassVar[Range] = Range(finite=("value",))

    def __check_init__(self):
        check_range(self)

    def __call__(self, t: Parameter) -> Array:
        """Value at time t [s]."""
        return real(self.value)

    def repeats_after(self) -> Parameter | None:
        """None: it is the same at all times."""
        return None

    def breakpoints(self) -> Float[Array, " 0"]:
        """None: the value never changes."""
        return jnp.zeros(0)


def smooth_bump(g: Parameter, k: float) -> Array:
    """exp(k − k/(1 − g²)) inside |g| < 1 and 0 outside: 1 at g = 0, all derivatives 0 at g = ±1.

    The guarded denominator keeps value and derivatives finite at and beyond g = ±1, where the
    plain formula is 0·∞.
    """
    inside = jnp.abs(g) < 1.0
    gap = jnp.where(inside, 1.0 - jnp.where(inside, g, 0.0) ** 2, 1.0)
    return jnp.where(inside, jnp.exp(k - k / gap), 0.0)


class AorticPressure(AbstractWaveform):
    """Pressure at the root of the aorta, from cuff values and the cycle length.

    Equations (T = period, t_peak = 0.3 T, t_valve = 0.35 T, k = 2, g = t/t_peak − 1):

        P(t) = (P_systolic − P_diastolic) exp(k − k/(1 − g²)) + P_diastolic,   0 ≤ t < t_valve
        P(t) = P(t_valve) exp(−β (t − t_valve)),                           t_valve ≤ t < T
        β = log(P(t_valve)/P_diastolic) / (T − t_valve)

    Breakpoints: 0 and t_valve, where the slope jumps. All three parameters are differentiated.

    Source: Puelz et al. 2024 (arXiv:2405.01703), inlet pressure; its γ is read at t_valve.

    Attributes:
        P_systolic: largest pressure [dyn/cm²].
        P_diastolic: smallest pressure [dyn/cm²], above zero.
        period: length of the cardiac cycle [s].
    """

    P_systolic: Parameter = parameter()
    P_diastolic: Parameter = parameter()
    period: Parameter = parameter()

    ranges: ClassVar[Range] = Range(
        above=("P_systolic", "P_diastolic", "period"), ascending=("P_diastolic", "P_systolic")
    )

    def __check_init__(self):
        check_range(self)

    def __call__(self, t: Parameter) -> Array:
        """Pressure at time t [s] in dyn/cm²."""
        phase = jnp.mod(t, self.period)
        t_valve = VALVE_CLOSURE * self.period
        P_valve = self._ejection(t_valve)
        beta = jnp.log(P_valve / self.P_diastolic) / (self.period - t_valve)
        decay = P_valve * jnp.exp(-beta * (phase - t_valve))
        return jnp.where(phase < t_valve, self._ejection(phase), decay)

    def _ejection(self, phase: Parameter) -> Array:
        g = phase / (0.3 * self.period) - 1.0
        return (self.P_systolic - self.P_diastolic) * smooth_bump(g, 2.0) + self.P_diastolic

    def repeats_after(self) -> Parameter | None:
        """Its period [s]."""
        return self.period

    def breakpoints(self) -> Float[Array, " 1"]:
        """Closure of the valve [s]."""
        return VALVE_CLOSURE * jnp.reshape(real(self.period), (1,))


class VentricularPressure(AbstractWaveform):
    """Pressure in the left ventricle above its filling pressure.

    Equations (T = period, t_shift = 0.0692 T, t_s = 0.4 T, k = 0.3):

        P(t) = P_peak exp(k − k/(1 − h²)),  h = 2 (t − t_shift)/(t_s − t_shift) − 1,
        and 0 outside (t_shift, t_s).

    Breakpoints: t_shift and t_s. Both parameters are differentiated.

    Source: Puelz et al. 2024; t_s is read as the end of the bump (the print has t_valve there).

    Attributes:
        P_peak: largest pressure [dyn/cm²]; the systolic aortic pressure in the paper.
        period: length of the cardiac cycle [s].
    """

    P_peak: Parameter = parameter()
    period: Parameter = parameter()

    ranges: ClassVar[Range] = Range(above=("period",), least=("P_peak",))

    def __check_init__(self):
        check_range(self)

    def __call__(self, t: Parameter) -> Array:
        """Pressure at time t [s] in dyn/cm²."""
        phase = jnp.mod(t, self.period)
        t_shift, t_s = 0.0692 * self.period, 0.4 * self.period
        h = 2.0 * (phase - t_shift) / (t_s - t_shift) - 1.0
        return self.P_peak * smooth_bump(h, 0.3)

    def repeats_after(self) -> Parameter | None:
        """Its period [s]."""
        return self.period

    def breakpoints(self) -> Float[Array, " 2"]:
        """Start and end of the ventricle's contraction [s]."""
        return jnp.stack([0.0692 * real(self.period), 0.4 * real(self.period)])


class Sinusoid(AbstractWaveform):
    """mean + amplitude · cos(2π t/period + phase): the probe with a closed-form answer.

    Attributes:
        mean: average value.
        amplitude: half the peak-to-peak value.
        period: length of one oscillation [s].
        phase: phase angle at t = 0 [rad]; −π/2 gives a sine.
    """

    mean: Parameter = parameter()
    amplitude: Parameter = parameter()
    period: Parameter = parameter()
    phase: Parameter = parameter(default=0.0)

    ranges: ClassVar[Range] = Range(above=("period",), finite=("mean", "amplitude", "phase"))

    def __check_init__(self):
        check_range(self)

    def __call__(self, t: Parameter) -> Array:
        """Value at time t [s]."""
        angle = 2.0 * jnp.pi * t / self.period + self.phase
        return self.mean + self.amplitude * jnp.cos(angle)

    def repeats_after(self) -> Parameter | None:
        """Its period [s]."""
        return self.period

    def breakpoints(self) -> Float[Array, " 0"]:
        """None: smooth everywhere."""
        return jnp.zeros(0)


class Ramp(AbstractWaveform):
    """start + slope · (t − t_start): a value that changes linearly; not periodic.

    Attributes:
        start: value at t_start.
        slope: change a second.
        t_start: time of the start value [s].
    """

    ranges: ClassVar[Range] = Range(finite=("start", "slope", "t_start"))
    start: Parameter = parameter()
    slope: Parameter = parameter()
    t_start: Parameter = parameter(default=0.0)

    def __call__(self, t: Parameter) -> Array:
        """Value at time t [s]."""
        return real(self.start + self.slope * (t - self.t_start))

    def repeats_after(self) -> Parameter | None:
        """Never."""
        return float("inf")

    def breakpoints(self) -> Float[Array, " 0"]:
        """None: smooth everywhere."""
        return jnp.zeros(0)


class Sampled(AbstractWaveform):
    """A measured beat: periodic interpolation of samples, linear or cubic.

    Build it with `sampled(times, values, period, kind=...)`. Linear interpolation is what
    svZeroDSolver applies to its tables. Cubic interpolation is the periodic C² spline, kept as
    values and slopes (Hermite form); it is the choice where derivatives of a trace matter.

    Breakpoints: the sample times. Differentiated: values, slopes, times and period.

    Attributes:
        times: sample times [s] in [0, period), ascending, shape (k,).
        values: samples, shape (k,).
        slopes: derivative at the samples [1/s], or None for linear interpolation.
        period: length of the beat [s].
    """

    ranges: ClassVar[Range] = Range(above=("period",), finite=("times", "values", "slopes"))
    times: Float[Array, " k"]
    values: Float[Array, " k"]
    slopes: Float[Array, " k"] | None
    period: Parameter = parameter()

    def __call__(self, t: Parameter) -> Array:
        """Value at time t [s]."""
        count = self.times.shape[0]
        phase = jnp.mod(t - self.times[0], self.period) + self.times[0]
        left = jnp.clip(jnp.searchsorted(self.times, phase, side="right") - 1, 0, count - 1)
        right = (left + 1) % count
        t_right = jnp.where(right == 0, self.times[0] + self.period, self.times[right])
        h = t_right - self.times[left]
        s = (phase - self.times[left]) / h
        a, b = self.values[left], self.values[right]
        if self.slopes is None:
            return a + s * (b - a)
        da, db = h * self.slopes[left], h * self.slopes[right]
        return (
            a * (1 + 2 * s) * (1 - s) ** 2
            + da * s * (1 - s) ** 2
            + b * s**2 * (3 - 2 * s)
            - db * s**2 * (1 - s)
        )

    def repeats_after(self) -> Parameter | None:
        """Its period [s]."""
        return self.period

    def breakpoints(self) -> Float[Array, " k"]:
        """The sample times [s]."""
        return self.times


class Stretched(AbstractWaveform):
    """Another waveform, stretched in time and in value: gain · f(t / factor) + offset.

    Breakpoints: those of the other waveform, stretched. Differentiated: all four.

    Attributes:
        waveform: the other waveform f.
        factor: what its period is multiplied by [-].
        gain: of its values [-].
        offset: added to them, in their unit.
    """

    waveform: AbstractWaveform
    factor: Parameter = parameter()
    gain: Parameter = parameter(default=1.0)
    offset: Parameter = parameter(default=0.0)

    ranges: ClassVar[Range] = Range(above=("factor",), finite=("gain", "offset"))

    def __check_init__(self):
        check_range(self)

    def __call__(self, t: Parameter) -> Array:
        """Value at time t [s]."""
        return self.gain * self.waveform(t / self.factor) + self.offset

    def repeats_after(self) -> Parameter | None:
        """The period of the other waveform, stretched [s]."""
        period = self.waveform.repeats_after()
        return None if period is None else self.factor * period

    def breakpoints(self) -> Float[Array, " k"]:
        """Those of the other waveform, stretched [s]."""
        return self.factor * self.waveform.breakpoints()


def sampled(
    times: ArrayLike | Sequence[float],
    values: ArrayLike | Sequence[float],
    period: Parameter,
    *,
    kind: Literal["linear", "cubic"] = "linear",
) -> Sampled:
    """Make a waveform of one measured beat.

    Args:
        times: sample times [s], ascending, within one period, shape (k,). A last sample one
            period after the first is dropped when it repeats the first value, and refused
            when it does not.
        values: samples, shape (k,).
        period: length of the beat [s].
        kind: "linear" or "cubic" (periodic C² spline).

    Returns:
        The waveform.

    Raises:
        ValueError: the samples are not finite, not ascending, or do not fit into one period
            (not checked while tracing).
    """
    if not is_traced(times, values, period):
        times, values = _checked_beat(
            np.asarray(times, float), np.asarray(values, float), float(period)
        )
    slopes = _spline_slopes(real(times), real(values), real(period)) if kind == "cubic" else None
    return Sampled(times=real(times), values=real(values), slopes=slopes, period=period)


@jax.jit
def _spline_slopes(
    times: Float[Array, " k"], values: Float[Array, " k"], period: Array
) -> Float[Array, " k"]:
    """Slopes of the periodic C² cubic spline: continuity of the second derivative at each knot."""
    h = jnp.diff(jnp.append(times, times[0] + period))
    secant = (jnp.roll(values, -1) - values) / h
    h_left, secant_left = jnp.roll(h, 1), jnp.roll(secant, 1)
    count = times.shape[0]
    k = jnp.arange(count)
    system = (
        jnp.zeros((count, count))
        .at[k, k]
        .add(2.0 / h_left + 2.0 / h)
        .at[k, (k + 1) % count]
        .add(1.0 / h)
        .at[k, (k - 1) % count]
        .add(1.0 / h_left)
    )
    return jnp.linalg.solve(system, 3.0 * (secant_left / h_left + secant / h))


def _checked_beat(ts: np.ndarray, vs: np.ndarray, T: float) -> tuple[np.ndarray, np.ndarray]:
    """The samples of one beat without a closing one; refuses what is not a beat."""
    if not (np.isfinite(T) and T > 0.0):
        raise ValueError(f"The period {T:g} s must be positive. Give the length of the beat.")
    if ts.ndim != 1 or ts.shape != vs.shape or ts.size < 2:
        raise ValueError(
            f"A sampled waveform needs two or more times and as many values; got shapes "
            f"{ts.shape} and {vs.shape}. Give one beat as two equally long columns."
        )
    if not (np.all(np.isfinite(ts)) and np.all(np.isfinite(vs))):
        raise ValueError("A sample is not finite. Cut the trace to a beat without gaps.")
    if np.any(np.diff(ts) <= 0):
        raise ValueError("Sample times must ascend. Sort them and drop repeated instants.")
    closing = abs(ts[-1] - ts[0] - T) <= 1e-6 * T
    if closing:
        if abs(vs[-1] - vs[0]) > 1e-6 * np.ptp(vs) + 1e-12 * np.max(np.abs(vs)):
            raise ValueError(
                f"The beat does not close: first value {vs[0]:g}, value one period later "
                f"{vs[-1]:g}. Average several beats, or leave the last sample out."
            )
        return ts[:-1], vs[:-1]
    if ts[-1] - ts[0] > T:
        raise ValueError(
            f"Samples span {ts[-1] - ts[0]:g} s, more than the period {T:g} s. "
            "Give one beat, or correct the period."
        )
    return ts, vs
