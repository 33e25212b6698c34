"""α with the 3D model in the loop: the resting ratio of the 3D run itself meets the measured one.

A 3D run is expensive, its surrogate is cheap. With r the ratio and S(α) = 1/r of the surrogate, 1/r
of the 3D model is taken to be an affine function of S::

    one run, at α₀:           1/r = 1 + κ (S(α) − 1),    κ = (1/r₀ − 1)/(S(α₀) − 1)
    two runs or more:         the line through the two whose ratios lie nearest to the target

The first says that the surrogate errs in the resistance of the artery by a factor; it is exact
where flow vanishes, whatever the factor, since both ratios are 1 there. S is affine in 1/α for the
linear surrogate, so that the line is then the secant in 1/α ↦ 1/r; for the quadratic one S carries
the curvature. α is the surrogate's own calibration to the value of S at which the line meets the
target.

Puelz et al. 2024 stop after the surrogate (algorithm 1): their resting ratios differ from the
measured ones by the error of the surrogate.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp

from calibration.alpha import calibrate_alpha
from lumped import (
    HaemodynamicCondition,
    Propagator,
    Shooting,
    Surrogate,
    pressure_ratio,
    solve_periodic,
)

RATIO_TOLERANCE = 0.002
"""Tolerance of the resting ratio of the 3D run: a fifth of the error of a good measurement [-]."""

MOST_EXTRA_RUNS = 2


class Trial(NamedTuple):
    """A run in 3D.

    Attributes:
        alpha: scale of the resistances of the anomalous outlet [-].
        ratio: resting ratio that it had [-].
    """

    alpha: float
    ratio: float


class LoopFit(NamedTuple):
    """Result of a calibration in the loop.

    Attributes:
        best: index of the best run.
        trials: all runs, in order.
        reached: whether the ratio of the best run is within the tolerance.
    """

    best: int
    trials: tuple[Trial, ...]
    reached: bool

    @property
    def alpha(self) -> float:
        """Scale factor of the best run [-]."""
        return self.trials[self.best].alpha

    @property
    def ratio(self) -> float:
        """Resting ratio of the best run [-]."""
        return self.trials[self.best].ratio

    @property
    def extra_runs(self) -> int:
        """Runs beyond the first."""
        return len(self.trials) - 1


def surrogate_ratio(surrogate: Surrogate, condition: HaemodynamicCondition, alpha: float) -> float:
    """Resting ratio of a surrogate with a scale factor [-].

    Raises:
        ValueError: the scale factor is not positive.
    """
    if not 0.0 < alpha < math.inf:
        raise ValueError(f"The scale factor alpha = {alpha} must be finite and positive.")
    tuned = eqx.tree_at(lambda s: s.alpha, surrogate, jnp.asarray(alpha, float))
    solver = Propagator() if surrogate.K is None else Shooting()
    return float(pressure_ratio(solve_periodic(tuned.network(condition), condition.period, solver)))


def next_alpha(
    surrogate: Surrogate, condition: HaemodynamicCondition, target: float, trials: Sequence[Trial]
) -> float:
    """Scale factor to try next.

    Args:
        surrogate: R0, and K where the curve is known; its own alpha is not used.
        condition: the resting condition.
        target: measured resting ratio [-].
        trials: runs so far; those whose ratio is not between 0 and 1 are ignored.

    Raises:
        ValueError: no run has a ratio between 0 and 1, or no scale factor reaches the target.
    """
    _check_target(target)
    usable = [trial for trial in trials if 0.0 < trial.ratio < 1.0 and 0.0 < trial.alpha < math.inf]
    if not usable:
        raise ValueError(
            f"No run gave a resting ratio between 0 and 1 ({[t.ratio for t in trials]}): alpha"
            " cannot be corrected. Look at the waveforms of the runs."
        )
    found = [(1.0 / surrogate_ratio(surrogate, condition, t.alpha), t) for t in usable]
    found.sort(key=lambda pair: abs(1.0 / pair[1].ratio - 1.0 / target))
    (S_0, first), *others = found
    S_1, y_1 = next(((S, t.ratio) for S, t in others if abs(S - S_0) > 1e-9 * S_0), (1.0, 1.0))
    slope = (1.0 / first.ratio - 1.0 / y_1) / (S_0 - S_1)
    if not (math.isfinite(slope) and slope > 0.0):
        slope = (1.0 / first.ratio - 1.0) / (S_0 - 1.0)
    goal = S_0 + (1.0 / target - 1.0 / first.ratio) / slope
    goal = max(goal, 1.0 + (S_0 - 1.0) / 10.0)  # a step too long would leave the range of S
    return float(calibrate_alpha(surrogate, condition, 1.0 / goal).alpha)


def calibrate_in_loop(
    surrogate: Surrogate,
    condition: HaemodynamicCondition,
    target: float,
    run: Callable[[float], float],
    starts: Sequence[float],
    *,
    tolerance: float = RATIO_TOLERANCE,
    max_extra: int = MOST_EXTRA_RUNS,
) -> LoopFit:
    """Correct α with runs in 3D until the resting ratio is the measured one.

    Args:
        surrogate: R0, and K where the curve is known.
        condition: the resting condition.
        target: measured resting ratio [-].
        run: gives the resting ratio in 3D with a scale factor.
        starts: scale factors of the first runs, from surrogates in ascending order of trust.
        tolerance: of the ratio [-].
        max_extra: runs beyond the first at most, those of further starts included.

    Returns:
        The best run and all of them; `reached` says whether it is near enough.

    Raises:
        ValueError: see `next_alpha`, there is no start, or the target does not lie between 0
            and 1.
    """
    _check_target(target)
    if not starts or not all(0.0 < alpha < math.inf for alpha in starts):
        raise ValueError(
            f"Scale factors to start with: {list(starts)}. Give at least one, all positive: that "
            "of the surrogate."
        )
    if not tolerance > 0.0:
        raise ValueError(f"tolerance = {tolerance} must be positive. Try {RATIO_TOLERANCE}.")
    trials: list[Trial] = []
    while len(trials) <= max_extra:
        if len(trials) < len(starts):
            alpha = starts[len(trials)]
        else:
            alpha = next_alpha(surrogate, condition, target, trials)
        trials.append(Trial(alpha, run(alpha)))
        if abs(trials[-1].ratio - target) <= tolerance:
            break
    best = min(range(len(trials)), key=lambda k: _distance(trials[k].ratio, target))
    return LoopFit(best, tuple(trials), abs(trials[best].ratio - target) <= tolerance)


def _check_target(target: float) -> None:
    if not 0.0 < target < 1.0:
        raise ValueError(
            f"A resting ratio of {target} cannot be reached: it must lie between 0 and 1. A value"
            " of 1 or more means no obstruction, or drift of the pressure wire."
        )


def _distance(ratio: float, target: float) -> float:
    """How far a ratio lies from the target; a run without a ratio lies farthest."""
    return abs(ratio - target) if math.isfinite(ratio) else math.inf
