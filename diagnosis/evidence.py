"""Laplace evidence of a hypothesis, including the uncertainty of its equations.

The prediction is linearised at the optimum x of a hypothesis. With W whitening the noise,
e = W (y − f(x)) + J x and columns F of a further Gaussian uncertainty,

    e ~ N(0, I + F Fᵀ + J Jᵀ),      ln Z = −½ eᵀ C⁻¹ e − ½ ln|C|     (+ ln 2Φ(m/s) if one-sided),

m and s being posterior mean and sd of the size. F is block diagonal over conditions, but for
columns whose coefficients conditions share. Four kinds:

* form tolerance of an effect, F = W ρ diag(|Δf|) B, |Δf| its local change of the prediction;
* an error of the instruments that all beats share, the same with a constant in place of ρ |Δf|;
* a bed of another structure, the same with the change |Δf| by the muscle's squeeze; nine tenths of
  its variance have coefficients that all conditions share;
* a free smooth forcing at a place of the circuit, F = W a (∂f/∂forcing) B: "not in the catalogue".

B holds the first harmonics weighted by the spectrum of exp(−2 sin²(πΔ)/(2πℓ)²). Data are the real
coefficients of the traces' harmonics, in which stationary noise is independent: W is diagonal.

Source: MacKay 2003, Information Theory, Inference, and Learning Algorithms, chapters 27 and 28;
discrepancy inside the model: Strong & Oakley 2014 (SIAM/ASA J Uncertain Quantif 2:106).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import log_ndtr
from jaxtyping import Array, Float, Int

from diagnosis.effects import NEAR_ZERO
from diagnosis.measured import correlation
from lumped.elimination import schur_complement, solve_with_log_det


class Whitened(NamedTuple):
    """A linearised hypothesis in units of the noise, by condition.

    Attributes:
        e: residual plus J x, conditions × data.
        J: derivative of the whitened prediction, conditions × data × unknowns.
    """

    e: Float[Array, "c d"]
    J: Float[Array, "c d k"]


class Posterior(NamedTuple):
    """Evidence and posterior of a linearised hypothesis.

    Attributes:
        log_evidence: ln Z, up to a constant of the data.
        mean: posterior mean of the unknowns.
        covariance: of the unknowns.
        misfit: |e − J x|² at the mean, in units of noise and of F.
    """

    log_evidence: Float[Array, ""]
    mean: Float[Array, " k"]
    covariance: Float[Array, "k k"]
    misfit: Float[Array, ""]


def log_moment(
    mean: Float[Array, "*k"], variance: Float[Array, "*k"], one_sided: Float[Array, "*k"]
) -> Float[Array, "*k"]:
    """Ln E[x²] of normal variables, of their positive half where one-sided.

    With z = mean/sd, E[x² | x > 0] = mean² + sd² + mean sd φ(z)/Φ(z), and 2 sd²/z² far below zero.
    """
    sd = jnp.sqrt(variance)
    z = mean / sd
    near = jnp.maximum(z, -6.0)
    hazard = jnp.exp(-0.5 * near**2 - 0.5 * jnp.log(2.0 * jnp.pi) - log_ndtr(near))
    far = 2.0 * variance / jnp.minimum(z, -6.0) ** 2
    half = jnp.where(z > -6.0, variance * jnp.maximum(near**2 + 1.0 + near * hazard, 1e-3), far)
    return jnp.log(jnp.where(one_sided > 0.5, half, mean**2 + variance))


def log_size_factor(
    mean: Float[Array, "*k"], variance: Float[Array, "*k"], one_sided: Float[Array, "*k"]
) -> Float[Array, "*k"]:
    """Ln of the factor (1 − w) E[φ²]/s² + w of sizes φ/s with a normal posterior, see `effects`."""
    moment = log_moment(mean, variance, one_sided)
    return jnp.logaddexp(np.log(1.0 - NEAR_ZERO) + moment, np.log(NEAR_ZERO))


def smooth_scale(length: float, n_harmonics: int) -> np.ndarray:
    """Standard deviations of the real coefficients of a smooth random waveform of unit variance.

    Args:
        length: correlation length [beats].
        n_harmonics: harmonics kept, besides the mean.
    """
    covariance = correlation(length)[0]
    spectrum = np.fft.rfft(covariance).real[: n_harmonics + 1] / covariance.size
    root = np.sqrt(np.maximum(spectrum, 0.0))
    return np.concatenate([root[:1], np.sqrt(2.0) * root[1:], np.sqrt(2.0) * root[1:]])


def posterior(
    linear: Whitened,
    F: Float[Array, "c d m"] | None = None,
    one_sided: Float[Array, " k"] | None = None,
) -> Posterior:
    """Evidence and posterior of a linearised hypothesis.

    Args:
        linear: residuals and derivatives.
        F: columns of further Gaussian uncertainty of each condition.
        one_sided: 1 for unknowns that only exist above zero.
    """
    e, J = linear
    JJ = jnp.einsum("cdk,cdl->kl", J, J)
    Je = jnp.einsum("cdk,cd->k", J, e)
    ee = jnp.sum(e**2)
    log_volume = jnp.zeros(())
    if F is not None:
        columns = jnp.concatenate([F, J, e[..., None]], axis=-1)
        products = jnp.einsum("cdm,cdl->cml", columns, columns)
        left, log_volume = jax.vmap(lambda one: absorbed(one, F.shape[-1]))(products)
        return posterior_of_products(*split(jnp.sum(left, 0)), jnp.sum(log_volume), one_sided)
    return posterior_of_products(JJ, Je, ee, log_volume, one_sided)


def absorbed(products: Float[Array, "n n"], count: int) -> tuple[Array, Array]:
    """Inner products of columns once the first few have become part of the noise.

    With A those columns and B the others, BᵀB turns into Bᵀ(I + A Aᵀ)⁻¹B (Woodbury's identity).

    Args:
        products: of all columns, AᵀA first.
        count: of the columns A (static).

    Returns:
        Those of the others, and ½ ln|I + A Aᵀ|.
    """
    noise = np.diag((np.arange(products.shape[0]) < count).astype(float))
    left, log_det = schur_complement(products + jnp.asarray(noise), count)
    return left, 0.5 * log_det


def split(products: Float[Array, "n n"]) -> tuple[Array, Array, Array]:
    """JᵀJ, Jᵀe and eᵀe from the inner products of the columns [J, e]."""
    return products[:-1, :-1], products[:-1, -1], products[-1, -1]


def posterior_of_products(
    JJ: Float[Array, "k k"],
    Je: Float[Array, " k"],
    ee: Float[Array, ""],
    log_volume: Float[Array, ""],
    one_sided: Float[Array, " k"] | None = None,
) -> Posterior:
    """The same from inner products, `log_volume` being ½ ln of the noise's determinant."""
    one = jnp.eye(JJ.shape[0])
    solved, log_det = solve_with_log_det(one + JJ, jnp.concatenate([Je[:, None], one], axis=1))
    mean, covariance = solved[:, 0], solved[:, 1:]
    log_Z = -0.5 * (ee - Je @ mean) - 0.5 * log_det - log_volume
    if one_sided is not None:
        sd = jnp.sqrt(jnp.diagonal(covariance))
        log_Z = log_Z + jnp.sum(one_sided * (jnp.log(2.0) + log_ndtr(mean / sd)))
    misfit = ee - Je @ mean - mean @ mean
    return Posterior(log_Z, mean, covariance, misfit)


def log_prior_of_sizes(
    after: Posterior, pair: Int[Array, " 2"], sided: Float[Array, " k"]
) -> Float[Array, ""]:
    """Ln of the factors of a hypothesis's sizes, see `effects`."""
    variance = jnp.diagonal(after.covariance)
    factors = log_size_factor(after.mean[-2:], variance[-2:], sided[-2:])
    return jnp.sum(jnp.where(pair >= 0, factors, 0.0))
