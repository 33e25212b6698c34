"""General fits: any parameters of a model to any data, by damped least squares.

Minimised is  Σ r_i(x)² + Σ ((u_j − prior_j)/sd_j)²,  r being the residuals in units of their
standard deviation, by `optimistix.least_squares` in the unbounded variables of `free_parameter`;
the default solver is the Levenberg-Marquardt method of `gauss_newton`. Around the optimum the
posterior is taken as normal in the scaled variables u (Laplace), with the Gauss-Newton matrix JᵀJ
for its inverse covariance.

The derivative of the optimum with respect to everything else (data, held parameters, priors,
bounds) follows from the implicit-function theorem. Where the data leave a combination of
parameters undetermined it is that of the determined ones.
"""

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float, PRNGKeyArray

from calibration.free_parameter import (
    Coordinates,
    FreeParameter,
    as_free,
    check_start,
    coordinates,
    read,
    write,
)
from calibration.gauss_newton import DampedGaussNewton
from calibration.identifiability import identifiability, laplace_covariance
from calibration.optimum import Data, Fit, FitArrays, PlainFunction
from lumped import raise_unless_successful
from lumped.parameters import is_traced

HESSIAN_RANK = 1e-10
"""Eigenvalues of the Hessian below this share of the largest count as zero in derivatives."""

BATCH = 50
"""Fits advanced together; more exceed the caches of a CPU and are slower."""

CURE = (
    "Look at `identifiability`: give a prior to what the data do not determine, or hold it. Else "
    "start nearer, narrow the bounds, allow more `max_steps`, or try several `starts`."
)


def fit(
    model: Any,
    free: Sequence[FreeParameter | str],
    data: Data | Sequence[Data],
    *,
    solver: optx.AbstractLeastSquaresSolver | None = None,
    starts: int = 1,
    spread: float = 0.5,
    key: PRNGKeyArray | None = None,
    max_steps: int = 256,
    throw: bool = True,
) -> Fit:
    """Fit parameters of a model to data.

    Args:
        model: any pytree, such as a `Surrogate` or a `Network`; the fit starts at its values.
        free: the parameters to change; a name alone stands for `FreeParameter(name)`.
        data: experiments, or any functions of the model that return residuals in units of sd.
        solver: a least-squares solver of optimistix; by default `DampedGaussNewton()`.
        starts: number of starts; the first is the model's own values, the best one wins.
        spread: standard deviation of the other starts in the scaled variables.
        key: random key of the other starts; by default a fixed one.
        max_steps: steps allowed from each start.
        throw: raise when the solver fails (outside jit). With False look at `result`.

    Returns:
        The optimum with its uncertainty and what the data determine. Where residuals are not
        finite its numbers are NaN; where only the steps ran out they are those of the last one.

    Raises:
        ValueError: a parameter does not exist, or a start is outside its bounds.
        RuntimeError: the solver failed; the message says why and what to try.
    """
    free, data = as_free(free), as_data(data)
    _check_starts(starts)
    coordinates(model, free)
    key = jax.random.key(0) if key is None else key
    outcome = _fit_one(model, free, data, solver, starts, spread, key, max_steps)
    if throw:
        raise_unless_successful(outcome.result, CURE)
    return Fit(write(model, free, outcome.values), free, data, outcome, solver)


