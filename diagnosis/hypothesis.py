"""Hypotheses "none", one effect, or two effects: fit, evidence, and what the sensors would show.

All of them are one compiled function of the record and the positions i, j of the effects in the
catalogue (−1 for none), so that a batch of records and effects is one map. Unknowns are those of
the base model and the standardised sizes of the two effects; an unused size has no effect on
anything and its prior integrates to one. The fit minimises |W (y − f)|² + |x|² by the
Levenberg-Marquardt method of `descent`, from the base optimum on, so that it cannot end above
it.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import log_ndtr
from jaxtyping import Array, Bool, Float, Int

from diagnosis.circuit import FROM_SAMPLES, TO_SAMPLES, Beat
from diagnosis.descent import descend
from diagnosis.effects import SCALE, Effect, size_of
from diagnosis.evidence import Whitened, log_moment, posterior, smooth_scale
from diagnosis.measured import Measured, data_of, weights
from diagnosis.prediction import (
    OWN,
    Situation,
    as_data,
    as_waves,
    n_unknowns,
    predict,
    selection,
    situations,
)

FORM_LENGTH, FORM_HARMONICS = 0.06, 10
"""Smoothness of what a guessed form may get wrong [beats], and harmonics kept of it."""


class Fitted(NamedTuple):
    """A fitted hypothesis.

    Attributes:
        x: optimum, standardised: unknowns of the base model and two sizes.
        log_evidence: ln Z up to a constant of the record.
        chi2: Σ of squared whitened residuals.
        residual: whitened residuals by condition.
        sizes: size of every effect of the catalogue [its unit].
        size_sd: posterior standard deviations of the two sizes [their units].
        waves: what the sensors would show, conditions × 3 sensors × samples [mmHg, mL/s].
        sound: whether the result is finite.
    """

    x: Float[Array, "*b k"]
    log_evidence: Float[Array, "*b"]
    chi2: Float[Array, "*b"]
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


class Linearised(NamedTuple):
    """The model about an optimum, and what every effect would change there.

    Attributes:
        linear: residuals and derivatives by the unknowns.
        effects: derivative by every standardised size, conditions × data × effects.
    """

    linear: Whitened
    effects: Float[Array, "c d e"]


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
        nonlinear: whether any of the two makes the ostium nonlinear (static).
    """
    k = n_unknowns(measured)
    chosen = (pair[:, None] == jnp.arange(len(effects))[None, :]).astype(float)
    W, data, cases = weights(measured), data_of(measured), situations(measured)
    chooser = jnp.asarray(selection(measured.n_conditions, 2))

    def sizes_of(pair_x: Array) -> Array:
        return size_of(numbers.sd, numbers.one_sided, pair_x @ chosen)

    def beat(case: Situation, own: Array) -> Beat:
        sizes = sizes_of(own[OWN:])
        return predict(case, own[:OWN], effects, sizes, nonlinear=nonlinear)

    def whitened(W: Array, case: Situation, own: Array) -> Array:
        return W * as_data(beat(case, own), measured.n_sensors)

    slopes = _by_condition(whitened, W, cases, chooser)

    x, value, _ = descend(slopes, W * data, start)
    residual = W * data - value
    own = chooser @ x
    seen = jax.vmap(beat)(cases, own)
    F = form_uncertainty(measured, effects, numbers, pair, x, nonlinear=nonlinear)
    sided = jnp.concatenate([jnp.zeros(k), chosen @ numbers.one_sided])
    # below zero a one-sided size has levelled off and lost its slope: the evidence looks from zero
    inside = jnp.where(sided > 0.5, jnp.maximum(x, 0.0), x)
    value, J = slopes(inside)
    after = posterior(Whitened(W * data - value + J @ inside, J), F, sided)
    sd = jnp.sqrt(jnp.diagonal(after.covariance)[k:]) * (chosen @ numbers.sd)
    chi2 = jnp.sum(residual**2)
    sound = jnp.isfinite(after.log_evidence) & jnp.isfinite(chi2)
    waves = jax.vmap(as_waves)(seen)
    moments = log_moment(after.mean[k:], after.covariance.diagonal()[k:], sided[k:])
    log_Z = after.log_evidence + jnp.sum(jnp.where(pair >= 0, moments, 0.0))
    log_Z = jnp.where(sound, log_Z, -jnp.inf)
    return Fitted(x, log_Z, chi2, residual, sizes_of(x[k:]), sd, waves, sound)


def form_uncertainty(
    measured: Measured,
    effects: Sequence[Effect],
    numbers: Catalogue,
    pair: Int[Array, " 2"],
    x: Float[Array, " k"],
    *,
    nonlinear: bool,
) -> Float[Array, "c d m"]:
    """Columns F of what the equations of a hypothesis may get wrong, see `evidence`.

    Arguments are those of `fit_hypothesis`, and x its optimum.
    """
    chosen = (pair[:, None] == jnp.arange(len(effects))[None, :]).astype(float)
    own = jnp.asarray(selection(measured.n_conditions, 2)) @ x
    cases, n = situations(measured), measured.n_sensors

    def beat(case: Situation, own: Array) -> Beat:
        sizes = size_of(numbers.sd, numbers.one_sided, own[OWN:] @ chosen)
        return predict(case, own[:OWN], effects, sizes, nonlinear=nonlinear)

    seen = jax.vmap(beat)(cases, own)
    without = jax.vmap(lambda case, own: beat(case, own.at[OWN:].set(0.0)))(cases, own)
    change = Beat(*(a - b for a, b in zip(seen, without, strict=True)))
    scalars = jax.vmap(lambda b: as_data(b, n)[-4:])
    tolerance = jnp.max(chosen @ numbers.tolerance)
    return _form_columns(
        weights(measured), tolerance, jax.vmap(as_waves)(change),
        scalars(seen) - scalars(without), n,
    )  # fmt: skip


