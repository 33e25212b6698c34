"""Readings of effects' sizes, drawn from the generator, and what they change.

A sensor of `READINGS` reads the size of one or two effects with an error σ. The generator gives

    r = size + σ ε,    size = 0 where the effect does not act,    ε ~ N(0, 1).

A hypothesis h that leaves the size at N(m, s²) (m = s = 0 without the effect) predicts it with the
density N(r; m, s² + σ²), so that p(h | r) ∝ p(h) Π N(r; m, s² + σ²) (Bayes). Where the prior of a
size vanishes at zero, as the main part of the catalogue's does (`diagnosis.effects`), the
density is

    N(r; m, s² + σ²) E[φ² | r]/E[φ²],    φ | r ~ N((m σ² + r s²)/(s² + σ²), s² σ²/(s² + σ²)),

with Φ, and moments of the positive half, where the effect is one-sided. The expected information is
that of the readings about the hypotheses, I = E[ln p(h | r) − ln p(h)], h and r as the diagnosis
predicts them.

Sizes mean what the instrument would show, where generator and catalogue have other equations: a
loss is read as the coefficient of Q² that gives the same drop at the mean flow under stress, a
drift as the offset at the end over the number of steps, and a late squeeze is no stronger one.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.stats import norm

from benchmarks.blind.advice import Row
from benchmarks.blind.sensors import DRIFT_STEPS
from diagnosis import CATALOGUE
from diagnosis.next_measurement import READINGS

ONE_SIDED = {effect.id: effect.one_sided for effect in CATALOGUE}
WIDTH = {effect.id: effect.sd for effect in CATALOGUE}

DRAWS = 400
"""Draws of hypothesis and reading for the expected information."""

TRUE_EXPONENT, TURBULENT_EXPONENT = 1.85, 1.75
"""Exponents of the generator's loss and of the catalogue's second form."""


class Possible(NamedTuple):
    """A hypothesis, or "unknown" beside some effects, and its sizes by effect.

    Attributes:
        key: its name among the probabilities.
        beside: effects beside which something unknown acts; None for a hypothesis of the catalogue.
        p: probability.
        sizes: mean and sd of every effect's reading [unit of the size].
    """

    key: str
    beside: str | None
    p: float
    sizes: Mapping[str, tuple[float, float]]


def errors_of(sensor: str) -> dict[str, float]:
    """Errors of a sensor's readings by effect."""
    return dict(READINGS[sensor][1])


def true_reading(name: str, size: float, row: Row) -> float:
    """What an instrument without error reads of an effect of the generator, see above."""
    if name == "quadratic_loss":
        return size * row["flow"] ** (TRUE_EXPONENT - 2.0)
    if name == "wire_drift":
        last = int(row["last"])
        return size * DRIFT_STEPS[last] / last
    return size


def scale_of(name: str, form: str, row: Row) -> float:
    """Reading over size, of an effect of the catalogue in a form."""
    if (name, form) == ("quadratic_loss", "turbulent friction"):
        return row["flow"] ** (TURBULENT_EXPONENT - 2.0)
    if name == "wire_drift" and form:
        return {"slowing down": np.sqrt(row["last"]), "after rest": 1.0}[form] / row["last"]
    if (name, form) == ("intramyocardial_pump", "late"):
        return 0.0
    return 1.0


def parts_of(row: Row) -> list[Possible]:
    """All hypotheses of a row with what they predict of readings.

    A pair that was not fitted has the sizes of its effects alone; an effect without any fit has
    its prior.
    """

    def sizes(key: str) -> dict[str, tuple[float, float]]:
        found = {}
        for name in () if key == "none" else key.split("+"):
            own = row["sizes"].get(key, {})
            mean, sd, form = own.get(name) or row["sizes"].get(name, {}).get(
                name, (0.0, WIDTH[name], "")
            )
            scale = scale_of(name, form, row)
            found[name] = (scale * mean, scale * sd)
        return found

    known = [
        Possible(k, None, p, sizes(k)) for k, p in row["probabilities"].items() if k != "unknown"
    ]
    return known + [Possible("unknown", h, p, sizes(h)) for h, p in row["beside"].items()]


