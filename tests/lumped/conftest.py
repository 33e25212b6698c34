"""Shared by the tests of the lumped models: conditions, tight integration, gradient checks."""

from collections.abc import Callable
from typing import Any

import diffrax as dfx
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lumped import HaemodynamicCondition, Network, condition_from_clinic
from lumped.statespace import algebraic, field


@pytest.fixture(scope="session")
def rest() -> HaemodynamicCondition:
    return condition_from_clinic(110.0, 65.0, 0.8)


@pytest.fixture(scope="session")
def tight_cycle() -> Callable[..., np.ndarray]:
    """Unknowns at times of the last of many cycles, by explicit diffrax with rtol 1e-12."""

    def integrate(network: Network, period: float, ts: Any, x0: Any, *, cycles: int = 12):
        ts = np.asarray(ts)
        order = np.argsort(ts, kind="stable")
        rate = field(network)

        @jax.jit
        def run(x0, ts):
            marks = network.breakpoints(period)[:-1]
            starts = jnp.arange(cycles, dtype=float) * period
            jumps = (starts[:, None] + marks[None, :]).reshape(-1)[1:]
            control = dfx.ClipStepSizeController(
                dfx.PIDController(rtol=1e-12, atol=1e-9), jump_ts=jumps
            )
            solution = dfx.diffeqsolve(
                dfx.ODETerm(rate),
                dfx.Dopri8(),
                t0=0.0,
                t1=cycles * period,
                dt0=None,
                y0=x0,
                saveat=dfx.SaveAt(ts=(cycles - 1) * period + ts),
                stepsize_controller=control,
                max_steps=None,
            )
            w = jax.vmap(lambda t, x: algebraic(t, network, x))(ts, solution.ys)
            return jnp.concatenate([solution.ys, w], axis=1)

        z = np.empty((ts.size, network.n_unknowns))
        z[order] = run(jnp.asarray(x0), jnp.asarray(ts[order]))
        return z

    return integrate


@pytest.fixture(scope="session")
def assert_gradient() -> Callable[..., None]:
    """Compare a gradient with five-point central differences, parameter by parameter.

    The stencil with a relative step of 2e-3 leaves about 1e-10 of truncation and rounding.
    """

    def check(f: Callable[[Any], Any], tree: Any, *, tolerance: float = 1e-7, step: float = 2e-3):
        both = jax.jit(jax.value_and_grad(f))  # one program, also for the differences
        value, gradient = both(tree)
        leaves, structure = jax.tree.flatten(tree)
        size = abs(float(value))
        assert size > 0.0
        for k, (slope, (path, leaf)) in enumerate(
            zip(jax.tree.leaves(gradient), jax.tree_util.tree_leaves_with_path(tree), strict=True)
        ):

            def moved(amount: float, k: int = k, leaf: Any = leaf) -> float:
                changed = jnp.asarray(leaf * (1.0 + amount) if leaf != 0.0 else leaf + amount)
                shifted = [*leaves[:k], changed, *leaves[k + 1 :]]
                return float(both(jax.tree.unflatten(structure, shifted))[0])

            difference = (
                8.0 * (moved(step) - moved(-step)) - (moved(2 * step) - moved(-2 * step))
            ) / (12.0 * step)
            elasticity = float(slope * (leaf if leaf != 0.0 else 1.0))
            name = jax.tree_util.keystr(path)
            assert abs(elasticity - difference) <= tolerance * size, (name, elasticity, difference)

    return check


@pytest.fixture(scope="session")
def solved() -> Callable[..., Any]:
    """`solve_periodic` under jit."""
    from lumped import solve_periodic

    @eqx.filter_jit
    def solve(network, period, solver=None):
        return solve_periodic(network, period, solver, throw=False)

    return solve
