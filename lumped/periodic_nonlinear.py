"""Periodic states of any network: by Newton shooting, and by running cycles until they repeat."""

from typing import Any

import diffrax as dfx
import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float

from lumped.march import SCHEMES, Trajectory, aligned_times, march
from lumped.network import Network
from lumped.parameters import Parameter, real
from lumped.periodic_solution import (
    AbstractPeriodicSolver,
    PeriodicSolution,
    finite_or_singular,
    largest_difference,
    mean_start,
    sound,
)
from lumped.results import RESULTS, as_result, is_successful
from lumped.statespace import algebraic, field

LOOSER = 10.0
"""Factor on the tolerances of the run whose difference estimates the error of `Cycles`."""


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

    def __check_init__(self):
        if self.n_steps < 1 or self.order not in SCHEMES or self.tolerance <= 0.0:
            raise ValueError(
                f"Shooting(n_steps={self.n_steps}, order={self.order}, tolerance="
                f"{self.tolerance}): steps and tolerance must be positive, the order 1, 3 or 5."
            )

    @property
    def needs_index_one(self) -> bool:
        """False: the march keeps all unknowns."""
        return False

    def __call__(self, network: Network, period: Parameter) -> PeriodicSolution:
        """Find the periodic state; also of networks of index 2 (not with a vector field)."""
        n = network.n_states
        guess = jax.lax.stop_gradient(mean_start(network, period))
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
        return sound(
            PeriodicSolution(
                t=path.t[:-1],
                z=z,
                mean=path.integral / period,
                period=real(period),
                monodromy=monodromy,
                error_estimate=jnp.maximum(
                    _cycle_error(cycle(x0, args, 2).z[:, :n], path.z[::2, :n], monodromy),
                    path.defect,
                ),
                iterations=solution.stats["num_steps"],
                result=_finite(z, solution.result),
                network=network,
            )
        )


def _cycle_error(
    coarse: Float[Array, "j n"], fine: Float[Array, "j n"], monodromy: Float[Array, "n n"]
) -> Float[Array, ""]:
    """Error estimate from two marches of one cycle, with the error of the periodic start.

    An error e of the cycle's end moves the periodic start by (I − monodromy)⁻¹ e.
    """
    n = monodromy.shape[0]
    start = jnp.linalg.solve(jnp.eye(n) - monodromy, coarse[-1] - fine[-1])
    total = jnp.abs(coarse - fine) + jnp.abs(start)[None, :]
    return largest_difference(total, jnp.zeros_like(total), fine)


def _finite(z: Float[Array, "k m"], result: optx.RESULTS) -> RESULTS:
    """Result of a solver; a solution that is not finite takes precedence."""
    found = finite_or_singular(z)
    return RESULTS.where(is_successful(found), as_result(result), found)


class Cycles(AbstractPeriodicSolver):
    """Adaptive integration with diffrax, cycle after cycle until the state repeats.

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

    @property
    def needs_index_one(self) -> bool:
        """True: diffrax integrates a vector field."""
        return True

    def __call__(self, network: Network, period: Parameter) -> PeriodicSolution:
        """Find the periodic state.

        Raises:
            ValueError: (outside jit) the network is not of index 1.
        """
        n = network.n_states
        rate = field(network)
        guess = mean_start(network, period)
        scale = jax.lax.stop_gradient(jnp.max(jnp.abs(guess)) + 1e-300)
        args = (network, real(period))

        def repeat(xi: Float[Array, " n"], args: Any) -> Float[Array, " n"]:
            return self._cycle(rate, args, xi * scale, args[1][None])[0] / scale

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

        def rates(t: Any, y: Array, model: Network) -> Array:
            z = jnp.concatenate([y[:n], algebraic(t, model, y[:n])])
            return jnp.concatenate([model.residual(t, z)[:n] / model.mass(), z])

        ts = aligned_times(network, period, self.n_samples, grading=0.0)
        start = jnp.concatenate([xi * scale, jnp.zeros(network.n_unknowns)])
        y = self._cycle(rates, args, start, ts)
        x = y[:, :n]
        frozen = jax.lax.stop_gradient((args, xi * scale))
        loose = self._cycle(rate, *frozen, jax.lax.stop_gradient(ts), slack=LOOSER)
        w = jax.vmap(lambda t, x: algebraic(t, network, x))(ts[:-1], x[:-1])
        z = jnp.concatenate([x[:-1], w], axis=1)
        return sound(
            PeriodicSolution(
                t=ts[:-1],
                z=z,
                mean=y[-1, n:] / period,
                period=real(period),
                monodromy=monodromy,
                error_estimate=_cycle_error(loose, x, monodromy),
                iterations=solution.stats["num_steps"],
                result=_finite(z, solution.result),
                network=network,
            )
        )

    def _cycle(
        self, rate: Any, args: tuple[Network, Array], y0: Array, ts: Array, *, slack: float = 1.0
    ) -> Array:
        """States at some times of the cycle that starts from y₀."""
        network, T = args
        marks = jax.lax.stop_gradient(network.breakpoints(T))
        control = dfx.PIDController(rtol=slack * self.rtol, atol=slack * self.atol)
        solution = dfx.diffeqsolve(
            dfx.ODETerm(rate),
            dfx.Kvaerno5(),
            t0=0.0,
            t1=T,
            dt0=None,
            y0=y0,
            args=network,
            saveat=dfx.SaveAt(ts=ts),
            stepsize_controller=dfx.ClipStepSizeController(control, jump_ts=marks),
            adjoint=dfx.ForwardMode(),
            max_steps=None,
        )
        assert solution.ys is not None
        return solution.ys
