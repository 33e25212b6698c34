"""Hypotheses "none", one effect, or two effects: fit, evidence and predicted signals.

All are one compiled function of the record and the positions i, j of the effects in the catalogue
(−1 for none), so that records and effects are batched by one map. Unknowns are those of
the base model and the standardised sizes of the two effects; an unused size has no effect on
anything and its prior integrates to one. The fit minimises |W (y − f)|² + |x|² by the
Levenberg-Marquardt method of `descent`, from the base optimum on, so that it cannot end above
it.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from diagnosis.circuit import SensorSpectra
from diagnosis.descent import descend
from diagnosis.effects import SCALE, Effect, bounded_size
from diagnosis.evidence import Posterior, Whitened, log_moment, posterior
from diagnosis.form_columns import form_columns, without_form
from diagnosis.measured import Measured, Whitener, data_of, whitener_of
from diagnosis.prediction import (
    OWN,
    ConditionSettings,
    as_waves,
    condition_settings,
    n_unknowns,
    observations,
    predict,
    selection,
)

REFINED = 3
"""Points at which a fit is linearised: its optimum, then two posterior means."""

BOTH = np.ones(2)
"""Shares of both effects of a hypothesis."""

FITTED = np.nan
"""In place of a fixed size: the size is an unknown of the fit."""


class Fitted(NamedTuple):
    """A fitted hypothesis.

    Attributes:
        x: posterior mean, standardised: unknowns of the base model and two sizes.
        log_evidence: ln Z up to a constant of the record.
        exact: probability that its equations are exact, against guessed ones.
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
    log_evidence: Float[Array, "*b"]
    exact: Float[Array, "*b"]
    chi2: Float[Array, "*b"]
    misfit: Float[Array, "*b"]
    cost: Float[Array, "*b"]
    residual: Float[Array, "*b c d"]
    sizes: Float[Array, "*b e"]
    size_sd: Float[Array, "*b 2"]
    waves: Float[Array, "*b c 3 n"]
    sound: Bool[Array, "*b"]


class Catalogue(NamedTuple):
    """The numbers of a list of effects, as arrays.

    Attributes:
        sd: width s of each size's prior, see `effects`.
        one_sided: 1 where only positive sizes exist.
        tolerance: freedom of the form.
    """

    sd: Float[Array, " e"]
    one_sided: Float[Array, " e"]
    tolerance: Float[Array, " e"]


def numbers_of(effects: Sequence[Effect], prior_scale: float = 1.0) -> Catalogue:
    """The numbers of effects; `prior_scale` multiplies the width of every prior."""
    return Catalogue(
        jnp.asarray(np.array([prior_scale * SCALE * e.sd for e in effects])),
        jnp.asarray(np.array([float(e.one_sided) for e in effects])),
        jnp.asarray(np.array([e.tolerance for e in effects])),
    )


