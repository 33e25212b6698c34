"""Score scan: evidence of all effects of the catalogue, and of all pairs, from one Jacobian."""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jax.scipy.special import log_ndtr
from jaxtyping import Array, Float

from diagnosis.effects import Effect
from diagnosis.evidence import Whitened, log_moment
from diagnosis.hypothesis import Catalogue, whitened_by_condition
from diagnosis.measured import Measured, data_of, whitener_of
from diagnosis.prediction import (
    OWN,
    ConditionSettings,
    condition_settings,
    n_unknowns,
    observations,
    predict,
    selection,
)
from lumped.elimination import solve_definite


class Linearised(NamedTuple):
    """The model linearised at an optimum, with the derivative of every effect.

    Attributes:
        linear: residuals and derivatives by the unknowns.
        effects: derivative by every standardised size, conditions × data × effects.
    """

    linear: Whitened
    effects: Float[Array, "c d e"]


def linearise(
    measured: Measured,
    effects: Sequence[Effect],
    numbers: Catalogue,
    x: Float[Array, " k"],
    sizes: Float[Array, " e"],
) -> Linearised:
    """Linearise the model at an optimum with respect to all unknowns and all effects.

    Args:
        measured: the record.
        effects: the catalogue (static).
        numbers: of the catalogue.
        x: optimum of the base model's unknowns (further ones are ignored).
        sizes: size of every effect there [its unit].
    """
    W, cases = whitener_of(measured), condition_settings(measured)
    chooser = jnp.asarray(selection(measured.n_conditions, len(effects)))
    joined = jnp.concatenate([x[: n_unknowns(measured)], sizes])

    def seen(case: ConditionSettings, own: Array) -> Array:
        return observations(predict(case, own[:OWN], effects, own[OWN:]), measured.n_sensors)

    value, J = whitened_by_condition(seen, W, cases, chooser)(joined)
    k = n_unknowns(measured)
    residual = W(data_of(measured)) - value
    linear = Whitened(residual + J[..., :k] @ x[:k], J[..., :k])
    return Linearised(linear, J[..., k:] * numbers.sd[None, None])


class Scan(NamedTuple):
    """Score scan of all effects.

    Attributes:
        log_B: ln B of adding each effect.
        size: its expected standardised size.
        length: |g⊥|, detectability per standardised size [noise units].
        pair_log_B: ln B of adding two effects, symmetric; the diagonal is meaningless.
    """

    log_B: Float[Array, " e"]
    size: Float[Array, " e"]
    length: Float[Array, " e"]
    pair_log_B: Float[Array, "e e"]


def score_scan(found: Linearised, numbers: Catalogue) -> Scan:
    """Ln B of adding each effect, and every two effects, from one Jacobian.

    With J̃ = [J; I], r̃ = [r; −x] and g the derivatives by standardised sizes,

        g⊥ = g − J̃ (J̃ᵀJ̃)⁻¹ J̃ᵀ g,   Λ = I + g⊥ᵀg⊥,   size = Λ⁻¹ g⊥ᵀr̃,
        ln B = ½ g⊥ᵀr̃ · size − ½ ln|Λ| + Σ ln E[size²]  (+ ln 2Φ(size/sd) where one-sided)

    of one effect or of two, Λ⁻¹ being the covariance.

    Source: Lagrange-multiplier tests of structural equation models, Sörbom 1989 (Psychometrika
    54:371); here with Gaussian priors.
    """
    (e, J), G = found.linear, found.effects
    precision = jnp.eye(J.shape[-1]) + jnp.einsum("cdk,cdl->kl", J, J)
    JG, Je = jnp.einsum("cdk,cde->ke", J, G), jnp.einsum("cdk,cd->k", J, e)
    solved = solve_definite(precision, JG)
    # e = r + J x: with the unknowns eliminated g⊥ᵀ r̃ = gᵀe − (JG)ᵀ precision⁻¹ Jᵀe
    along = jnp.einsum("cde,cd->e", G, e) - solved.T @ Je
    products = jnp.einsum("cde,cdf->ef", G, G) - JG.T @ solved
    square = jnp.maximum(jnp.diagonal(products), 0.0)
    size = along / (1.0 + square)
    shape = _of_sizes(size, 1.0 / (1.0 + square), numbers.one_sided)
    log_B = 0.5 * along * size - 0.5 * jnp.log1p(square) + shape

    own, other = 1.0 + square[:, None], 1.0 + square[None, :]
    cross = products * (1.0 - jnp.eye(square.size))
    determinant = own * other - cross**2
    first = (other * along[:, None] - cross * along[None, :]) / determinant
    sided = jnp.broadcast_to(numbers.one_sided[:, None], cross.shape)
    shape = _of_sizes(first, other / determinant, sided)
    gain = 0.5 * along[:, None] * first + shape
    return Scan(log_B, size, jnp.sqrt(square), gain + gain.T - 0.5 * jnp.log(determinant))


def _of_sizes(mean: Array, variance: Array, one_sided: Array) -> Array:
    """Ln of the factor E[size²], and of the half above zero, of sizes."""
    half = one_sided * (jnp.log(2.0) + log_ndtr(mean / jnp.sqrt(variance)))
    return half + log_moment(mean, variance, one_sided)
