"""Interface and result of the periodic solvers, and exact cycle means."""

import abc
from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from lumped.march import newton
from lumped.network import Network, jacobian
from lumped.parameters import Parameter, in_range, nan_unless, only_if, real
from lumped.results import RESULTS, as_result, is_successful
from lumped.waveforms import AbstractWaveform

MEAN_NODES = 72
"""Quadrature nodes a stretch between breakpoints, for the mean of the sources."""

TRACE_NODES = 8
"""The same for waveforms of many stretches (samples), which are cubic in each."""

REST_TOLERANCE = 1e-8
"""Last correction of a nonlinear steady state, relative to the largest unknown."""


class PeriodicSolution(eqx.Module):
    """One period of a network in its periodic state.

    Attributes:
        t: times [s] in [0, period), shape (k,).
        z: all unknowns at these times, shape (k, n_unknowns).
        mean: cycle mean of all unknowns, shape (n_unknowns,).
        period: length of the cycle [s].
        monodromy: derivative of the state after a cycle with respect to the state before it.
        error_estimate: estimated error of the states, relative to their largest values [-].
        iterations: Newton steps or cycles taken.
        result: `lumped.RESULTS`, successful or the reason why not; all numbers are then NaN.
        network: the network that was solved.
    """

    t: Float[Array, " k"]
    z: Float[Array, "k m"]
    mean: Float[Array, " m"]
    period: Parameter
    monodromy: Float[Array, "n n"]
    error_estimate: Float[Array, ""]
    iterations: Any
    result: RESULTS = eqx.field(converter=as_result)
    network: Network

    def pressure(self, node: str) -> Float[Array, " k"]:
        """Pressure of a node [dyn/cm²] at `t`."""
        return self.z[:, self.network.pressure_index(node)]

    def flow(self, name: str, port: int = 0) -> Float[Array, " k"]:
        """Flow into a port of an element [cm³/s] at `t`."""
        return self.z[:, self.network.flow_index(name, port)]

    def state(self, name: str, state: str) -> Float[Array, " k"]:
        """A state of an element at `t`."""
        return self.z[:, self.network.state_index(name, state)]

    def mean_pressure(self, node: str) -> Float[Array, ""]:
        """Cycle mean of a node's pressure [dyn/cm²]."""
        return self.mean[self.network.pressure_index(node)]

    def mean_flow(self, name: str, port: int = 0) -> Float[Array, ""]:
        """Cycle mean of the flow into a port of an element [cm³/s]."""
        return self.mean[self.network.flow_index(name, port)]

    @property
    def initial(self) -> Float[Array, " m"]:
        """All unknowns at t = 0, from which a 3D run or a march starts without a transient."""
        return self.z[0]

    @property
    def floquet_multiplier(self) -> float:
        """Largest factor by which a disturbance shrinks in a cycle (concrete solutions only)."""
        if self.monodromy.shape[-1] == 0:
            return 0.0
        if not np.all(np.isfinite(self.monodromy)):
            return float("nan")
        return float(np.max(np.abs(np.linalg.eigvals(np.asarray(self.monodromy)))))

    def cycles_to(self, tolerance: float) -> float:
        """Cycles after which a disturbance has shrunk to `tolerance` of its size.

        Raises:
            ValueError: the tolerance does not lie between 0 and 1.
        """
        if not 0.0 < tolerance < 1.0:
            raise ValueError(f"tolerance = {tolerance} must lie between 0 and 1. Try 1e-6.")
        multiplier = self.floquet_multiplier
        if multiplier <= 0.0:
            return 1.0
        return float("inf") if multiplier >= 1.0 else np.log(tolerance) / np.log(multiplier)


class AbstractPeriodicSolver(eqx.Module):
    """A way to find the periodic state of a network."""

    @property
    @abc.abstractmethod
    def needs_index_one(self) -> bool:
        """Whether the network's closures must determine its algebraic unknowns."""

    @abc.abstractmethod
    def __call__(self, network: Network, period: Parameter) -> PeriodicSolution:
        """Find the periodic state."""


def largest_difference(
    coarse: Float[Array, "j n"], fine: Float[Array, "j n"], x: Float[Array, "k n"]
) -> Float[Array, ""]:
    """Largest |coarse − fine| of any state, relative to the state's largest value in x."""
    if x.shape[1] == 0:
        return jnp.zeros(())
    size = jnp.max(jnp.abs(x), axis=0) + 1e-300
    return jax.lax.stop_gradient(jnp.max(jnp.abs(coarse - fine) / size[None, :]))