def fit_hypothesis(
    measured: Measured,
    effects: Sequence[Effect],
    numbers: Catalogue,
    pair: Int[Array, " 2"],
    start: Float[Array, " k"],
    fixed_size: Float[ArrayLike, ""] = FITTED,
    *,
    nonlinear: bool,
) -> Fitted:
    """Fit one hypothesis to one record.

    Args:
        measured: the record.
        effects: the catalogue (static).
        numbers: of the catalogue.
        pair: positions of the two effects, −1 for none.
        start: where the fit starts, standardised.
        fixed_size: fixed standardised size of the first effect, the evidence being conditional on
            it; or `FITTED`.
        nonlinear: whether any of the two makes the ostium nonlinear (static).
    """
    k = n_unknowns(measured)
    W, data, cases = whitener_of(measured), data_of(measured), condition_settings(measured)
    chooser = jnp.asarray(selection(measured.n_conditions, 2))
    beat = sensor_model(effects, numbers, pair, fixed_size, nonlinear=nonlinear)

    def seen(case: ConditionSettings, own: Array) -> Array:
        return observations(beat(case, own), measured.n_sensors)

    slopes = whitened_by_condition(seen, W, cases, chooser)
    observed = W(data)
    optimum, value, _ = descend(slopes, observed, start)
    cost = jnp.sum((observed - value) ** 2) + jnp.sum(optimum**2)
    sided = one_sided_unknowns(measured, numbers, pair)

    def about(x: Array) -> tuple[Array, Whitened]:
        """The model linearised at x."""
        # below zero a one-sided size is flat and has no derivative: linearise at zero
        inside = jnp.where(sided > 0.5, jnp.maximum(x, 0.0), x)
        value, J = slopes(inside)
        return inside, Whitened(observed - value + J @ inside, J)

    def refined(x: Array, _: None) -> tuple[Array, tuple[Array, Whitened, Array, Array]]:
        """The posterior mean, with the uncertainty of the equations, of the model about x."""
        inside, linear = about(x)
        own = uncertain_signals(
            measured, effects, numbers, pair, inside, fixed_size, nonlinear=nonlinear
        )
        F = own.columns(W)
        return posterior(linear, F, sided).mean, (inside, linear, F, own.waves)

    # the optimum assumes exact equations: iterate the posterior mean with their uncertainty; that
    # of the last point is not used, but one loop compiles in half the time of three calls
    _, (points, linears, every_F, every_waves) = jax.lax.scan(refined, optimum, length=REFINED)
    found = _likelier(points, linears, every_F[-2], pair, sided)
    x, waves = points[found.at], every_waves[found.at]
    sd = jnp.sqrt(jnp.diagonal(found.after.covariance)[k:])
    sd = sd * (places_of(numbers, pair) @ numbers.sd)
    chi2 = jnp.sum(found.residual**2)
    sound = jnp.isfinite(found.log_Z) & jnp.isfinite(chi2)
    log_Z = jnp.where(sound, found.log_Z, -jnp.inf)
    x = x.at[k].set(jnp.where(jnp.isnan(fixed_size), x[k], fixed_size))
    sizes = effect_sizes(numbers, pair, x[k:])
    residual, exact = found.residual, found.exact
    return Fitted(x, log_Z, exact, chi2, found.misfit, cost, residual, sizes, sd, waves, sound)


class _Likelier(NamedTuple):
    """A hypothesis with exact or with guessed equations, whichever is likelier.

    Attributes:
        at: position of its point.
        after: posterior there.
        residual: whitened residuals there.
        misfit: see `Fitted`.
        log_Z: evidence of both.
        exact: see `Fitted`.
    """

    at: Int[Array, ""]
    after: Posterior
    residual: Float[Array, "c d"]
    misfit: Float[Array, ""]
    log_Z: Float[Array, ""]
    exact: Float[Array, ""]


def _likelier(
    points: Float[Array, "t k"],
    linears: Whitened,
    F: Float[Array, "c d m"],
    pair: Int[Array, " 2"],
    sided: Float[Array, " k"],
) -> _Likelier:
    """Evidence of a hypothesis whose equations are exact or guessed, which is as likely.

    Guessed equations alone would count against a strong effect: the volume of their freedom grows
    with it, though the record shows that the form fits.

    Args:
        points: the optimum of exact equations, then posterior means of guessed ones.
        linears: the model about each.
        F: columns of the form tolerance.
        pair: positions of the effects, −1 for none.
        sided: 1 for unknowns that only exist above zero.
    """
    residuals = jax.vmap(lambda x, linear: linear.e - linear.J @ x)(points, linears)
    misfits = without_form(residuals, F)
    each = misfits + jnp.sum(points**2, axis=1)
    best = jnp.argmin(jnp.where(jnp.isfinite(each), each, jnp.inf))

    def judged(at: Array | int, F: Array | None) -> tuple[Posterior, Array]:
        after = posterior(jax.tree.map(lambda a: a[at], linears), F, sided)
        log_Z = after.log_evidence + log_prior_of_sizes(after, pair, sided)
        return after, jnp.where(jnp.isfinite(log_Z), log_Z, -jnp.inf)

    (exact, log_exact), (guessed, log_guessed) = judged(0, None), judged(best, F)
    sharp = log_exact > log_guessed
    at = jnp.where(sharp, 0, best)
    after = jax.tree.map(lambda a, b: jnp.where(sharp, a, b), exact, guessed)
    misfit = jnp.where(sharp, jnp.sum(residuals[0] ** 2), misfits[best])
    log_Z = jnp.logaddexp(log_exact, log_guessed) - jnp.log(2.0)
    p = jnp.exp(log_exact - jnp.logaddexp(log_exact, log_guessed))
    return _Likelier(at, after, residuals[at], misfit, log_Z, p)


