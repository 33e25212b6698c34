"""Targets of a fit: measured numbers and waveforms, and the experiments behind them.

A target is any function of a `PeriodicSolution` that returns residuals in units of their standard
deviation, (predicted − measured)/sd. An experiment is any function of the model that returns all
residuals of one condition; `fit` takes one or several of them.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from lumped import (
    AbstractPeriodicSolver,
    AbstractWaveform,
    Fourier,
    HaemodynamicCondition,
    Network,
    PeriodicSolution,
    Shooting,
    StressRule,
    Surrogate,
    pressure_ratio,
    solve_periodic,
)
from lumped.parameters import Parameter, is_traced, nan_unless, parameter, real
from lumped.results import is_successful

Residuals = Callable[[PeriodicSolution], Float[Array, " k"]]
"""The protocol of a target."""


class Target(eqx.Module):
    """A measured number or waveform; make it with one of the functions below.

    Differentiated: value, sd, t. Static: kind, place.

    Attributes:
        kind: which quantity, a key of `QUANTITIES`.
        place: node or element it belongs to.
        value: measured values [CGS].
        sd: standard deviation of each value or of all [CGS].
        t: times of the samples [s], None for a single number.
    """

    kind: str = eqx.field(static=True)
    place: str = eqx.field(static=True)
    value: Parameter = parameter()
    sd: Parameter = parameter()
    t: Float[Array, "..."] | None = None

    def __check_init__(self):
        numbers = [self.value, self.sd] if self.t is None else [self.value, self.sd, self.t]
        if is_traced(*numbers) or not all(isinstance(n, Array) for n in numbers):
            return
        if not all(np.all(np.isfinite(np.asarray(number))) for number in numbers):
            raise ValueError(
                f"The {self.kind} of '{self.place}' has a value that is not finite. Leave gaps out."
            )
        if np.any(np.asarray(self.sd) <= 0):
            raise ValueError(
                f"The {self.kind} of '{self.place}' needs a positive standard deviation, in the "
                "unit of its values (CGS)."
            )

    def predicted(self, solution: PeriodicSolution) -> Array:
        """The values predicted by the periodic state."""
        return QUANTITIES[self.kind](solution, self.place, self.t)

    def __call__(self, solution: PeriodicSolution) -> Float[Array, " k"]:
        """(predicted − measured)/sd."""
        sd = self.sd * nan_unless(jnp.asarray(self.sd) > 0.0)
        return jnp.ravel((self.predicted(solution) - self.value) / sd)


def mean_pressure_target(node: str, value: Parameter, sd: Parameter) -> Target:
    """Cycle mean of a node's pressure [dyn/cm²]."""
    return Target("mean pressure", node, value, sd)


def mean_flow_target(element: str, value: Parameter, sd: Parameter) -> Target:
    """Cycle mean of the flow into an element's first port [cm³/s]."""
    return Target("mean flow", element, value, sd)


def systolic_target(node: str, value: Parameter, sd: Parameter) -> Target:
    """Largest pressure of a node [dyn/cm²].

    The largest sample is taken; its derivative is that at the sample's fixed time (envelope
    theorem). The value misses the true maximum by at most P″ dt²/8, dt being the sampling of the
    periodic solver.
    """
    return Target("systolic pressure", node, value, sd)


def diastolic_target(node: str, value: Parameter, sd: Parameter) -> Target:
    """Smallest pressure of a node [dyn/cm²]; see `systolic_target`."""
    return Target("diastolic pressure", node, value, sd)


def ratio_target(
    value: Parameter, sd: Parameter, *, proximal: str = "aorta", distal: str = "distal"
) -> Target:
    """Mean distal over mean proximal pressure: resting Pd/Pa at rest, FFR under stress [-]."""
    return Target("pressure ratio", f"{distal}/{proximal}", value, sd)


def waveform_target(node_or_element: str, t: ArrayLike, values: ArrayLike, sd: ArrayLike) -> Target:
    """Pressure of a node [dyn/cm²], or flow into an element's first port [cm³/s], in time.

    Args:
        node_or_element: whose waveform; a node where both bear the name.
        t: sample times [s] from the start of the cycle, also over several cycles, shape (k,).
        values: samples, shape (k,).
        sd: standard deviation of a sample: a number, or one for each, shape (k,).

    Raises:
        ValueError: times and values differ in shape.
    """
    if np.shape(t) != np.shape(values) or np.ndim(t) != 1:
        raise ValueError(
            f"The waveform of '{node_or_element}' has {np.shape(t)} times and {np.shape(values)} "
            "values. Give two columns of equal length."
        )
    return Target("waveform", node_or_element, real(values), real(sd), real(t))


def _waveform(solution: PeriodicSolution, place: str, t: Any) -> Array:
    is_node = place in solution.network.nodes
    samples = solution.pressure(place) if is_node else solution.flow(place)
    return interpolate(t, solution.t, samples, solution.period)