def fit_batch(
    models: Any,
    free: Sequence[FreeParameter | str],
    data: Data | Sequence[Data],
    *,
    solver: optx.AbstractLeastSquaresSolver | None = None,
    starts: int = 1,
    spread: float = 0.5,
    key: PRNGKeyArray | None = None,
    max_steps: int = 256,
    batch_size: int = BATCH,
    throw: bool = True,
) -> Fit:
    """Fit many patients; one compiled loop over chunks.

    Args:
        models: one model for all, or a stacked one whose arrays all have a leading patient axis.
        free: the parameters to change, bounds and priors shared by all.
        data: experiments whose arrays all have a leading patient axis; see `stacked`.
        solver: as in `fit`.
        starts: as in `fit`.
        spread: as in `fit`.
        key: as in `fit`; all patients get the same.
        max_steps: as in `fit`.
        batch_size: patients advanced together.
        throw: raise when a fit failed, naming the patients.

    Returns:
        A `Fit` whose arrays have a leading patient axis.

    Raises:
        ValueError: axes do not agree, or as in `fit`.
        RuntimeError: the solver failed for some.
    """
    free, data = as_free(free), as_data(data)
    _check_starts(starts)
    if batch_size < 1:
        raise ValueError(
            f"batch_size = {batch_size} patients are advanced together. Take one or more."
        )
    own = read(models, free)
    sizes = {leaf.shape[:1] for leaf in jax.tree.leaves(data) if eqx.is_array(leaf)}
    if own.ndim == 2:
        sizes |= {leaf.shape[:1] for leaf in jax.tree.leaves(models) if eqx.is_array(leaf)}
    if len(sizes) != 1 or () in sizes:
        raise ValueError(
            f"Leading axes of a batch must agree, found {sorted(sizes)}. Stack experiments (and "
            "models) of equal structure with `stacked`."
        )
    if not is_traced(own):
        check_start(free, np.asarray(own))
    key = jax.random.key(0) if key is None else key
    many = _fit_many(
        models, free, data, solver, starts, spread, key, max_steps, batch_size, own.ndim
    )
    if throw:
        flag = many.result == optx.RESULTS.successful
        lost = [] if is_traced(flag) else np.flatnonzero(~np.asarray(flag)).tolist()
        raise_unless_successful(many.result, f"It is about cases {lost}, counted from 0. {CURE}")
    fitted = eqx.tree_at(
        lambda m: [parameter.get(m) for parameter in free],
        models,
        [many.values[:, i] for i in range(len(free))],
    )
    return Fit(fitted, free, data, many, solver)


def _check_starts(starts: int):
    if starts < 1:
        raise ValueError(f"{starts} starts leave nothing to fit from. Ask for one or more.")


def stacked(items: Sequence[Any]) -> Any:
    """Stack models or experiments of equal structure along a new leading axis of all arrays."""
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *items)


def as_data(data: Data | Sequence[Data]) -> tuple[Data, ...]:
    """Data as a tuple of pytrees."""
    items = (data,) if callable(data) else data
    return tuple(item if _is_pytree(item) else PlainFunction(item) for item in items)


def _is_pytree(item: Data) -> bool:
    return isinstance(item, eqx.Module)


@eqx.filter_jit
def _fit_one(model, free, data, solver, starts, spread, key, max_steps) -> FitArrays:
    return minimise(model, free, data, solver, starts, spread, key, max_steps)


@eqx.filter_jit
def _fit_many(
    models, free, data, solver, starts, spread, key, max_steps, batch_size, ndim
) -> FitArrays:
    batched = (models, data) if ndim == 2 else data
    arrays, static = eqx.partition(batched, eqx.is_array)

    def one(case):
        whole = eqx.combine(case, static)
        model, own = whole if ndim == 2 else (models, whole)
        return minimise(model, free, own, solver, starts, spread, key, max_steps)

    return jax.lax.map(one, arrays, batch_size=batch_size)


