"""A costly scalar from a few runs and a cheap one from many: two levels.

A cheap scalar g(z) follows a costly one f(z), such as FFR of a 3D run, closely but not exactly.
What it lacks is learned from few runs of both,

    f(z) ≈ g(z) + δ(z) + e,     δ = c₀ + c₁ (g − ḡ) + Σ c_i z_i,

with as many of these terms, in this order, as the runs support: those whose error is least when
each run in turn is left out. e is normal with that error, so that an interval does not look
narrower than the runs say; a single run cannot tell, and its error is taken to be |c₀|. With the
correlation ρ of f and g + δ, each run left out, the mean of f has 1/(1 − ρ²) times less variance
than from the same runs without g.

Source: Giles 2015, Multilevel Monte Carlo methods, Acta Numerica 24:259, sec. 1.2 and 2.1 (control
variates, two levels); Hastie, Tibshirani & Friedman 2009, sec. 7.10 (leaving one out).
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

TERMS = ("shift", "scale", "linear")
"""Kinds of corrections, each with the terms of those before it."""

LEAST_RUNS_PER_TERM = 2.0
"""Runs that each term of a correction must have."""


class Runs(NamedTuple):
    """A costly scalar and a cheap one of the same inputs.

    Attributes:
        costly: the costly one; NaN where it has no value.
        cheap: the cheap one; NaN likewise.
        z: the inputs as standard normal numbers, in the order of the inputs; None where they are
            not draws of their distributions, and terms in z cannot be learned.
    """

    costly: Float[np.ndarray, " runs"]
    cheap: Float[np.ndarray, " runs"]
    z: Float[np.ndarray, "runs inputs"] | None = None


class Correction(eqx.Module):
    """What a costly scalar is beyond a cheap one.

    Attributes:
        kind: one of `TERMS`.
        middle: mean of the cheap scalar over the runs.
        coefficients: of the terms.
        error: standard deviation of a run that is left out.
        correlation: of the costly and the corrected cheap scalar, each run left out; NaN with less
            than three runs.
        n_runs: runs that it was learned from.
    """

    kind: str
    middle: float
    coefficients: Float[np.ndarray, " terms"]
    error: float
    correlation: float
    n_runs: int

    def __call__(
        self,
        z: Float[Array | np.ndarray, "*samples inputs"],
        cheap: Float[Array | np.ndarray, "*samples"],
    ) -> Float[Array, "*samples"]:
        """The costly scalar expected at other samples, from the cheap one there."""
        change = jnp.full_like(cheap, self.coefficients[0])
        if self.kind != "shift":
            change = change + self.coefficients[1] * (cheap - self.middle)
        if self.kind == "linear":
            change = change + z @ self.coefficients[2:]
        return jnp.asarray(cheap + change)

    def slope(self, cheap: Float[np.ndarray, " inputs"]) -> Float[np.ndarray, " inputs"]:
        """Derivative of the costly scalar by each z_i, from that of the cheap one."""
        scale = 0.0 if self.kind == "shift" else self.coefficients[1]
        own = self.coefficients[2:] if self.kind == "linear" else 0.0
        return np.asarray(cheap * (1.0 + scale) + own)

    @property
    def gain(self) -> float:
        """Variance of the mean of the runs alone over that with the cheap scalar beside them."""
        return 1.0 / max(1.0 - self.correlation**2, np.finfo(float).eps)


def correction(runs: Runs) -> Correction:
    """Learn what a costly scalar is beyond a cheap one.

    Args:
        runs: of both; one without a value of both is left out.

    Raises:
        ValueError: no run has both values.
    """
    good = np.isfinite(runs.costly) & np.isfinite(runs.cheap)
    f, g = runs.costly[good], runs.cheap[good]
    n = len(f)
    if n == 0:
        raise ValueError("no run has a value of both scalars: give at least one that has")
    middle = float(np.mean(g))
    columns = [np.ones((n, 1)), (g - middle)[:, None]]
    if runs.z is not None:
        columns.append(runs.z[good])
    found = []
    for k, kind in enumerate(TERMS[: len(columns)]):
        terms = np.concatenate(columns[: k + 1], axis=1)
        if found and n < LEAST_RUNS_PER_TERM * terms.shape[1]:
            break
        coefficients, missed = _least_squares(terms, f - g)
        error = float(np.sqrt(np.mean(missed**2))) if n > 1 else float(np.abs(coefficients[0]))
        related = _correlation(f, f - missed)
        found.append(Correction(kind, middle, coefficients, error, related, n))
    return min(found, key=lambda one: one.error)


def _least_squares(columns: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients, and by how much each row is missed by those of the others.

    With the leverages h_i, diagonal of X X⁺, a row's residual without it is r_i/(1 − h_i).
    """
    inverse = np.linalg.pinv(columns)
    coefficients = inverse @ y
    leverage = np.einsum("ij,ji->i", columns, inverse)
    residual = y - columns @ coefficients
    return coefficients, residual / np.maximum(1.0 - leverage, 1e-12)


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    if len(a) < 3 or np.std(a) == 0.0 or np.std(b) == 0.0:
        return np.nan
    return float(np.corrcoef(a, b)[0, 1])
