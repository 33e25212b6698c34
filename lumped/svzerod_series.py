"""Time series of svZeroDSolver and the waveforms that they stand for.

A series is a list of instants from 0 to the period, both ends included, with one value at each;
svZeroDSolver joins the values by straight lines and repeats them. A series whose values are all
equal, or of a single value, is a constant.
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lumped.network import Network
from lumped.waveforms import AbstractWaveform, Constant, Sampled, sampled

CLOSING = 1e-9
"""Difference of first and last value, relative to the largest, at which a series closes."""


class Series(NamedTuple):
    """A time series as it stands in a file.

    Attributes:
        t: instants [s], the first 0, the last one period later.
        values: one value an instant.
    """

    t: Float[np.ndarray, " k"]
    values: Float[np.ndarray, " k"]


def waveform_from_series(
    t: Sequence[float],
    values: Sequence[float],
    *,
    interpolation: Literal["linear", "cubic"] = "linear",
) -> tuple[AbstractWaveform, float | None]:
    """The waveform that a series stands for, and its period [s] (None where it has none).

    Args:
        t: instants [s].
        values: one value an instant.
        interpolation: "linear" as svZeroDSolver does, or "cubic" where the values are samples of
            a smooth function.

    Raises:
        ValueError: the series does not run over one period from t = 0, or does not close.
    """
    if len(t) != len(values) or not len(values):
        raise ValueError(f"{len(t)} times for {len(values)} values; give one time a value")
    if len(values) == 1:
        return Constant(float(values[0])), None
    times, samples = np.asarray(t, float), np.asarray(values, float)
    if times[0] != 0.0:
        raise ValueError(
            f"the times start at {times[0]:g}; let them start at 0 (svZeroDSolver extrapolates "
            "before the first time)"
        )
    period = float(times[-1])
    if np.any(np.diff(times) <= 0):
        raise ValueError("the times do not ascend; sort them and drop repeated instants")
    if np.all(samples == samples[0]):
        return Constant(float(samples[0])), period
    return sampled(times, samples, period, kind=interpolation), period


def series_from_waveform(waveform: AbstractWaveform, period: float, *, samples: int) -> Series:
    """A waveform as a series: exact for constants and linear samples, else interpolated.

    Args:
        waveform: the waveform; it must repeat after the period.
        period: length of the cycle [s].
        samples: equal parts into which the period of a smooth waveform is cut; its breakpoints
            are added.

    Raises:
        ValueError: the waveform does not repeat after the period.
    """
    ends = np.array([0.0, period])
    if isinstance(waveform, Constant):
        return Series(ends, np.full(2, float(waveform(0.0))))
    if isinstance(waveform, Sampled) and waveform.slopes is None:
        t = _knots(waveform, period)
        times, values = np.asarray(waveform.times), np.asarray(waveform.values)
        return Series(t, np.interp(t % period, times, values, period=float(waveform.period)))
    uniform = np.linspace(0.0, period, samples + 1)
    marks = np.asarray(waveform.breakpoints(), float)
    t = merged(uniform, marks[(marks > 0.0) & (marks < period)], period)
    values = np.array(jax.vmap(waveform)(jnp.asarray(t[:-1])), float)
    last = float(waveform(jnp.asarray(period)))
    if abs(last - values[0]) > CLOSING * np.max(np.abs(values)):
        raise ValueError(
            f"{type(waveform).__name__} does not repeat after the period {period:g} s: it starts "
            f"at {values[0]:g} and ends at {last:g}"
        )
    return Series(t, np.append(values, values[0]))


def steady_sources(network: Network, period: float, *, samples: int) -> Network:
    """The network with every source held at the mean of its series, closing sample included.

    This arithmetic mean is what svZeroDSolver starts from; it is the mean over time only where
    the samples are equally spaced and many.

    Args:
        network: the network.
        period: length of the cycle [s].
        samples: see `series_from_waveform`.
    """
    means = [
        float(np.mean(series_from_waveform(waveform, period, samples=samples).values))
        for waveform in network.waveforms()
    ]
    return network.with_sources(means)


def _knots(waveform: Sampled, period: float) -> np.ndarray:
    """Sample times of a linear table over the period, both ends included."""
    own = float(waveform.period)
    repeats = max(round(period / own), 1)
    if abs(repeats * own - period) > CLOSING * period:
        raise ValueError(
            f"the samples repeat after {own:g} s, which does not divide the period {period:g} s"
        )
    times = np.asarray(waveform.times, float)
    starts = own * np.arange(-1, repeats)
    every = (starts[:, None] + times[None, :]).ravel()
    inside = every[(every >= 0.0) & (every < period * (1.0 - CLOSING))]
    return merged(inside, np.array([0.0, period]), period)


def merged(t: np.ndarray, marks: np.ndarray, period: float) -> np.ndarray:
    """Instants of both lists in ascending order; a mark beside an instant is left out.

    Args:
        t: instants that are kept [s], ascending.
        marks: instants to add [s].
        period: length of the cycle [s], the scale of what is beside.
    """
    marks = np.sort(marks)
    marks = marks[np.diff(marks, prepend=-np.inf) > CLOSING * period]
    if not t.size:
        return marks
    right = np.clip(np.searchsorted(t, marks), 0, t.size - 1)
    left = np.maximum(right - 1, 0)
    gap = np.minimum(np.abs(marks - t[left]), np.abs(marks - t[right]))
    return np.sort(np.concatenate([t, marks[gap > CLOSING * period]]))
