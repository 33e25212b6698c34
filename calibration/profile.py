"""Profile likelihood: the cost along one parameter, all others re-fitted."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from calibration.fit import BATCH, data_residual, minimise
from calibration.free_parameter import check_start, coordinates, write
from calibration.optimum import Fit

MAX_STEPS = 256
"""Solver steps allowed at each value."""


class Profile(eqx.Module):
    """Cost along one parameter, all others re-fitted at each value.

    Attributes:
        name: the parameter (static).
        values: its values, shape (k,).
        rise: cost above the optimum; ((u − û)/sd)² where the posterior is normal.
        others: the other parameters' values, shape (k, n − 1), in the order of the fit.
        result: `optimistix.RESULTS` of each.
    """

    name: str = eqx.field(static=True)
    values: Float[Array, " k"]
    rise: Float[Array, " k"]
    others: Float[Array, "k n1"]
    result: optx.RESULTS


def profile(optimum: Fit, name: str, values: Sequence[float] | Float[Array, " k"]) -> Profile:
    """Profile likelihood of one parameter: the check of the Laplace approximation.

    Args:
        optimum: a single fit.
        name: the parameter to step along.
        values: where [unit of the parameter]; the prior of the parameter is kept.

    Raises:
        ValueError: the fit has no such parameter.
    """
    if name not in optimum.names:
        raise ValueError(f"The fit has no '{name}'. It has: {', '.join(optimum.names)}.")
    k = optimum.names.index(name)
    at, rest = optimum.free[k], optimum.free[:k] + optimum.free[k + 1 :]
    steps = jnp.asarray(values, float)
    check_start((at,), np.asarray(steps)[:, None])
    costs, others, result = _profile(optimum.model, at, rest, optimum.data, optimum.solver, steps)
    return Profile(name, steps, costs - optimum.cost, others, result)


@eqx.filter_jit
def _profile(model, at, rest, data, solver, steps):
    def one(value):
        fixed = write(model, (at,), value[None])
        axis = coordinates(fixed, (at,))
        own = jnp.sum(axis.prior_residual(axis.u_start) ** 2)
        if not rest:
            residual = data_residual(value[None], model, (at,), data)
            return jnp.sum(residual**2) + own, jnp.zeros(0), optx.RESULTS.successful
        outcome = minimise(fixed, rest, data, solver, 1, 0.0, jax.random.key(0), MAX_STEPS)
        cost = jnp.sum(outcome.residual**2) + jnp.sum(outcome.prior_residual**2)
        return cost + own, outcome.values, outcome.result

    # `lax.map` cannot chunk empty results, and without other parameters there is nothing to chunk
    return jax.lax.map(one, steps, batch_size=BATCH) if rest else jax.vmap(one)(steps)
