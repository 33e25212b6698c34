"""Score scan: evidence of all effects of the catalogue, and of all pairs, from one Jacobian."""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jax.scipy.special import log_ndtr
from jaxtyping import Array, Float, Int

from diagnosis.circuit import SensorSpectra
from diagnosis.effects import Effect
from diagnosis.evidence import Whitened, log_size_factor
from diagnosis.form_columns import Freedom
from diagnosis.hypothesis import (
    Catalogue,
    effect_sizes,
    likeliest_freedom,
    whitened_by_condition,
)
from diagnosis.measured import Measured, data_of, whitener_of
from diagnosis.prediction import (
    OWN,
    ConditionSettings,
    n_unknowns,
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
    *,
    nonlinear: bool = True,
) -> Linearised:
    """Linearise the model at an optimum with respect to all unknowns and all effects.

    Args:
        measured: the record.
        effects: the catalogue (static).
        numbers: of the catalogue.
        x: optimum of the base model's unknowns (further ones are ignored).
        sizes: size of every effect there [its unit].
        nonlinear: whether any effect makes the ostium nonlinear (static).
    """
    W = whitener_of(measured)
    chooser = jnp.asarray(selection(measured.n_conditions, len(effects)))
    joined = jnp.concatenate([x[: n_unknowns(measured)], sizes])

    def beat(case: ConditionSettings, own: Array) -> SensorSpectra:
        return predict(case, own[:OWN], effects, own[OWN:], nonlinear=nonlinear)

    value, J, _ = whitened_by_condition(beat, measured, chooser)(joined)
    k = n_unknowns(measured)
    residual = W(data_of(measured)) - value
    linear = Whitened(residual + J[..., :k] @ x[:k], J[..., :k])
    return Linearised(linear, J[..., k:] * numbers.sd[None, None])


def base_linearised(
    measured: Measured,
    effects: Sequence[Effect],
    numbers: Catalogue,
    pair: Int[Array, " 2"],
    x: Float[Array, " k"],
    *,
    nonlinear: bool,
) -> Linearised:
    """What `linearise` gives where no effect acts; `pair` is ignored."""
    del pair
    return linearise(measured, effects, numbers, x, jnp.zeros(len(effects)), nonlinear=nonlinear)


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


def score_scan(found: Linearised, numbers: Catalogue, freedom: Freedom | None = None) -> Scan:
    """Ln B of adding each effect, and every two effects, from one Jacobian.

    With J̃ = [J; I], r̃ = [r; −x] and g the derivatives by standardised sizes,

        g⊥ = g − J̃ (J̃ᵀJ̃)⁻¹ J̃ᵀ g,   Λ = I + g⊥ᵀg⊥,   size = Λ⁻¹ g⊥ᵀr̃,
        ln B = ½ g⊥ᵀr̃ · size − ½ ln|Λ| + Σ ln E[size²]  (+ ln 2Φ(size/sd) where one-sided)

    of one effect or of two, Λ⁻¹ being the covariance. With a freedom of the equations all products
    of J, g and r are those beside it.

    Source: Lagrange-multiplier tests of structural equation models, Sörbom 1989 (Psychometrika
    54:371); here with Gaussian priors.

    Args:
        found: the model linearised at the optimum of a hypothesis.
        numbers: of the catalogue.
        freedom: of the hypothesis's equations, whitened.
    """
    (e, J), G = found.linear, found.effects
    k = J.shape[-1]
    columns = jnp.concatenate([J, G, e[..., None]], axis=-1)
    if freedom is None:
        inner = jnp.einsum("cdm,cdl->ml", columns, columns)
    else:
        inner = freedom.absorbed_products(columns)[0]
    solved = solve_definite(jnp.eye(k) + inner[:k, :k], inner[:k, k:-1])
    # e = r + J x: with the unknowns eliminated g⊥ᵀ r̃ = gᵀe − (JG)ᵀ precision⁻¹ Jᵀe
    along = inner[k:-1, -1] - solved.T @ inner[:k, -1]
    products = inner[k:-1, k:-1] - inner[k:-1, :k] @ solved
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


def scan_about(
    measured: Measured,
    effects: Sequence[Effect],
    numbers: Catalogue,
    pair: Int[Array, " 2"],
    x: Float[Array, " k"],
    kinds: Float[Array, " 3"],
    *,
    nonlinear: bool,
) -> Scan:
    """Score scan about a fitted hypothesis, beside the freedom of its likeliest equations.

    Arguments are those of `hypothesis.likeliest_freedom`, x being its posterior mean; nonlinear is
    True where any effect makes the ostium nonlinear.
    """
    sizes = effect_sizes(numbers, pair, x[n_unknowns(measured) :])
    found = linearise(measured, effects, numbers, x, sizes, nonlinear=nonlinear)
    freedom = likeliest_freedom(measured, effects, numbers, pair, x, kinds, nonlinear=nonlinear)
    return score_scan(found, numbers, freedom)


def _of_sizes(mean: Array, variance: Array, one_sided: Array) -> Array:
    """Ln of the factor of the prior, and of the half above zero, of sizes."""
    half = one_sided * (jnp.log(2.0) + log_ndtr(mean / jnp.sqrt(variance)))
    return half + log_size_factor(mean, variance, one_sided)