def places_of(numbers: Catalogue, pair: Int[Array, " 2"]) -> Float[Array, "2 e"]:
    """Selection matrix of the hypothesis: 1 at the position of each effect, else 0."""
    return (pair[:, None] == jnp.arange(numbers.sd.shape[0])[None, :]).astype(float)


def effect_sizes(
    numbers: Catalogue, pair: Int[Array, " 2"], x: Float[Array, " 2"]
) -> Float[Array, " e"]:
    """Size of every effect of the catalogue [its unit] from the two standardised ones."""
    return bounded_size(numbers.sd, numbers.one_sided, x @ places_of(numbers, pair))


def one_sided_unknowns(
    measured: Measured, numbers: Catalogue, pair: Int[Array, " 2"]
) -> Float[Array, " k"]:
    """1 for the unknowns of a hypothesis that only exist above zero, else 0."""
    of_sizes = places_of(numbers, pair) @ numbers.one_sided
    return jnp.concatenate([jnp.zeros(n_unknowns(measured)), of_sizes])


def sensor_model(
    effects: Sequence[Effect],
    numbers: Catalogue,
    pair: Int[Array, " 2"],
    fixed_size: Float[ArrayLike, ""] = FITTED,
    *,
    nonlinear: bool,
) -> Callable[..., SensorSpectra]:
    """Signals of the sensors under a hypothesis, as a function of a condition and its unknowns.

    Arguments are those of `fit_hypothesis`. The function takes `forced` as `predict` does, and
    `share`, by which the two sizes are multiplied.
    """
    free = jnp.stack([jnp.isnan(fixed_size), jnp.asarray(True)])
    fixed = jnp.stack([jnp.asarray(fixed_size), jnp.zeros(())])

    def beat(
        case: ConditionSettings,
        own: Array,
        forced: Array | None = None,
        share: Float[ArrayLike, " 2"] = BOTH,
    ) -> SensorSpectra:
        sized = jnp.asarray(share) * jnp.where(free, own[OWN:], fixed)
        sizes = effect_sizes(numbers, pair, sized)
        return predict(case, own[:OWN], effects, sizes, nonlinear=nonlinear, forced=forced)

    return beat


def log_prior_of_sizes(
    after: Posterior, pair: Int[Array, " 2"], sided: Float[Array, " k"]
) -> Float[Array, ""]:
    """Ln of the factors E[φ²]/s² of a hypothesis's sizes, see `effects`."""
    variance = jnp.diagonal(after.covariance)
    moments = log_moment(after.mean[-2:], variance[-2:], sided[-2:])
    return jnp.sum(jnp.where(pair >= 0, moments, 0.0))


class UncertainSignals(NamedTuple):
    """Signals of the sensors, and how uncertain equations make them, see `evidence`.

    Attributes:
        waves: predicted signals of the sensors, conditions × 3 sensors × samples
            [dyn/cm², cm³/s].
        power: variance of the signals [their units squared].
        scalar_power: variance of the last four data.
        n_sensors: number of sensors with a waveform.
    """

    waves: Float[Array, "c 3 n"]
    power: Float[Array, "c 3 n"]
    scalar_power: Float[Array, "c 4"]
    n_sensors: int

    def columns(self, W: Whitener) -> Float[Array, "c d m"]:
        """Columns F, whitened."""
        return form_columns(W, self.power, self.scalar_power, self.n_sensors)


