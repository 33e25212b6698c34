"""Fit, evidence and predicted signals of one hypothesis.

The fit minimises |W (y − f)|² + |x|² with exact equations by the Levenberg-Marquardt method of
`descent`. Its evidence is taken about the optimum and about posterior means with guessed equations,
see `likeliest_kind`.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from diagnosis.circuit import SensorSpectra
from diagnosis.descent import Descent, descend
from diagnosis.effects import Effect
from diagnosis.evidence import Whitened
from diagnosis.form_columns import Freedom
from diagnosis.hypothesis import (
    FITTED,
    Catalogue,
    effect_sizes,
    guessed_widths,
    of_kind,
    one_sided_unknowns,
    places_of,
    sensor_model,
    uncertain_signals,
    whitened_by_condition,
)
from diagnosis.likeliest_kind import in_units_of, likeliest_kind
from diagnosis.measured import Measured, data_of, whitener_of
from diagnosis.prediction import (
    as_waves,
    n_unknowns,
    selection,
)

_REFINED = np.array([1, 2, 0])
"""Points at which a fit is linearised: its optimum, then posterior means with the freedom of a
guessed form, and of a bed of another structure as well. Position in `KINDS` of the equations that
lead to the next point, 0 at the last."""


class Fitted(NamedTuple):
    """A fitted hypothesis.

    Attributes:
        x: posterior mean, standardised: unknowns of the base model and two sizes.
        optimum: the same with exact equations, where the fit ended.
        log_evidence: ln Z up to a constant of the record.
        kinds: probabilities of what its equations are, of `KINDS`.
        chi2: Σ of squared whitened residuals.
        misfit: the same in units of noise and form tolerance together.
        cost: least |W (y − f)|² + |x|², without form tolerance.
        residual: whitened residuals by condition.
        sizes: size of every effect of the catalogue [its unit].
        size_sd: posterior standard deviations of the two sizes [their units].
        waves: predicted signals of the sensors, conditions × 3 sensors × samples
            [dyn/cm², cm³/s].
        sound: whether the result is finite.
    """

    x: Float[Array, "*b k"]
    optimum: Float[Array, "*b k"]
    log_evidence: Float[Array, "*b"]
    kinds: Float[Array, "*b 3"]
    chi2: Float[Array, "*b"]
    misfit: Float[Array, "*b"]
    cost: Float[Array, "*b"]
    residual: Float[Array, "*b c d"]
    sizes: Float[Array, "*b e"]
    size_sd: Float[Array, "*b 2"]
    waves: Float[Array, "*b c 3 n"]
    sound: Bool[Array, "*b"]


def towards_optimum(
    measured: Measured,
    effects: Sequence[Effect],
    numbers: Catalogue,
    pair: Int[Array, " 2"],
    begun: Descent,
    fixed_size: Float[ArrayLike, ""],
    steps: Int[ArrayLike, ""],
    *,
    nonlinear: bool,
) -> Descent:
    """Some steps of a fit with exact equations.

    Arguments are those of `fit_about`, where the fit stands, and the number of steps.
    """
    model = _whitened_model(measured, effects, numbers, pair, fixed_size, nonlinear=nonlinear)
    observed = whitener_of(measured)(data_of(measured))
    return descend(lambda x: model(x)[:2], observed, begun, steps)


def _whitened_model(
    measured: Measured,
    effects: Sequence[Effect],
    numbers: Catalogue,
    pair: Int[Array, " 2"],
    fixed_size: Float[ArrayLike, ""],
    *,
    nonlinear: bool,
) -> Callable[[Array], tuple[Array, Array, SensorSpectra]]:
    """Whitened prediction, derivative and signals of a hypothesis as a function of x."""
    beat = sensor_model(effects, numbers, pair, fixed_size, nonlinear=nonlinear)
    chooser = jnp.asarray(selection(measured.n_conditions, 2))
    return whitened_by_condition(beat, measured, chooser)


def fit_about(
    measured: Measured,
    effects: Sequence[Effect],
    numbers: Catalogue,
    pair: Int[Array, " 2"],
    optimum: Float[Array, " k"],
    fixed_size: Float[ArrayLike, ""] = FITTED,
    *,
    nonlinear: bool,
) -> Fitted:
    """Evidence and posterior of a hypothesis about the optimum of its fit.

    Args:
        measured: the record.
        effects: the catalogue (static).
        numbers: of the catalogue.
        pair: positions of the two effects, −1 for none.
        optimum: of exact equations, standardised.
        fixed_size: fixed standardised size of the first effect, the evidence being conditional on
            it; or `FITTED`.
        nonlinear: whether any of the two makes the ostium nonlinear (static).
    """
    k, W = n_unknowns(measured), whitener_of(measured)
    model = _whitened_model(measured, effects, numbers, pair, fixed_size, nonlinear=nonlinear)
    observed = W(data_of(measured))
    sided = one_sided_unknowns(measured, numbers, pair)
    width = jnp.asarray(guessed_widths(k + 2))

    def about(x: Array) -> tuple[Array, Whitened, SensorSpectra]:
        """The model linearised at x, and its signals."""
        # below zero a one-sided size is flat and has no derivative: linearise at zero
        inside = jnp.where(sided > 0.5, jnp.maximum(x, 0.0), x)
        value, J, seen = model(inside)
        return inside, Whitened(observed - value + J @ inside, J), seen

    def with_freedom(linear: Whitened, x: Array, kind: Array) -> tuple[Array, Freedom]:
        """Posterior mean of the linearised model with guessed equations, and their freedom."""
        uncertain = uncertain_signals(
            measured, effects, numbers, pair, x, fixed_size, nonlinear=nonlinear
        )
        freedoms = uncertain.freedoms(W, with_bed=False)
        after = of_kind(freedoms, kind).posterior(in_units_of(width, linear), sided)
        return width * after.mean, freedoms

    def refined(x: Array, kind: Array) -> tuple[Array, tuple]:
        inside, linear, seen = about(x)
        given = linear, inside, kind
        nothing = jax.tree.map(
            lambda leaf: jnp.zeros(leaf.shape), jax.eval_shape(with_freedom, *given)
        )
        mean, freedoms = jax.lax.cond(kind > 0, with_freedom, lambda *_: nothing, *given)
        return mean, (inside, linear, freedoms, seen)

    # the optimum assumes exact equations: iterate the posterior mean with their uncertainty; one
    # loop compiles in half the time of three calls
    _, (points, linears, freedoms, signals) = jax.lax.scan(refined, optimum, jnp.asarray(_REFINED))
    freedoms = jax.tree.map(lambda a: a[1], freedoms)
    found = likeliest_kind(points, linears, freedoms, width, pair, sided)
    x = points[found.at]
    waves = jax.vmap(as_waves)(jax.tree.map(lambda a: a[found.at], signals))
    sd = jnp.sqrt(jnp.diagonal(found.after.covariance)[k:])
    sd = sd * (places_of(numbers, pair) @ numbers.sd)
    chi2 = jnp.sum(found.residual**2)
    sound = jnp.isfinite(found.log_Z) & jnp.isfinite(chi2)
    log_Z = jnp.where(sound, found.log_Z, -jnp.inf)
    cost = jnp.sum((linears.e[0] - linears.J[0] @ points[0]) ** 2) + jnp.sum(points[0] ** 2)
    x = x.at[k].set(jnp.where(jnp.isnan(fixed_size), x[k], fixed_size))
    sizes = effect_sizes(numbers, pair, x[k:])
    return Fitted(
        x, optimum, log_Z, found.kinds, chi2, found.misfit, cost, found.residual, sizes, sd,
        waves, sound,
    )  # fmt: skip
