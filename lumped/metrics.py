"""Clinical metrics of a periodic state: pressure ratios and flows.

Both FFR and the resting ratio are ratios of cycle means; they differ only in the condition. iFR is
the ratio of means over the wave-free period of diastole.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lumped.parameters import Parameter, is_traced, nan_unless, real
from lumped.periodic_solution import PeriodicSolution
from lumped.units import ML_PER_MIN
from lumped.waveforms import VALVE_CLOSURE


def pressure_ratio(
    solution: PeriodicSolution, *, proximal: str = "aorta", distal: str = "distal"
) -> Float[Array, ""]:
    """Mean distal over mean proximal pressure: FFR under stress, resting Pd/Pa at rest.

    NaN where the mean proximal pressure is not positive.
    """
    return _quotient(solution.mean_pressure(distal), solution.mean_pressure(proximal))


def ifr(
    solution: PeriodicSolution,
    *,
    proximal: str = "aorta",
    distal: str = "distal",
    t_valve: Parameter | None = None,
) -> Float[Array, ""]:
    """Instantaneous wave-free ratio: mean distal over mean proximal pressure in late diastole.

    The window runs from a quarter into diastole to 5 ms before its end (Sen et al. 2012, JACC
    59:1392); diastole starts when the aortic valve closes.

    Args:
        solution: the periodic state.
        proximal: node of the aortic pressure.
        distal: node of the distal pressure.
        t_valve: closure of the valve [s]; by default 0.35 of the cycle, as in the aortic waveform.

    Returns:
        The ratio; NaN where the window is empty or the mean proximal pressure not positive.

    Raises:
        ValueError: the closure does not lie within the cycle (not checked while tracing).
    """
    t_close = _valve_closure(solution, t_valve)
    start = t_close + 0.25 * (solution.period - t_close)
    window = (start, solution.period - 5e-3)
    return _quotient(
        mean_between(solution, solution.pressure(distal), *window),
        mean_between(solution, solution.pressure(proximal), *window),
    )


def sampled_ifr(
    t: Float[np.ndarray, " times"],
    P_aorta: Float[np.ndarray, " times"],
    P_distal: Float[np.ndarray, " times"],
    period: float,
) -> float | None:
    """The same ratio of two sampled pressures, over the last whole cycle.

    Args:
        t: times from the start of a cycle on [s], ascending.
        P_aorta: aortic pressure at these times.
        P_distal: distal pressure, in the same unit.
        period: length of a cycle [s].

    Returns:
        The ratio; None where no whole cycle is there, or less than two samples in its window.
    """
    whole = int((float(t[-1]) if len(t) else 0.0) / period + 1e-6)
    if whole < 1:
        return None
    start = (whole - 1) * period + (0.25 + 0.75 * VALVE_CLOSURE) * period
    window = (t >= start) & (t <= whole * period - 5e-3)
    if np.count_nonzero(window) < 2:
        return None
    distal, aorta = (np.trapezoid(P[window], t[window]) for P in (P_distal, P_aorta))
    return float(distal / aorta) if aorta > 0.0 else None


def systolic_share(
    solution: PeriodicSolution, name: str = "ostium", *, t_valve: Parameter | None = None
) -> Float[Array, ""]:
    """Share of a cycle's net flow into an element that passes before the aortic valve closes.

    NaN where there is no net flow into it.
    """
    t_close = _valve_closure(solution, t_valve)
    volume = mean_between(solution, solution.flow(name), 0.0, t_close) * t_close
    return _quotient(volume, solution.mean_flow(name) * solution.period)


def _valve_closure(solution: PeriodicSolution, t_valve: Parameter | None) -> Array:
    """Closure of the aortic valve [s]; NaN where it does not lie within the cycle."""
    period = real(solution.period)
    if t_valve is None:
        return VALVE_CLOSURE * period
    t_close = real(t_valve)
    inside = (t_close > 0.0) & (t_close < period)
    if not is_traced(inside) and not np.all(inside):
        raise ValueError(
            f"The aortic valve cannot close at {t_valve} s in a cycle of {solution.period} s. "
            "Give a time within the cycle."
        )
    return t_close * nan_unless(inside)


def _quotient(above: Array, below: Array) -> Array:
    """Quotient; NaN unless the divisor is positive."""
    return above / jnp.where(below > 0.0, below, jnp.nan)


def mean_between(
    solution: PeriodicSolution, values: Float[Array, " k"], start: Parameter, end: Parameter
) -> Float[Array, ""]:
    """Mean of a waveform between two times of the cycle, exact for piecewise linear waveforms.

    NaN where the times do not ascend or lie outside the cycle.
    """
    inside = (real(start) >= 0.0) & (real(start) < real(end)) & (real(end) <= solution.period)
    t = jnp.append(solution.t, solution.period)
    v = jnp.append(values, values[0])
    volume = jnp.append(0.0, jnp.cumsum(0.5 * jnp.diff(t) * (v[1:] + v[:-1])))
    length = (end - start) * nan_unless(inside)
    return (_integral(t, v, volume, end) - _integral(t, v, volume, start)) / length


def _integral(t: Array, v: Array, volume: Array, at: Parameter) -> Array:
    """∫₀^at of the piecewise linear function (t, v), `volume` being its integral at the knots."""
    k = jnp.clip(jnp.searchsorted(t, at, side="right") - 1, 0, t.shape[0] - 2)
    h = jnp.maximum(t[k + 1] - t[k], 1e-300)
    s = at - t[k]
    return volume[k] + s * (v[k] + 0.5 * s * (v[k + 1] - v[k]) / h)


class Metrics(NamedTuple):
    """Clinical metrics of a periodic state.

    Attributes:
        ratio: mean distal over mean aortic pressure (FFR under stress, resting Pd/Pa at rest) [-].
        ifr: instantaneous wave-free ratio [-].
        mean_P_aorta, mean_P_distal: cycle means [dyn/cm²].
        mean_Q: mean coronary flow [cm³/s].
        systolic_share: share of the flow that passes in systole [-].
    """

    ratio: Float[Array, ""]
    ifr: Float[Array, ""]
    mean_P_aorta: Float[Array, ""]
    mean_P_distal: Float[Array, ""]
    mean_Q: Float[Array, ""]
    systolic_share: Float[Array, ""]

    @property
    def flow_ml_per_min(self) -> Float[Array, ""]:
        """Mean coronary flow [mL/min]."""
        return self.mean_Q / ML_PER_MIN


def metrics(solution: PeriodicSolution) -> Metrics:
    """All metrics of a surrogate's periodic state."""
    return Metrics(
        ratio=pressure_ratio(solution),
        ifr=ifr(solution),
        mean_P_aorta=solution.mean_pressure("aorta"),
        mean_P_distal=solution.mean_pressure("distal"),
        mean_Q=solution.mean_flow("ostium"),
        systolic_share=systolic_share(solution),
    )
