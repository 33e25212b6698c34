"""Evidence of an effect without measured waveforms, by integration over its size.

Ratios and means hardly distinguish a large loss with little flow from a small loss with much flow:
size and α lie on a curved ridge, and the Laplace approximation at one of its points misses most of
it. (For quadratic losses known by three ratios it misses up to seven units of ln Z, and half of all
draws of ten patients with such a loss were attributed to drift or dynamic narrowing.) At a given
size x the other unknowns are close to normal. The evidence Z(x), from fits at several sizes x > 0,
is integrated over the prior::

    Z = ∫ Z(x) p(x) dx,     p(x) = 2 ((1 − w) x² + w) N(x; 0, 1)

with ln Z(x) between the sizes by a cubic spline. At size zero it is that of the base model. In a
record with a loss of 5.6 mmHg s²/mL², and w = 0, ln B is −1.64 (by 16 384 draws from the prior
−1.71 ± 0.08), where the Laplace approximation gives −7.21.

Source: integrated nested Laplace approximations, Rue, Martino & Chopin 2009 (J R Stat Soc B
71:319).
"""

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import logsumexp

from diagnosis.effects import NEAR_ZERO, Effect
from diagnosis.engine import ProgressCallback, no_progress, run_fits
from diagnosis.fit import Fitted
from diagnosis.hypothesis import Catalogue
from diagnosis.measured import Measured

SIZES = np.array([0.15, 0.35, 0.7, 1.2, 1.8, 2.6, 3.6])
"""Sizes at which the other unknowns are fitted [widths of the prior]."""

FINE = np.linspace(0.0, SIZES[-1], 361)
"""Sizes over which is summed; the prior has 0.5 % of its mass beyond."""


def along_ridges(
    batch: Measured,
    base: Fitted,
    positions: np.ndarray,
    numbers: Catalogue,
    effects: tuple[Effect, ...],
    progress: ProgressCallback = no_progress,
) -> Fitted:
    """Fits of one-sided effects to all records: evidence by the integral, at the mean size.

    Args:
        batch: the records.
        base: fits of the base model.
        positions: of the effects in the catalogue.
        numbers: of the catalogue.
        effects: the catalogue.
        progress: called after each block.

    Returns:
        Fits by record, then effect.
    """
    record = np.repeat(np.arange(batch.period.shape[0]), positions.size)
    effect = np.tile(positions, batch.period.shape[0])

    def fits(record: np.ndarray, effect: np.ndarray, fixed_size: np.ndarray) -> Fitted:
        pairs = np.stack([effect, np.full_like(effect, -1)], axis=1)
        starts = np.asarray(base.optimum)[record]
        return run_fits(
            batch, record, pairs, starts, numbers, effects,
            fixed_size=fixed_size, step="following the ridges", progress=progress,
        )  # fmt: skip

    n, jobs = SIZES.size, record.size
    found = fits(np.repeat(record, n), np.repeat(effect, n), np.tile(SIZES, jobs))
    none = np.asarray(base.log_evidence)[record, None]
    log_Z = np.concatenate([none, np.asarray(found.log_evidence).reshape(jobs, n)], axis=1)
    whole = np.all(np.isfinite(log_Z), axis=1)
    total, mean, sd = integrals(np.where(whole[:, None], log_Z, 0.0))
    best = fits(record, effect, mean)
    size_sd = np.stack([sd * np.asarray(numbers.sd)[effect], np.zeros(jobs)], axis=1)
    sound = best.sound & whole
    return best._replace(log_evidence=np.where(sound, total, -np.inf), size_sd=size_sd, sound=sound)


def integrals(log_Z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ln ∫ Z(x) p(x) dx over positive sizes, and the posterior's mean and standard deviation.

    Args:
        log_Z: of jobs at size zero and at `SIZES`.
    """
    between = CubicSpline(np.append(0.0, SIZES), log_Z, axis=1)(FINE)
    step = FINE[1] - FINE[0]
    factor = (1.0 - NEAR_ZERO) * FINE**2 + NEAR_ZERO
    factor[0] *= 0.5  # trapezoidal rule; nothing is left at the other end
    log_prior = np.log(factor) - 0.5 * FINE**2 + 0.5 * np.log(2.0 / np.pi)
    log_p = between + log_prior + np.log(step)
    total = np.asarray(logsumexp(log_p, axis=1))
    share = np.exp(log_p - total[:, None])
    mean = share @ FINE
    return total, mean, np.sqrt(np.maximum(share @ FINE**2 - mean**2, 0.0))