def log_density(
    r: Float[np.ndarray, "*n"],
    mean: Float[np.ndarray, "*n"],
    sd: Float[np.ndarray, "*n"],
    error: float,
    *,
    moment: bool = False,
    one_sided: bool = False,
) -> Float[np.ndarray, "*n"]:
    """Ln density of a reading under hypotheses, see above.

    Args:
        r: the reading.
        mean: of the size under each; zero where the effect does not act.
        sd: the same.
        error: of the reading.
        moment: whether the prior vanishes at zero, and below where one-sided.
        one_sided: whether the size is positive.
    """
    total = np.sqrt(sd**2 + error**2)
    plain = norm.logpdf(r, mean, total)
    if not moment:
        return plain
    acts = sd > 0.0
    s = np.where(acts, sd, 1.0)
    after = (mean * error**2 + r * s**2) / (s**2 + error**2)
    left = s * error / np.sqrt(s**2 + error**2)
    more = _log_moment(after, left, one_sided) - _log_moment(mean, s, one_sided)
    return plain + np.where(acts, more, 0.0)


def _log_moment(mean: np.ndarray, sd: np.ndarray, one_sided: bool) -> np.ndarray:
    """Ln ∫ φ² N(φ; mean, sd²), over positive φ where one-sided."""
    if not one_sided:
        return np.log(mean**2 + sd**2)
    z = np.maximum(mean / sd, -6.0)
    inside = (z**2 + 1.0) * norm.cdf(z) + z * norm.pdf(z)
    return np.log(np.maximum(inside, 1e-14)) + 2.0 * np.log(sd)


def updated(
    parts: Sequence[Possible],
    readings: Mapping[str, float],
    errors: Mapping[str, float],
    moment: bool = False,
) -> np.ndarray:
    """Probabilities of the parts after some readings (Bayes)."""
    p = np.array([part.p for part in parts])
    log_p = np.log(np.maximum(p, 1e-300)) + log_likelihood(parts, readings, errors, moment)
    log_p -= log_p.max()
    return np.exp(log_p) / np.exp(log_p).sum()


def log_likelihood(
    parts: Sequence[Possible],
    readings: Mapping[str, float],
    errors: Mapping[str, float],
    moment: bool = False,
) -> np.ndarray:
    """Ln density of some readings together, by part."""
    total = np.zeros(len(parts))
    for name, r in readings.items():
        mean, sd = np.array([part.sizes.get(name, (0.0, 0.0)) for part in parts]).T
        sided = ONE_SIDED[name]
        total += log_density(
            np.full(mean.shape, r), mean, sd, errors[name], moment=moment, one_sided=sided
        )
    return total


def expected_information(
    parts: Sequence[Possible], sensor: str, rng: np.random.Generator, draws: int = DRAWS
) -> float:
    """Expected information of a sensor's readings about the hypotheses [nats], see above."""
    errors = errors_of(sensor)
    p = np.array([part.p for part in parts])
    # what predicts the same reading is one hypothesis as far as the sensor is concerned
    groups: dict[tuple, float] = {}
    for part, share in zip(parts, p / p.sum(), strict=True):
        key = tuple(part.sizes.get(name, (0.0, 0.0)) for name in errors)
        groups[key] = groups.get(key, 0.0) + share
    share = np.array(list(groups.values()))
    moments = np.array(list(groups))
    drawn = rng.choice(share.size, draws, p=share / share.sum())
    sigma = np.array(list(errors.values()))
    spread = np.sqrt(moments[..., 1] ** 2 + sigma**2)
    r = moments[drawn, :, 0] + spread[drawn] * rng.standard_normal((draws, sigma.size))
    each = norm.logpdf(r[:, None], moments[None, ..., 0], spread[None]).sum(axis=-1)
    log_total = np.log(np.exp(each - each.max(axis=1, keepdims=True)) @ share)
    log_total += each.max(axis=1)
    return float(np.mean(each[np.arange(draws), drawn] - log_total))