def minimise(
    model: Any,
    free: tuple[FreeParameter, ...],
    data: tuple[Data, ...],
    solver: optx.AbstractLeastSquaresSolver | None,
    starts: int,
    spread: float,
    key: PRNGKeyArray,
    max_steps: int,
) -> FitArrays:
    """The fit itself, traceable: `fit` and `fit_batch` compile and check around it."""
    solver = DampedGaussNewton() if solver is None else solver
    axes = coordinates(model, free)
    arrays, static = eqx.partition((model, data, axes), eqx.is_array)

    def run(y0: Float[Array, " n"], inputs: Any) -> optx.Solution:
        return optx.least_squares(
            lambda y, args: _all_residuals(y, eqx.combine(args, static)),
            solver,
            y0,
            inputs,
            {"bend": eqx.combine(jax.lax.stop_gradient(inputs), static)[2].bend},
            max_steps=max_steps,
            adjoint=optx.ImplicitAdjoint(lx.SVD(rcond=HESSIAN_RANK)),
            throw=False,
        )

    y0, costs = axes.unbounded(axes.u_start), None
    if starts > 1:
        y0, costs = _best_start(run, axes, arrays, static, starts, spread, key)
    solution = run(jax.lax.stop_gradient(y0), arrays)
    u = axes.scaled(solution.value)

    def residuals(v):
        rows = data_residual(axes.values(v), model, free, data)
        return rows, rows

    jacobian, residual = jax.jacfwd(residuals, has_aux=True)(u)
    prior_residual, prior_jacobian = axes.prior_residual(u), jax.jacfwd(axes.prior_residual)(u)
    cost = jnp.sum(residual**2) + jnp.sum(prior_residual**2)
    at_bound = axes.at_bound(jax.lax.stop_gradient(u))
    known = jnp.isfinite(cost)
    return FitArrays(
        u=jnp.where(known, u, jnp.nan),
        values=jnp.where(known, axes.values(u), jnp.nan),
        slope=jnp.where(known, axes.slope(u), jnp.nan),
        residual=residual,
        prior_residual=prior_residual,
        jacobian=jacobian,
        prior_jacobian=prior_jacobian,
        covariance_scaled=laplace_covariance(
            jnp.concatenate([jacobian, prior_jacobian]), at_bound != 0
        ),
        at_bound=at_bound,
        identifiability=identifiability(
            jacobian, [p.name for p in free], logarithmic=[p.scale == "log" for p in free]
        ),
        start_costs=cost[None] if costs is None else costs,
        iterations=solution.stats["num_steps"],
        result=optx.RESULTS.where(jnp.isfinite(cost), solution.result, optx.RESULTS.nonfinite),
    )


def data_residual(
    values: Float[Array, " n"], model: Any, free: tuple[FreeParameter, ...], data: tuple[Data, ...]
) -> Float[Array, " k"]:
    """Residuals of all data at given values of the free parameters."""
    with jax.named_scope("fit.data"):
        candidate = write(model, free, values)
        return jnp.concatenate([item(candidate) for item in data])


def _all_residuals(y: Float[Array, " n"], inputs: Any) -> Float[Array, " kn"]:
    model, data, axes = inputs
    u = axes.scaled(y)
    own = data_residual(axes.values(u), model, axes.free, data)
    return jnp.concatenate([own, axes.prior_residual(u)])


def _best_start(
    run: Callable[..., optx.Solution],
    axes: Coordinates,
    arrays: Any,
    static: Any,
    starts: int,
    spread: float,
    key: PRNGKeyArray,
) -> tuple[Float[Array, " n"], Float[Array, " s"]]:
    """End of the best of several runs, and the cost that each reached; no derivatives."""
    arrays = jax.lax.stop_gradient(arrays)
    n = len(axes.free)
    away = spread * jax.random.normal(key, (starts, n)).at[0].set(0.0)
    y0 = jax.vmap(lambda shift: axes.unbounded(axes.u_start + shift))(away)

    def one(start):
        solution = run(start, arrays)
        residual = _all_residuals(solution.value, eqx.combine(arrays, static))
        cost = jnp.sum(residual**2)
        good = (solution.result == optx.RESULTS.successful) & jnp.isfinite(cost)
        return solution.value, jnp.where(good, cost, jnp.inf)

    ends, costs = jax.lax.map(one, jax.lax.stop_gradient(y0), batch_size=min(BATCH, starts))
    return ends[jnp.argmin(costs)], costs
