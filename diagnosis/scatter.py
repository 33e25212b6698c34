"""Noise of the mean of several beats, estimated from their scatter.

With r_k the coefficients of all sensors of beat k minus their mean, and b the number of beats,

    r_k = B a_k + noise,   a_k ~ N(0, Σ),   noise ~ N(0, D),     mean beat: D/b + B Σ Bᵀ/b,

plus errors of the folding itself (`FORM_SHARE`, `FORM_SD`) where the beats were folded.

B holds the physiological variations of every sensor from beat to beat: level, trend and bend of the
baseline (breathing), pulse, and timing (a shift of the whole beat, and relative shifts of its parts
by errors of the folding: derivative times 1, cos, sin). Σ couples the sensors: aortic and distal
pressure of one beat rise together. D is diagonal, one power a harmonic, equal in both pressures and
smooth along the harmonics; that of the mean, which cannot be told from the level, is that of the
first harmonic. Σ and D are estimated by expectation-maximisation (Dempster, Laird & Rubin 1977;
factor analysis with known loadings). A prior s Σ₀ with the weight of `USUAL_WEIGHT` beats
regularises Σ for few beats:

    Σ = (Σ_k E[a_k a_kᵀ] + ν₀ s Σ₀)/(b − 1 + ν₀ − 2)       (mean of an inverse Wishart distribution)

A heart paced, or breathing held, has beats far more alike than usual: s is one of `ALIKE`, with
weights by the likelihood of the beats for Σ = s Σ₀.

An error of the start of ejection adds one column, a common delay of all sensors of a condition. No
effect delays all sensors, so none can be named for it.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from diagnosis.resolution import HARMONICS, SAMPLES
from diagnosis.spectra import FROM_SAMPLES, PHASE, TO_SAMPLES, autoregressive_shape
from lumped.units import MMHG

USUAL_WEIGHT = 6.0
"""ν₀: weight of the prior covariance [beats]."""

ALIKE = (1.0, 0.1, 0.01, 0.001)
"""How alike beats may be: factors s on the prior covariance."""

USUAL_LEVEL, USUAL_LEVEL_SHARE = 0.3 * MMHG, 0.01
"""Prior sd of the level of a beat, and of its rise over the beat: of a pressure [dyn/cm²], and of a
flow over its mean."""

USUAL_PULSE, USUAL_TIME = 0.005, 0.003
"""Prior sd of the relative pulse of a beat, and of its timing [beats]."""

OWN_SHARE = 0.1
"""Share of the prior variance of timing and of breathing that is independent between sensors."""

FORMS = 7
"""Columns of B of each sensor."""

FEWEST_BEATS = 3
"""Beats from which noise is estimated."""

FORM_SHARE = 0.1
"""Share of the prior variances that averaging does not reduce: errors of the folding itself."""

FORM_SD = 0.1 * MMHG
"""Further error of the mean beat of a pressure by folding, as noise of its samples [dyn/cm²];
assumed."""

SWEEPS, SETTLED = 200, 1e-3
"""Most iterations of expectation-maximisation, and relative change of the powers that ends it."""

WIDE = 100.0
"""Factor on the usual covariance from which it starts: from below, the noise of the low harmonics
takes breathing in, and the iterations hardly leave that."""

LOW = 4
"""Harmonics that the forms of a beat nearly span, so that the scatter hardly tells their noise. It
is at least that of the autoregressive noise which those above have."""

MEMORIES = (0.0, 0.005, 0.01, 0.015, 0.022, 0.03, 0.045, 0.065)
"""Correlation times of that noise [beats]; zero is white."""

WIDTH = 0.25
"""Harmonics on either side over which noise is averaged, one more than this part of their
number."""


def forms(beat: np.ndarray) -> np.ndarray:
    """Columns of B of one sensor: coefficients × `FORMS`.

    Args:
        beat: its mean beat on `SAMPLES` samples.
    """
    slope = slope_of(beat)
    angle = 2.0 * np.pi * PHASE
    columns = [
        np.ones(SAMPLES),
        beat - beat.mean(),
        slope,
        slope * np.cos(angle),
        slope * np.sin(angle),
        *_baseline(),
    ]
    return FROM_SAMPLES @ np.stack(columns, axis=1)


def _baseline() -> list[np.ndarray]:
    """Trend and bend of a baseline within the beat: breathing takes three beats or more."""
    trend = PHASE - PHASE.mean()
    bend = 6.0 * (trend**2 - np.mean(trend**2))
    return [trend, bend]


def slope_of(beat: np.ndarray) -> np.ndarray:
    """Derivative of a beat with respect to its phase, kept harmonics only [its unit per beat]."""
    q = FROM_SAMPLES @ beat
    turn = 2.0 * np.pi * np.arange(1, HARMONICS + 1)
    re, im = q[1 : HARMONICS + 1], q[HARMONICS + 1 :]
    return TO_SAMPLES @ np.concatenate([[0.0], -turn * im, turn * re])


def usual(names: Sequence[str], means: Sequence[float]) -> np.ndarray:
    """Σ₀ of all sensors of a condition.

    Args:
        names: of the sensors.
        means: of their traces.
    """
    S = len(names)
    found = np.zeros((S, FORMS, S, FORMS))
    level = [
        USUAL_LEVEL_SHARE * abs(mean) if name == "Q" else USUAL_LEVEL
        for name, mean in zip(names, means, strict=True)
    ]
    alike = np.array([[name != "Q" and other != "Q" for other in names] for name in names])
    breathing = np.outer(level, level) * np.where(alike, 1.0 - OWN_SHARE, 0.0)
    np.fill_diagonal(breathing, np.square(level))
    timing = np.where(np.eye(S, dtype=bool), 1.0, 1.0 - OWN_SHARE) * USUAL_TIME**2
    for form in range(FORMS):
        if form == 1:
            found[:, form, :, form] = np.eye(S) * USUAL_PULSE**2
        else:
            found[:, form, :, form] = timing if form in (2, 3, 4) else breathing
    return found.reshape(S * FORMS, S * FORMS)


def smoothed(power: np.ndarray) -> np.ndarray:
    """Power averaged over neighbouring harmonics."""
    width = 1 + np.round(WIDTH * np.arange(power.size)).astype(int)
    return np.array([power[max(k - w, 0) : k + w + 1].mean() for k, w in enumerate(width)])


def scatter(
    stacks: Sequence[np.ndarray], B: np.ndarray, Sigma_0: np.ndarray, prior: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Power of the noise of one beat by harmonic, and the covariance Σ of its forms.

    Args:
        stacks: beats × samples of each sensor, of equal shape, scaled to the noise of the first.
        B: (sensors × coefficients kept) × forms of all sensors.
        Sigma_0: prior covariance of the forms.
        prior: power of one beat without data, kept harmonics.
    """
    b, n = stacks[0].shape
    if b < 2:
        return prior.copy(), Sigma_0.copy()
    K = min((n - 1) // 2, HARMONICS)
    r = np.concatenate([_coefficients(stack - stack.mean(axis=0), K) for stack in stacks], axis=1)
    begun, reds = (prior, WIDE * Sigma_0), red_spectra(K, n)
    found = [_scatter_about(r, B, s * Sigma_0, begun, reds, len(stacks)) for s in ALIKE]
    log_L = np.array([value for _, _, value in found])
    weight = np.exp(log_L - log_L.max())
    weight /= weight.sum()
    return (
        np.tensordot(weight, np.array([power for power, _, _ in found]), 1),
        np.tensordot(weight, np.array([Sigma for _, Sigma, _ in found]), 1),
    )


def _scatter_about(
    r: np.ndarray,
    B: np.ndarray,
    Sigma_0: np.ndarray,
    begun: tuple[np.ndarray, np.ndarray],
    reds: np.ndarray,
    S: int,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Power and Σ of deviations r of the beats, and ln of their likelihood for Σ = Σ₀."""
    power, Sigma = begun[0].copy(), begun[1]
    freedom, K = r.shape[0] - 1, power.size - 1
    each, share = np.r_[0 : K + 1, 1 : K + 1], np.r_[1.0, np.full(2 * K, 2.0)]
    for _ in range(SWEEPS):
        D = np.tile(share * power[each], S)
        BD = B / D[:, None]
        covariance = np.linalg.inv(np.linalg.inv(Sigma) + B.T @ BD)
        a = r @ BD @ covariance
        second = a.T @ a + freedom * covariance
        Sigma = (second + USUAL_WEIGHT * Sigma_0) / (freedom + USUAL_WEIGHT - 2.0)
        rest = r - a @ B.T
        square = (rest**2).sum(axis=0) + freedom * np.sum(B @ covariance * B, axis=1)
        square = (square / np.tile(share, S)).reshape(S, -1).sum(axis=0)
        total = np.bincount(each, square) / np.bincount(each)
        before = power.copy()
        power[1:] = smoothed(total[1:] / (freedom * S))
        power[: LOW + 1] = np.maximum(power, likest(reds, power))[: LOW + 1]
        power[0] = power[1]
        if np.all(np.abs(power - before) < SETTLED * before):
            break
    D = np.tile(share * power[each], S)
    left = r @ (B / D[:, None])
    inner = np.linalg.inv(Sigma_0) + B.T @ (B / D[:, None])
    square = np.sum(r**2 / D) - np.sum(left * np.linalg.solve(inner, left.T).T)
    volume = np.sum(np.log(D)) + np.linalg.slogdet(inner)[1] + np.linalg.slogdet(Sigma_0)[1]
    return power, Sigma, float(-0.5 * square - 0.5 * freedom * volume)


def red_spectra(K: int, n: int) -> np.ndarray:
    """Spectra of autoregressive noise of all `MEMORIES`: memories × harmonics 0 to K.

    Args:
        K: harmonics, besides the mean.
        n: samples a beat.
    """
    rho = np.array([np.exp(-1.0 / (n * time)) if time > 0.0 else 0.0 for time in MEMORIES])
    return autoregressive_shape(rho[:, None], np.cos(2.0 * np.pi * np.arange(K + 1) / n))


def likest(spectra: np.ndarray, power: np.ndarray) -> np.ndarray:
    """The spectrum that is likest to the power of the harmonics above `LOW`, with its size.

    With a spectrum h and its size by the mean of power/h, the Whittle likelihood of K harmonics is
    exp(−Σ ln h − K ln size) but for a constant.
    """
    upper = slice(min(LOW + 1, power.size - 1), None)
    size = np.mean(power[upper] / spectra[:, upper], axis=1)
    best = np.argmin(np.mean(np.log(spectra[:, upper]), axis=1) + np.log(size))
    return size[best] * spectra[best]


class FoldedNoise(NamedTuple):
    """Noise of the mean of folded beats.

    Attributes:
        power: variance of each sensor's harmonics over 2, infinite where not measured.
        modes: columns U of correlated coefficients, sensors × coefficients × columns.
    """

    power: np.ndarray
    modes: np.ndarray


def folded_noise(
    beats: Mapping[str, np.ndarray],
    waves: Mapping[str, np.ndarray],
    parametric: Mapping[str, np.ndarray],
    form: np.ndarray | None,
    start_sd: float,
    *,
    estimate: bool,
) -> FoldedNoise:
    """Noise of the mean of several beats, from their scatter and the stated or assumed noise.

    Args:
        beats: beats × samples of each sensor.
        waves: the mean beats on `SAMPLES` samples.
        parametric: power of the mean's harmonics as stated or assumed, of each sensor.
        form: power of the error of folding in a pressure; None where whole beats were cut.
        start_sd: of the start of ejection [beats].
        estimate: whether the noise of pressures comes from the scatter alone, given enough beats.
    """
    names = list(beats)
    b, n = beats[names[0]].shape
    K, S = min((n - 1) // 2, HARMONICS), len(names)
    rows = kept(K)
    own = [forms(waves[name]) for name in names]
    scale = _scales(beats, own, rows)
    B = np.zeros((S, rows.size, S, FORMS))
    for s in range(S):
        B[s, :, s] = scale[s] * own[s][rows]
    Sigma_0 = usual(names, [float(waves[name].mean()) for name in names])
    prior = b * parametric["P_aorta"][: K + 1]
    stacks = [g * beats[name] for g, name in zip(scale, names, strict=True)]
    found, Sigma = scatter(stacks, B.reshape(S * rows.size, -1), Sigma_0, prior)
    power = np.full((S, HARMONICS + 1), np.inf)
    freedom = 6.0 * S * (b - 1)
    for s, name in enumerate(names):
        stated = parametric[name][: K + 1]
        seen = found / b / scale[s] ** 2 * freedom / max(freedom - 2.0, 1.0)
        alone = estimate and name != "Q"
        if b < FEWEST_BEATS:
            seen = stated
        elif not alone:
            seen = seen * max(1.0, _variance(stated) / _variance(seen))
        power[s, : K + 1] = seen + (0.0 if name == "Q" or form is None else form[: K + 1])
    wide = np.zeros((S, own[0].shape[0], S, FORMS))
    for s in range(S):
        wide[s, :, s] = own[s]
    columns = wide.reshape(S, own[0].shape[0], -1) @ np.linalg.cholesky(
        Sigma / b + (0.0 if form is None else FORM_SHARE) * Sigma_0
    )
    late = np.stack([FROM_SAMPLES @ slope_of(waves[name]) for name in names]) * start_sd
    return FoldedNoise(power, np.concatenate([columns, late[..., None]], axis=-1))


def _variance(power: np.ndarray) -> float:
    """Variance of samples, of the power of their harmonics."""
    return float(power[0] + 2.0 * power[1:].sum())


def _scales(
    beats: Mapping[str, np.ndarray], own: list[np.ndarray], rows: np.ndarray
) -> list[float]:
    """Factor on each sensor that scales its noise to that of the pressures."""
    left = {}
    for (name, stack), B in zip(beats.items(), own, strict=True):
        K = min((stack.shape[1] - 1) // 2, HARMONICS)
        r = _coefficients(stack - stack.mean(axis=0), K).T
        Q = np.linalg.qr(B[rows])[0]
        left[name] = float(np.sqrt(np.mean((r - Q @ (Q.T @ r)) ** 2)))
    alike = np.mean([value for name, value in left.items() if name != "Q"])
    return [alike / left[n] if n == "Q" and alike > 0.0 and left[n] > 0.0 else 1.0 for n in beats]


def _coefficients(beats: np.ndarray, K: int) -> np.ndarray:
    """Real coefficients of the first K harmonics of beats."""
    spectrum = np.fft.rfft(beats, axis=1)[:, : K + 1] / beats.shape[1]
    spectrum[:, 1:] *= 2.0
    return np.concatenate([spectrum.real, spectrum.imag[:, 1:]], axis=1)


def kept(K: int) -> np.ndarray:
    """Positions of the first K harmonics among the real coefficients of a trace."""
    return np.r_[0 : K + 1, HARMONICS + 1 : HARMONICS + 1 + K]
