"""Evidence of an effect of unknown size in whitened data, the patient's unknowns integrated out.

With r the whitened data minus the base model's and its shift by the stated priors, d(z) what an
effect of coordinates z changes, J the directions of the patient's unknowns over their prior
standard deviations (`visibility.Nuisances`) and G = I + J Jᵀ,

    log N(r; d, G) − log N(r; 0, G) = dᵀG⁻¹r − ½ dᵀG⁻¹d
    G⁻¹ = I − J (I + JᵀJ)⁻¹ Jᵀ                                      (Woodbury 1950)
    log E = log ∫ N(r; d(z), G) / N(r; 0, G) N(z; 0, I) dz

(Rasmussen & Williams 2006, §2.7, for linear unknowns). d is known at a few nodes and interpolated
between them, d(z) = Σ_k w_k(z) d_k, so that all samples of the integral come from the Gram matrix
of the nodes. The weights are those of a Gaussian process (ibid., eq. 2.25) whose kernel is a
polynomial of second degree in Φ(z) and, for numbers uniform in a logarithm, in the number, plus a
small smooth rest. The integral is adaptive importance sampling
(Cornuet et al. 2012, Scand J Stat 39:798). A strong effect's likelihood is 1/λ wide: nodes are
added where the samples are until interpolation is right there (`branches`).
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import logsumexp, ndtr
from scipy.stats import qmc

Ranges = Sequence[tuple[float, float] | None]

SAMPLES, MORE, ROUNDS = 512, 256, 5
"""Samples of the prior, of each adapted proposal, and proposals."""

KEPT = 0.2
"""Share of a proposal's samples that tempering keeps effective."""

WIDEST_LOG = 6.0
"""Ranges that are wider are not those of a logarithm."""

REST, JITTER = 1e-3, 1e-10
"""Shares of the smooth rest and of the jitter in the kernel."""