def form_uncertainty(
    measured: Measured,
    effects: Sequence[Effect],
    numbers: Catalogue,
    pair: Int[Array, " 2"],
    x: Float[Array, " k"],
    exact: Float[ArrayLike, ""] = 0.0,
    *,
    nonlinear: bool,
) -> Float[Array, "c d m"]:
    """Whitened columns F of the uncertainty of the equations of a hypothesis.

    Arguments are those of `fit_hypothesis`, x its optimum, and the probability that its equations
    are exact: F is zero where it is above one half.
    """
    uncertain = uncertain_signals(measured, effects, numbers, pair, x, nonlinear=nonlinear)
    F = uncertain.columns(whitener_of(measured))
    return jnp.where(jnp.asarray(exact) > 0.5, 0.0, F)


def uncertain_signals(
    measured: Measured,
    effects: Sequence[Effect],
    numbers: Catalogue,
    pair: Int[Array, " 2"],
    x: Float[Array, " k"],
    fixed_size: Float[ArrayLike, ""] = FITTED,
    *,
    nonlinear: bool,
) -> UncertainSignals:
    """Signals under a hypothesis, with the uncertainty of its equations.

    Arguments are those of `fit_hypothesis`, and x its optimum.
    """
    own = jnp.asarray(selection(measured.n_conditions, 2)) @ x
    cases, n = condition_settings(measured), measured.n_sensors
    beat = sensor_model(effects, numbers, pair, fixed_size, nonlinear=nonlinear)
    tolerances = places_of(numbers, pair) @ numbers.tolerance

    def signals(share: Array) -> tuple[Array, Array]:
        seen = jax.vmap(partial(beat, share=share))(cases, own)
        return jax.vmap(as_waves)(seen), jax.vmap(lambda b: observations(b, n)[-4:])(seen)

    # with both effects, without the first, without the second
    shares = jnp.asarray(np.array([[1.0, 1.0], [0.0, 1.0], [1.0, 0.0]]))
    waves, scalars = jax.vmap(signals)(shares)

    def power(signal: Array) -> Array:
        change = signal[:1] - signal[1:]
        return jnp.einsum("s,sc...->c...", tolerances**2, change**2)

    return UncertainSignals(waves[0], power(waves), power(scalars), n)


def by_condition(
    model: Callable[[ConditionSettings, Array], Array],
    cases: ConditionSettings,
    chooser: Float[Array, "c o k"],
) -> Callable[[Array], tuple[Array, Array]]:
    """Values of all conditions with their derivatives by all unknowns, as a function of those."""

    def one(case: ConditionSettings, own: Array) -> tuple[Array, Array]:
        def with_value(own: Array) -> tuple[Array, Array]:
            value = model(case, own)
            return value, value

        J, value = jax.jacfwd(with_value, has_aux=True)(own)
        return value, J

    def slopes(x: Array) -> tuple[Array, Array]:
        value, J = jax.vmap(one)(cases, chooser @ x)
        return value, jnp.einsum("cdo,cok->cdk", J, chooser)

    return slopes


def whitened_by_condition(
    model: Callable[[ConditionSettings, Array], Array],
    W: Whitener,
    cases: ConditionSettings,
    chooser: Float[Array, "c o k"],
) -> Callable[[Array], tuple[Array, Array]]:
    """What `by_condition` gives, whitened."""
    plain = by_condition(model, cases, chooser)

    def slopes(x: Array) -> tuple[Array, Array]:
        value, J = plain(x)
        return W(value), W.columns(J)

    return slopes
