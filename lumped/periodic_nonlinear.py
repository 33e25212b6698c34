"""Periodic states of any network: by Newton shooting, and by running cycles until they repeat."""

from typing import Any

import diffrax as dfx
import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float

from lumped.march import Trajectory, aligned_times, march
from lumped.network import Network
from lumped.parameters import Parameter, real
from lumped.periodic_solution import (
    AbstractPeriodicSolver,
    PeriodicSolution,
    largest_difference,
    mean_state,
)
from lumped.statespace import algebraic, field


class Shooting(AbstractPeriodicSolver):
    """Newton's method on x(T; x₀) − x₀ = 0 with a fixed-step march of the cycle.

    The derivative of the periodic state follows the implicit-function theorem: of x₀ through
    optimistix' implicit adjoint, of the waveform through the one cycle that starts from it.

    Attributes:
        n_steps: least number of steps a period (static).
        order: order of the marching scheme, 1, 3 or 5 (static).
        tolerance: of x₀, relative to the largest state (static).
        max_iterations: Newton steps allowed (static).
    """

    n_steps: int = eqx.field(static=True, default=256)
    order: int = eqx.field(static=True, default=5)
    tolerance: float = eqx.field(static=True, default=1e-11)
    max_iterations: int = eqx.field(static=True, default=32)

    def __call__(self, network: Network, period: Parameter) -> PeriodicSolution:
        """Find the periodic state; also of networks of index 2 (not with a vector field)."""
        n = network.n_states
        guess = jax.lax.stop_gradient(mean_state(network, period))
        scale = jnp.max(jnp.abs(guess)) + 1e-300

        def cycle(x: Float[Array, " n"], args: Any, stride: int = 1) -> Trajectory:
            model, T = args
            ts = aligned_times(model, T, self.n_steps)[::stride]
            return march(ts, model, jnp.concatenate([x, guess[n:]]), order=self.order)

        def end(x: Float[Array, " n"], args: Any) -> Float[Array, " n"]:
            return cycle(x, args).z[-1, :n]

        def mismatch(xi: Float[Array, " n"], args: Any) -> Float[Array, " n"]:
            return end(xi * scale, args) / scale - xi

        newton = optx.Newton(rtol=self.tolerance, atol=self.tolerance)
        args = (network, real(period))
        solution = optx.root_find(
            mismatch, newton, guess[:n] / scale, args, max_steps=self.max_iterations, throw=False
        )
        x0 = solution.value * scale
        path = cycle(x0, args)
        monodromy = jax.jacfwd(end)(jax.lax.stop_gradient(x0), args)
        # before the first step only the states are known: the cycle's end is the same instant
        z = jnp.where((path.t <= 0.0)[:, None], path.z[-1:], path.z)[:-1]
        return PeriodicSolution(
            t=path.t[:-1],
            z=z,
            mean=path.integral / period,
            period=real(period),
            monodromy=monodromy,
            error_estimate=_shooting_error(path, cycle(x0, args, 2), monodromy),
            iterations=solution.stats["num_steps"],
            result=solution.result,
            network=network,
        )


def _shooting_error(
    path: Trajectory, coarse: Trajectory, monodromy: Float[Array, "n n"]
) -> Float[Array, ""]:
    """Difference to the march with half the steps, and what it does to the periodic start.

    An error e of the cycle's end moves the periodic start by (I − monodromy)⁻¹ e.
    """
    n = monodromy.shape[0]
    fine = path.z[::2, :n]
    gap = jnp.abs(coarse.z[:, :n] - fine)
    start = jnp.linalg.solve(jnp.eye(n) - monodromy, coarse.z[-1, :n] - fine[-1])
    total = gap + jnp.abs(start)[None, :]
    return jnp.maximum(largest_difference(total, jnp.zeros_like(total), fine), path.defect)


class Cycles(AbstractPeriodicSolver):
    """Adaptive diffrax cycles, repeated until the state after a cycle is the state before it.

    What simulation codes do; here with an implicit derivative, forward mode only (`jax.jvp`,
    `jax.jacfwd`). Slow: the cross-check, and the fallback where Newton's method fails.

    Attributes:
        rtol: relative tolerance of the integrator (static).
        atol: absolute tolerance, in the states' units (static).
        repeat: change over a cycle, relative to the largest state, that counts as none (static).
        max_cycles: cycles allowed (static).
        n_samples: output samples a period, besides breakpoints (static).
    """

    rtol: float = eqx.field(static=True, default=1e-9)
    atol: float = eqx.field(static=True, default=1e-5)
    repeat: float = eqx.field(static=True, default=1e-8)
    max_cycles: int = eqx.field(static=True, default=200)
    n_samples: int = eqx.field(static=True, default=256)

    def __call__(self, network: Network, period: Parameter) -> PeriodicSolution:
        """Find the periodic state.

        Raises:
            ValueError: (outside jit) the network is not of index 1.
        """
        n = network.n_states
        rate = field(network)
        guess = mean_state(network, period)
        scale = jax.lax.stop_gradient(jnp.max(jnp.abs(guess)) + 1e-300)
        marks = jax.lax.stop_gradient(network.breakpoints(period))
        control = dfx.ClipStepSizeController(
            dfx.PIDController(rtol=self.rtol, atol=self.atol), jump_ts=marks
        )

        def cycle(x: Float[Array, " n"], args: Any, saveat: dfx.SaveAt) -> Array:
            model, T = args
            solution = dfx.diffeqsolve(
                dfx.ODETerm(rate),
                dfx.Kvaerno5(),
                t0=0.0,
                t1=T,
                dt0=None,
                y0=x,
                args=model,
                saveat=saveat,
                stepsize_controller=control,
                adjoint=dfx.ForwardMode(),
                max_steps=None,
            )
            assert solution.ys is not None
            return solution.ys

        def repeat(xi: Float[Array, " n"], args: Any) -> Float[Array, " n"]:
            return cycle(xi * scale, args, dfx.SaveAt(t1=True))[0] / scale

        args = (network, jnp.asarray(period, float))
        iteration = optx.FixedPointIteration(rtol=self.repeat, atol=self.repeat)
        solution = optx.fixed_point(
            repeat,
            iteration,
            guess[:n] / scale,
            jax.lax.stop_gradient(args),
            max_steps=self.max_cycles,
            throw=False,
        )
        xi = jax.lax.stop_gradient(solution.value)
        monodromy = jax.lax.stop_gradient(jax.jacfwd(repeat)(xi, args))
        # one Newton step: nothing in value, the implicit-function theorem in derivative
        xi = xi + jnp.linalg.solve(jnp.eye(n) - monodromy, repeat(xi, args) - xi)
        x0 = xi * scale
        ts = aligned_times(network, period, self.n_samples)
        x = cycle(x0, args, dfx.SaveAt(ts=ts))
        w = jax.vmap(lambda t, y: algebraic(t, network, y))(ts, x)
        z = jnp.concatenate([x, w], axis=1)
        width = jnp.diff(ts)[:, None]
        return PeriodicSolution(
            t=ts[:-1],
            z=z[:-1],
            mean=jnp.sum(0.5 * width * (z[1:] + z[:-1]), axis=0) / period,
            period=period,
            monodromy=monodromy,
            error_estimate=largest_difference(x[-1], x0, x),
            iterations=solution.stats["num_steps"],
            result=solution.result,
            network=network,
        )