@dataclasses.dataclass(frozen=True)
class Metric:
    """Products of whitened data under G.

    Attributes:
        columns: J, shape (data, directions).
        factor: Cholesky factor of I + JᵀJ.
    """

    columns: np.ndarray
    factor: tuple

    @staticmethod
    def of(columns: np.ndarray) -> "Metric":
        """The metric of directions J."""
        inner = np.eye(columns.shape[1]) + columns.T @ columns
        return Metric(columns, cho_factor(inner, lower=True))

    def product(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """aᵀ G⁻¹ b."""
        J = self.columns
        return a.T @ b - (J.T @ a).T @ cho_solve(self.factor, J.T @ b)

    def log_density(self, r: np.ndarray) -> float:
        """Log N(r; 0, G)."""
        log_det = 2.0 * float(np.log(np.diag(self.factor[0])).sum())
        return -0.5 * (float(self.product(r, r)) + log_det + r.size * float(np.log(2.0 * np.pi)))


def features(z: np.ndarray, ranges: Ranges) -> np.ndarray:
    """What the interpolation is a polynomial of, within ±1, shape (points, features)."""
    found = []
    for column, bounds in zip(z.T, ranges, strict=True):
        if bounds is None:
            found.append(column / 2.0)
            continue
        low, high = bounds
        v = ndtr(column)
        found.append(2.0 * v - 1.0)
        if high - low < WIDEST_LOG:
            found.append(2.0 * np.expm1(v * (high - low)) / np.expm1(high - low) - 1.0)
    return np.stack(found, axis=1) if found else np.zeros((z.shape[0], 0))


def _kernel(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    square = np.square(a[:, None, :] - b[None, :, :]).sum(axis=2)
    return np.square(1.0 + a @ b.T) + REST * np.exp(-2.0 * square)


@dataclasses.dataclass(frozen=True)
class Nodes:
    """Differences d at nodes z, seen through the metric.

    Attributes:
        z: shape (nodes, coordinates).
        d: shape (data, nodes).
        gram: dᵀG⁻¹d.
        along: dᵀG⁻¹r.
        ranges: bounds of the coordinates.
    """

    z: np.ndarray
    d: np.ndarray
    gram: np.ndarray
    along: np.ndarray
    ranges: Ranges

    @staticmethod
    def of(z: np.ndarray, d: np.ndarray, r: np.ndarray, metric: Metric, ranges: Ranges) -> "Nodes":
        """Nodes of differences."""
        return Nodes(z, d, metric.product(d, d), metric.product(d, r), ranges)

    def weights(self, z: np.ndarray) -> np.ndarray:
        """W of the module's docstring, shape (points, nodes)."""
        own, asked = features(self.z, self.ranges), features(z, self.ranges)
        K = _kernel(own, own)
        K[np.diag_indices_from(K)] += JITTER * np.trace(K)
        return np.linalg.solve(K, _kernel(own, asked)).T

    def gain(self, z: np.ndarray) -> np.ndarray:
        """Log N(r; d, G) − log N(r; 0, G) at points."""
        w = self.weights(z)
        return w @ self.along - 0.5 * np.einsum("pk,kl,pl->p", w, self.gram, w)

    def length(self, z: np.ndarray) -> float:
        """Length of d at one point, in standard deviations: its visibility."""
        w = self.weights(z[None])[0]
        return float(np.sqrt(max(w @ self.gram @ w, 0.0)))

    def most(self) -> float:
        """Largest gain of any combination of the nodes, an upper bound where they span d."""
        values, vectors = np.linalg.eigh(self.gram)
        kept = values > 1e-9 * max(values.max(initial=0.0), 1e-300)
        part = vectors[:, kept].T @ self.along
        return 0.5 * float(np.sum(part**2 / values[kept]))


class Integral(NamedTuple):
    """An integral over the coordinates.

    Attributes:
        log_evidence: log E.
        z: samples of the posterior, the likeliest first, shape (samples, coordinates).
        mean, spread: of the posterior, each coordinate.
    """

    log_evidence: float
    z: np.ndarray
    mean: np.ndarray
    spread: np.ndarray


def integrate(gain, count: int, seed: int = 0) -> Integral:
    """Log E by adaptive importance sampling.

    Args:
        gain: (points) → log-likelihood over that without an effect.
        count: number of coordinates.
        seed: of the samples.
    """
    none = np.zeros((1, count))
    if count == 0:
        return Integral(float(gain(none)[0]), none, none[0], none[0])
    rng = np.random.default_rng(seed)
    z = _normal(rng, count, SAMPLES)
    proposals: list[tuple[np.ndarray, np.ndarray]] = [(np.zeros(count), np.eye(count))]
    sizes = [SAMPLES]
    values = gain(z)
    for _ in range(ROUNDS):
        logw = values + _log_normal(z, *proposals[0]) - _log_mixture(z, proposals, sizes)
        if _effective(logw) > 0.5 * len(z):
            break
        w = _tempered(logw)
        mean = w @ z
        away = z - mean
        cov = 1.3 * (away.T * w) @ away + 1e-10 * np.eye(count)
        proposals.append((mean, cov))
        sizes.append(MORE)
        more = mean + _normal(rng, count, MORE) @ np.linalg.cholesky(cov).T
        z, values = np.concatenate([z, more]), np.concatenate([values, gain(more)])
    logw = values + _log_normal(z, *proposals[0]) - _log_mixture(z, proposals, sizes)
    w = np.exp(logw - logsumexp(logw))
    mean = w @ z
    spread = np.sqrt(np.maximum(w @ np.square(z - mean), 1e-20))
    best = int(np.argmax(values - 0.5 * np.square(z).sum(axis=1)))
    order = [best, *rng.choice(len(z), 32, p=w / w.sum())]
    return Integral(float(logsumexp(logw) - np.log(len(z))), z[order], mean, spread)


def _normal(rng: np.random.Generator, count: int, points: int) -> np.ndarray:
    sobol = qmc.Sobol(count, rng=rng)
    return qmc.MultivariateNormalQMC(np.zeros(count), engine=sobol).random(points)


def _log_normal(z: np.ndarray, mean: np.ndarray, cov: np.ndarray) -> np.ndarray:
    L = np.linalg.cholesky(cov)
    y = np.linalg.solve(L, (z - mean).T)
    norm = np.log(np.diag(L)).sum() + 0.5 * z.shape[1] * np.log(2.0 * np.pi)
    return -0.5 * np.square(y).sum(axis=0) - norm


def _log_mixture(z: np.ndarray, proposals: list, sizes: list[int]) -> np.ndarray:
    each = np.stack([_log_normal(z, *one) for one in proposals])
    return np.asarray(logsumexp(each, axis=0, b=np.array(sizes)[:, None] / sum(sizes)))


def _effective(logw: np.ndarray) -> float:
    w = np.exp(logw - logw.max())
    return float(w.sum() ** 2 / np.square(w).sum())


def _tempered(logw: np.ndarray) -> np.ndarray:
    """Weights at the largest power that keeps enough samples effective."""
    least, low, high = min(KEPT * MORE, 0.5 * len(logw)), 0.0, 1.0
    if _effective(logw) < least:
        for _ in range(12):
            middle = 0.5 * (low + high)
            if _effective(middle * logw) < least:
                high = middle
            else:
                low = middle
        logw = low * logw
    w = np.exp(logw - logw.max())
    return w / w.sum()