def _ratio(solution: PeriodicSolution, place: str, _: Any) -> Array:
    distal, proximal = place.split("/")
    return pressure_ratio(solution, proximal=proximal, distal=distal)


QUANTITIES: dict[str, Callable[[PeriodicSolution, str, Any], Array]] = {
    "mean pressure": lambda s, node, _: s.mean_pressure(node),
    "mean flow": lambda s, element, _: s.mean_flow(element),
    "systolic pressure": lambda s, node, _: jnp.max(s.pressure(node)),
    "diastolic pressure": lambda s, node, _: jnp.min(s.pressure(node)),
    "pressure ratio": _ratio,
    "waveform": _waveform,
}


def interpolate(
    at: Float[Array, " k"], t: Float[Array, " n"], values: Float[Array, " n"], period: Parameter
) -> Float[Array, " k"]:
    """Periodic samples at other times, by the cubic through the four nearest (Lagrange).

    Exact at the samples; fourth order between them, second where a slope jumps.

    Args:
        at: times asked for [s], in any cycle.
        t: sample times in [0, period), ascending.
        values: the samples.
        period: length of the cycle [s].
    """
    n = t.shape[0]
    phase = jnp.mod(at, period)
    left = jnp.clip(jnp.searchsorted(t, phase, side="right") - 1, 0, n - 1)
    index = left[:, None] + jnp.arange(-1, 3, dtype=left.dtype)[None, :]
    knots = t[index % n] + period * (index // n).astype(t.dtype)
    # distances in units of the interval keep the products near 1
    width = knots[:, 2] - knots[:, 1]
    s = (knots - phase[:, None]) / jnp.where(width > 0.0, width, 1.0)[:, None]
    # coinciding breakpoints repeat a time: of equal knots only the first counts
    kept = [jnp.all(s[:, :j] != s[:, j : j + 1], axis=1) for j in range(4)]
    total = jnp.zeros_like(phase)
    for i in range(4):
        weight = jnp.where(kept[i], 1.0, 0.0)
        for j in range(4):
            if j != i:
                gap = s[:, i] - s[:, j]
                factor = -s[:, j] / jnp.where(gap == 0.0, 1.0, gap)
                weight = weight * jnp.where(kept[j] & (gap != 0.0), factor, 1.0)
        total = total + weight * values[index[:, i] % n]
    return total


class NetworkExperiment(eqx.Module):
    """Targets measured on a network in its periodic state; a function of the network.

    Attributes:
        period: length of the cycle [s].
        targets: what was measured.
        solver: periodic solver; by default `Fourier` for linear networks, else `Shooting`.
    """

    period: Parameter = eqx.field(converter=real)
    targets: tuple[Residuals, ...] = eqx.field(converter=tuple)
    solver: AbstractPeriodicSolver | None = None

    def solution(self, network: Network) -> PeriodicSolution:
        """The periodic state that the model predicts."""
        solver = self.solver
        if solver is None:
            solver = Fourier() if network.is_linear else Shooting()
        return solve_periodic(network, self.period, solver, throw=False)

    def __call__(self, network: Network) -> Float[Array, " k"]:
        """All residuals in units of sd; infinite where no periodic state was found."""
        return _residuals(self.solution(network), self.targets)


class Experiment(eqx.Module):
    """Targets measured in one condition of a patient; a function of the surrogate.

    Attributes:
        condition: pressures and cycle length.
        targets: what was measured.
        rule: stress rule, None at rest.
        inlet: measured aortic pressure; by default that of the condition.
        solver: periodic solver; by default `Fourier` for linear surrogates, else `Shooting`.
    """

    condition: HaemodynamicCondition
    targets: tuple[Residuals, ...] = eqx.field(converter=tuple)
    rule: StressRule | None = None
    inlet: AbstractWaveform | None = None
    solver: AbstractPeriodicSolver | None = None

    def solution(self, surrogate: Surrogate) -> PeriodicSolution:
        """The periodic state that the model predicts."""
        network = surrogate.network(self.condition, rule=self.rule, inlet=self.inlet)
        return NetworkExperiment(self.condition.period, (), self.solver).solution(network)

    def __call__(self, surrogate: Surrogate) -> Float[Array, " k"]:
        """All residuals in units of sd; infinite where no periodic state was found."""
        return _residuals(self.solution(surrogate), self.targets)


def _residuals(solution: PeriodicSolution, targets: tuple[Residuals, ...]) -> Float[Array, " k"]:
    rows = [target(solution) for target in targets]
    all_rows = jnp.concatenate(rows) if rows else jnp.zeros(0)
    found = is_successful(solution.result)
    return jnp.where(found, all_rows, jnp.inf)