def _by_condition(
    whitened: Callable[[Array, Situation, Array], Array],
    W: Array,
    cases: Situation,
    chooser: Float[Array, "c o k"],
) -> Callable[[Array], tuple[Array, Array]]:
    """Values of all conditions with their derivatives by all unknowns, as a function of those."""

    def one(W: Array, case: Situation, own: Array) -> tuple[Array, Array]:
        def with_value(own: Array) -> tuple[Array, Array]:
            value = whitened(W, case, own)
            return value, value

        J, value = jax.jacfwd(with_value, has_aux=True)(own)
        return value, J

    def slopes(x: Array) -> tuple[Array, Array]:
        value, J = jax.vmap(one)(W, cases, chooser @ x)
        return value, jnp.einsum("cdo,cok->cdk", J, chooser)

    return slopes


def linearise(
    measured: Measured,
    effects: Sequence[Effect],
    numbers: Catalogue,
    x: Float[Array, " k"],
    sizes: Float[Array, " e"],
) -> Linearised:
    """The model about an optimum with derivatives by all unknowns and all effects.

    Args:
        measured: the record.
        effects: the catalogue (static).
        numbers: of the catalogue.
        x: optimum of the base model's unknowns (further ones are ignored).
        sizes: size of every effect there [its unit].
    """
    W, cases = weights(measured), situations(measured)
    chooser = jnp.asarray(selection(measured.n_conditions, len(effects)))
    joined = jnp.concatenate([x[: n_unknowns(measured)], sizes])

    def whitened(W: Array, case: Situation, own: Array) -> Array:
        return W * as_data(predict(case, own[:OWN], effects, own[OWN:]), measured.n_sensors)

    value, J = _by_condition(whitened, W, cases, chooser)(joined)
    k = n_unknowns(measured)
    residual = W * data_of(measured) - value
    linear = Whitened(residual + J[..., :k] @ x[:k], J[..., :k])
    return Linearised(linear, J[..., k:] * numbers.sd[None, None])


def score_scan(found: Linearised, numbers: Catalogue) -> tuple[Array, Array, Array]:
    """Ln B of adding each effect, its expected standardised size, and |g⊥|, from one Jacobian.

    With J̃ = [J; I], r̃ = [r; −x] and g the derivative by one standardised size,

        g⊥ = g − J̃ (J̃ᵀJ̃)⁻¹ J̃ᵀ g,   size = g⊥ᵀr̃/(1 + |g⊥|²),
        ln B = ½ (g⊥ᵀr̃)²/(1 + |g⊥|²) − ½ ln(1 + |g⊥|²) + ln E[size²]  (+ ln 2Φ(size/sd)).

    Source: Lagrange-multiplier tests of structural equation models, Sörbom 1989 (Psychometrika
    54:371); here with Gaussian priors.
    """
    (e, J), G = found.linear, found.effects
    precision = jnp.eye(J.shape[-1]) + jnp.einsum("cdk,cdl->kl", J, J)
    JG, Je = jnp.einsum("cdk,cde->ke", J, G), jnp.einsum("cdk,cd->k", J, e)
    solved = jnp.linalg.solve(precision, JG)
    # e = r + J x: with the unknowns eliminated g⊥ᵀ r̃ = gᵀe − (JG)ᵀ precision⁻¹ Jᵀe
    along = jnp.einsum("cde,cd->e", G, e) - solved.T @ Je
    length = jnp.einsum("cde,cde->e", G, G) - jnp.sum(JG * solved, axis=0)
    length = jnp.maximum(length, 0.0)
    size = along / (1.0 + length)
    log_B = 0.5 * along * size - 0.5 * jnp.log1p(length)
    half = jnp.log(2.0) + log_ndtr(size * jnp.sqrt(1.0 + length))
    log_B = log_B + numbers.one_sided * half
    log_B = log_B + log_moment(size, 1.0 / (1.0 + length), numbers.one_sided)
    return log_B, size, jnp.sqrt(length)


def _form_columns(
    W: Float[Array, "c d"],
    tolerance: Float[Array, ""],
    change: Float[Array, "c 3 n"],
    scalar_change: Float[Array, "c 4"],
    n_sensors: int,
) -> Float[Array, "c d m"]:
    """Columns F of the form tolerance: what the effects change, times smooth random factors.

    With two effects it is what both do together, weighted by the larger tolerance.
    """
    scale = smooth_scale(FORM_LENGTH, FORM_HARMONICS)
    size = TO_SAMPLES.shape[1] // 2
    kept = np.r_[0 : FORM_HARMONICS + 1, size + 1 : size + 1 + FORM_HARMONICS]
    basis = jnp.asarray(TO_SAMPLES[:, kept] * scale)
    C, m = change.shape[0], basis.shape[1]
    rows = TO_SAMPLES.shape[1]
    F = jnp.zeros((C, W.shape[1], n_sensors * m + 4))
    for s in range(n_sensors):
        block = jnp.einsum("qn,cn,nm->cqm", jnp.asarray(FROM_SAMPLES), change[:, s], basis)
        F = F.at[:, s * rows : (s + 1) * rows, s * m : (s + 1) * m].set(block)
    own = jax.vmap(jnp.diag)(scalar_change)
    F = F.at[:, n_sensors * rows :, n_sensors * m :].set(own)
    return tolerance * W[..., None] * F
