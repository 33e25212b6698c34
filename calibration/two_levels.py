"""A costly scalar from a few runs and a cheap one from many: two levels.

A cheap scalar g(z) follows a costly one f(z), such as FFR of a 3D run, closely but not exactly.
What it lacks is learned from few runs of both,

    f(z) ≈ g(z) + δ(z) + e,     δ = c₀ + c₁ (g − ḡ) + Σ c_i z_i,

with as many of these terms, in this order, as clearly lower the error when each run in turn is left
out. The error e of another sample with the terms x is Student's t with ν degrees of freedom,

    e = s √(1 + h) t_ν,   h = xᵀ (XᵀX)⁻¹ x,   s² = (Σ r² + ν₀ s₀²)/ν,   ν = n − p + ν₀,

for n runs and p terms with residuals r: h grows away from the runs, so that a scale learned in a
narrow band promises little outside. s₀ is the error expected before any run, which counts as ν₀
runs.

Source: Giles 2015, Multilevel Monte Carlo methods, Acta Numerica 24:259, sec. 1.2 and 2.1 (control
variates, two levels); Gelman et al. 2013, Bayesian Data Analysis, sec. 14.2 (prediction from a
regression); Hastie, Tibshirani & Friedman 2009, sec. 7.10 (leaving one out).
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import ndtr, stdtrit

TERMS = ("shift", "scale", "linear")
"""Kinds of corrections, each with the terms of those before it."""

LEAST_RUNS_PER_TERM = 2.0
"""Runs that each term of a correction must have."""

CLEARLY = 0.8
"""Error of a kind with more terms over that of a simpler one, from which it is taken."""

EXPECTED_RUNS = 4.0
"""ν₀: runs that an error expected beforehand counts for."""

_WHOLE_LEVERAGE = 1e-8


class Runs(NamedTuple):
    """A costly scalar and a cheap one of the same inputs.

    Attributes:
        costly: the costly one; NaN where it has no value.
        cheap: the cheap one; NaN likewise.
        z: the inputs as standard normal numbers of the same distributions as those of the draws, in
            their order; None where they are not such draws, and terms in z cannot be learned.
        name: of the costly scalar; its error stands under it among the causes.
        error: standard deviation expected of the correction before any run; 0: nothing is known.
        names: of the inputs, in order, so that another order is refused; empty: not told.
    """

    costly: Float[np.ndarray, " runs"]
    cheap: Float[np.ndarray, " runs"]
    z: Float[np.ndarray, "runs inputs"] | None = None
    name: str = "model"
    error: float = 0.0
    names: tuple[str, ...] = ()


class Correction(eqx.Module):
    """What a costly scalar is beyond a cheap one.

    Attributes:
        name: of the costly scalar (static).
        kind: one of `TERMS` (static).
        middle: mean of the cheap scalar over the runs.
        coefficients: of the terms.
        covariance: (XᵀX)⁻¹ of the runs' terms.
        error: s, standard deviation of the residuals.
        freedom: ν, degrees of freedom of the error.
        correlation: of the costly and the corrected cheap scalar, each run left out; 0 where it is
            negative, NaN with less than three runs.
        gain: variance of the costly scalar over the squared error of runs left out, which is by how
            much the variance of its mean falls; NaN with less than three runs.
        n_runs: runs that it was learned from (static).
        n_failed: runs without a value (static).
    """

    name: str = eqx.field(static=True)
    kind: str = eqx.field(static=True)
    middle: float
    coefficients: Float[np.ndarray, " terms"]
    covariance: Float[np.ndarray, "terms terms"]
    error: float
    freedom: float
    correlation: float
    gain: float
    n_runs: int = eqx.field(static=True)
    n_failed: int = eqx.field(static=True)

    def __call__(
        self,
        z: Float[Array | np.ndarray, "*samples inputs"],
        cheap: Float[Array | np.ndarray, "*samples"],
    ) -> Float[Array, "*samples"]:
        """The costly scalar expected at other samples, from the cheap one there."""
        cheap = jnp.asarray(cheap, float)
        return cheap + self._terms(z, cheap) @ jnp.asarray(self.coefficients)

    def missed(
        self,
        z: Float[np.ndarray, "samples inputs"],
        cheap: Float[np.ndarray, " samples"],
        e: Float[np.ndarray, " samples"],
    ) -> Float[np.ndarray, " samples"]:
        """What other samples may be off by.

        Args:
            z: the samples.
            cheap: the cheap scalar there.
            e: a standard normal number for each.
        """
        terms = np.asarray(self._terms(z, jnp.asarray(cheap, float)))
        leverage = np.einsum("si,ij,sj->s", terms, self.covariance, terms)
        return self.error * np.sqrt(1.0 + leverage) * stdtrit(self.freedom, ndtr(e))

    def slope(self, cheap: Float[np.ndarray, " inputs"]) -> Float[np.ndarray, " inputs"]:
        """Derivative of the costly scalar by each z_i, from that of the cheap one."""
        scale = 0.0 if self.kind == "shift" else self.coefficients[1]
        own = self.coefficients[2:] if self.kind == "linear" else 0.0
        return np.asarray(cheap * (1.0 + scale) + own)

    def _terms(self, z: Array | np.ndarray, cheap: Array) -> Array:
        columns = [
            jnp.ones_like(cheap)[..., None],
            (cheap - self.middle)[..., None],
            jnp.asarray(z),
        ]
        return jnp.concatenate(columns[: TERMS.index(self.kind) + 1], axis=-1)


def correction(runs: Runs) -> Correction:
    """Learn what a costly scalar is beyond a cheap one.

    A single run without an expected error cannot tell its own: |c₀| is taken for it.

    Args:
        runs: of both; one without a value of both is left out, and counted.

    Raises:
        ValueError: no run has both values, or their numbers differ.
    """
    costly, cheap = np.asarray(runs.costly, float), np.asarray(runs.cheap, float)
    if costly.shape != cheap.shape or costly.ndim != 1:
        raise ValueError(f"costly has the shape {costly.shape}, cheap {cheap.shape}: give one each")
    good = np.isfinite(costly) & np.isfinite(cheap)
    if runs.z is not None:
        good &= np.all(np.isfinite(runs.z), axis=1)
    f, g = costly[good], cheap[good]
    n = len(f)
    if n == 0:
        raise ValueError("no run has a value of both scalars: give at least one that has")
    middle = float(np.mean(g))
    columns = [np.ones((n, 1)), (g - middle)[:, None]]
    if runs.z is not None:
        columns.append(np.asarray(runs.z)[good])
    chosen = None
    for k, kind in enumerate(TERMS[: len(columns)]):
        terms = np.concatenate(columns[: k + 1], axis=1)
        if chosen is not None and n < LEAST_RUNS_PER_TERM * terms.shape[1]:
            break
        found = _learned(runs, kind, terms, f, g, middle)
        if chosen is None or found[0] < CLEARLY * chosen[0]:
            chosen = found
    assert chosen is not None, "the shift is always learned"
    return chosen[1]


def _learned(
    runs: Runs, kind: str, terms: np.ndarray, f: np.ndarray, g: np.ndarray, middle: float
) -> tuple[float, Correction]:
    """A correction with its terms, behind the error of runs that are left out.

    With the leverages h_i, diagonal of X X⁺, a row's residual without it is r_i/(1 − h_i).
    """
    n, p = terms.shape
    inverse = np.linalg.pinv(terms)
    coefficients = inverse @ (f - g)
    residual = f - g - terms @ coefficients
    room = 1.0 - np.einsum("ij,ji->i", terms, inverse)
    alone = room < _WHOLE_LEVERAGE  # without such a run its own term has no others
    missed = np.where(alone, np.inf if n > 1 else 0.0, residual / np.where(alone, 1.0, room))
    left_out = float(np.sqrt(np.mean(missed**2)))
    before = EXPECTED_RUNS if runs.error > 0.0 else 0.0
    freedom = max(n - p, 0) + before
    if freedom > 0.0:
        error = float(np.sqrt((np.sum(residual**2) + before * runs.error**2) / freedom))
    else:
        error, freedom = float(np.abs(coefficients[0])), EXPECTED_RUNS
    few = n < 3 or not np.isfinite(left_out)
    related = np.nan if few else max(_correlation(f, f - missed), 0.0)
    gain = np.nan if few else float(np.var(f) / max(left_out**2, np.finfo(float).tiny))
    covariance = inverse @ inverse.T
    n_failed = len(runs.costly) - n
    return left_out, Correction(
        runs.name, kind, middle, coefficients, covariance, error, freedom, related, gain, n,
        n_failed,
    )  # fmt: skip


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    if np.std(a) == 0.0 or np.std(b) == 0.0:
        return 0.0
    return float(np.corrcoef(a, b)[0, 1])