def finite_or_singular(*parts: Array) -> RESULTS:
    """The result of a direct solution: successful where it is finite, singular where not.

    Args:
        parts: what decides the solution; all of it would have to be computed to look at it.
    """
    finite = jnp.all(jnp.stack([jnp.all(jnp.isfinite(part)) for part in parts]))
    return RESULTS.where(finite, cast(Any, RESULTS.successful), cast(Any, RESULTS.singular))


def sound(solution: PeriodicSolution) -> PeriodicSolution:
    """Replace the numbers of a failed solution by NaN and state the reason in `result`.

    Parameters outside their ranges, which only traced ones can be, have periodic states too.
    """
    result = checked_result(solution.network, solution.period, solution.result)
    numbers = (solution.z, solution.mean, solution.monodromy, solution.error_estimate)
    numbers = only_if(is_successful(result), numbers, (solution.network, solution.period))
    return eqx.tree_at(
        lambda s: (s.z, s.mean, s.monodromy, s.error_estimate, s.result),
        solution,
        (*numbers, result),
    )


def checked_result(network: Network, period: Parameter, result: RESULTS) -> RESULTS:
    """The result; a parameter or period outside its range takes precedence."""
    T = real(period)
    usable = in_range(network) & jnp.all(jnp.isfinite(T) & (T > 0.0))
    return as_result(RESULTS.where(usable, result, cast(Any, RESULTS.outside_range)))


def waveform_mean(waveform: AbstractWaveform, period: Parameter) -> Array:
    """Mean of a waveform over a period, by quadrature between its breakpoints.

    Gauss–Legendre in s with t = t_left + h s² (3 − 2 s): the nodes crowd at the ends, where the
    ventricle's bump is not analytic (its mean to 1e-13; without the substitution 3e-10).
    """
    T = jnp.reshape(jnp.asarray(period, float), (1,))
    marks = jnp.sort(jnp.concatenate([jnp.zeros(1), jnp.mod(waveform.breakpoints(), T), T]))
    h = jnp.diff(marks)
    few = h.shape[0] <= 8
    nodes, weights = np.polynomial.legendre.leggauss(MEAN_NODES if few else TRACE_NODES)
    s = 0.5 * (1.0 + nodes)
    share, weights = s**2 * (3.0 - 2.0 * s), 3.0 * weights * s * (1.0 - s)
    ts = marks[:-1, None] + h[:, None] * jnp.asarray(share)[None, :]
    values = jax.vmap(jax.vmap(waveform))(ts)
    return jnp.einsum("s,q,sq->", h, jnp.asarray(weights), values) / period


def averaged(network: Network, period: Parameter) -> Network:
    """The network with every waveform replaced by its mean: the direct-current network."""
    return network.with_sources([waveform_mean(w, period) for w in network.waveforms()])


def steady_state(network: Network) -> Float[Array, " m"]:
    """Unknowns of a network at rest under constant sources, residual(z) = 0.

    One linear solve for linear networks; Newton's method, without derivatives, for others. NaN
    where there is no such state, or a traced parameter lies outside its range.
    """
    z, found = rest_state(network)
    return z * nan_unless(found & in_range(network))


def rest_state(network: Network) -> tuple[Float[Array, " m"], Bool[Array, ""]]:
    """Steady state under the sources at t = 0 as a constant start, and whether it was found."""
    zero = jnp.zeros(network.n_unknowns)
    if network.is_linear:
        z = jnp.linalg.solve(jacobian(network, 0.0, zero), -network.residual(0.0, zero))
        return z, jnp.all(jnp.isfinite(z))

    def correction(z: Array) -> Array:
        return jnp.linalg.solve(jacobian(network, 0.0, z), network.residual(0.0, z))

    z, size = newton(correction, zero + 1.0)  # at rest a quadratic loss has no slope
    start = jax.lax.stop_gradient(jnp.nan_to_num(z, nan=1.0, posinf=1.0, neginf=1.0))
    return start, size < REST_TOLERANCE


@jax.jit
def mean_state(network: Network, period: Parameter) -> Float[Array, " m"]:
    """Solution of the direct-current network: the exact cycle mean of a linear network.

    For a nonlinear network it is the steady state under the mean of the sources, which is not the
    mean of its periodic state but a good place to start from. NaN as from `steady_state`.
    """
    usable = in_range(network) & jnp.isfinite(period) & (period > 0.0)
    return steady_state(averaged(network, period)) * nan_unless(usable)


@jax.jit
def mean_start(network: Network, period: Parameter) -> Float[Array, " m"]:
    """Steady state under the mean of the sources, as a constant start of solvers."""
    return rest_state(averaged(network, period))[0]
