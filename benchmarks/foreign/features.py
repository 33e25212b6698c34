"""Features of a record's fit of the base model: as many whatever its sampling and its conditions.

Conditions are grouped in three kinds, and their means are taken. Of each kind and pressure trace:
the mean residual in windows of the beat, in mmHg, which does not depend on how finely the trace was
sampled, and the logarithm of χ²/n of the whitened residual. Of each kind: the residual of the mean
flow in units of its noise. Of the record: the unknowns that all conditions share, standardised, and
of every effect ln B of the score scan and the size that it expects.

Residuals, sizes and ln B pass through asinh, so that a large one counts less than in proportion.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from benchmarks.foreign.plain import FORMS, PlainFit
from diagnosis import CATALOGUE
from diagnosis.measured import Measured, data_of, weights
from diagnosis.pairs import causes_of
from diagnosis.prediction import SHARED, data_of_waves
from diagnosis.resolution import HARMONICS, SAMPLES
from diagnosis.spectra import TO_SAMPLES
from lumped import MMHG

KINDS = ("rest", "stress without dobutamine", "dobutamine")
"""Kinds of conditions."""

WINDOWS = 8
"""Windows of the beat, of equal length."""

RESIDUAL_MMHG = 0.5
"""Residual from which asinh bends."""

TRACES = ("P_aorta", "P_distal")

_COUNT = 2 * HARMONICS + 1


def features_of(fit: PlainFit) -> Float[np.ndarray, " k"]:
    """All features of a record; NaN where it lacks what a feature is made of.

    Args:
        fit: of the base model.
    """
    causes = causes_of(CATALOGUE, FORMS)
    log_B, size = np.asarray(fit.scan.log_B), np.asarray(fit.scan.size)
    scanned = [causes.evidence(log_B), size[causes.leaders(log_B)]]
    return np.concatenate(
        [
            residual_features(fit.record, np.asarray(fit.fitted.waves)),
            misfit_features(fit.record, np.asarray(fit.fitted.residual)),
            np.asarray(fit.fitted.x)[: len(SHARED)],
            np.arcsinh(np.concatenate(scanned)),
        ]
    )


def residual_features(
    record: Measured, waves: Float[np.ndarray, "c 3 n"]
) -> Float[np.ndarray, " k"]:
    """Mean residual in windows of the beat, by kind of condition, trace and window.

    Args:
        record: the record.
        waves: signals of the sensors by the fit [dyn/cm², cm³/s].
    """
    shown = np.asarray(data_of_waves(jnp.asarray(waves), record.n_sensors))
    seen = measured_data(record)
    left = np.where(seen, np.asarray(data_of(record)) - shown, 0.0) / MMHG
    size = len(TRACES) * _COUNT
    traces = left[:, :size].reshape(-1, len(TRACES), _COUNT) @ TO_SAMPLES.T
    means = traces.reshape(*traces.shape[:2], WINDOWS, SAMPLES // WINDOWS).mean(axis=-1)
    recorded = seen[:, :size].reshape(-1, len(TRACES), _COUNT).max(axis=-1)
    return np.arcsinh(_by_kind(record, means, recorded) / RESIDUAL_MMHG).ravel()


def measured_data(record: Measured) -> Bool[np.ndarray, "c d"]:
    """Which data a record holds, those left out apart."""
    return np.asarray(np.asarray(weights(record)) > 0.0)


def misfit_features(
    record: Measured, residual: Float[np.ndarray, "c d"]
) -> Float[np.ndarray, " k"]:
    """Ln(χ²/n) by kind of condition and trace, then the residual of the mean flow by kind.

    Args:
        record: the record.
        residual: whitened.
    """
    seen = measured_data(record)
    size = len(TRACES) * _COUNT
    square, count = (
        own[:, :size].reshape(-1, len(TRACES), _COUNT).sum(axis=-1) for own in (residual**2, seen)
    )
    chi2 = np.log(np.maximum(_by_kind(record, square / np.maximum(count, 1), count > 0), 1e-3))
    flow = _by_kind(record, residual[:, -1:], seen[:, -1:])
    return np.concatenate([chi2.ravel(), np.arcsinh(flow).ravel()])


def _by_kind(
    record: Measured, value: Float[np.ndarray, "c s ..."], seen: Bool[np.ndarray, "c s"]
) -> Float[np.ndarray, "k s ..."]:
    """Means over the conditions of each kind that were seen; NaN without any."""
    stress, dobutamine = np.asarray(record.stress) > 0.5, np.asarray(record.dobutamine) > 0.5
    kinds = np.stack([~stress, stress & ~dobutamine, dobutamine])
    share = kinds[:, :, None] * seen[None]
    count = share.sum(axis=1)
    total = np.einsum("kcs,cs...->ks...", share.astype(float), value)
    count = count.reshape(*count.shape, *[1] * (value.ndim - 2))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
