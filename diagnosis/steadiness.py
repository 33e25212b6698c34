"""Whether the beats of a record are alike, so that their mean stands for them.

The circuit is periodic: it knows one beat a condition. Of the beats k of all conditions, with the
pulse p_k (highest less lowest aortic pressure) over the mean pulse of its condition, and the drop
d_k (mean aortic less mean distal pressure),

    irregular     1.48 median |p_k − 1|, the robust standard deviation of the pulse
    alternating   |a|, a the mean of (−1)^k (p_k − ½ (p_{k−1} + p_{k+1}))/2, where it makes most of
                  these numbers: otherwise zero
    wandering     standard deviation of d_k less its regression on the mean aortic pressure, which
                  breathing moves

The scatter of beats (`scatter`) covers what breathing and the heart's own variation do. Above the
limits here something else acts: an arrhythmia, an alternating pulse, or a wire that moves or warms
up while it records.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lumped.units import MMHG

FEWEST_BEATS = 4
"""Beats of a condition from which they are compared."""

MOST_IRREGULAR = 0.10
"""Robust standard deviation of the pulse over its mean; breathing makes up to 0.05, atrial
fibrillation 0.2."""

MOST_ALTERNATING, ALTERNATING_SHARE = 0.03, 0.97
"""Alternating part of the pulse, and its least share of the squares that may show it."""

MOST_WANDERING = 0.5 * MMHG
"""Standard deviation of the drop [dyn/cm²]: as large as the slow offset of a trace that is assumed
where none is stated."""

WORDS = {
    "irregular": "the pulse varies from beat to beat as in an arrhythmia",
    "alternating": "every second beat is weaker",
    "wandering": "the distal trace wanders relative to the aortic one, as with a wire that moves "
    "or warms up",
}
"""What is said of beats that are not alike."""


class Steadiness(NamedTuple):
    """How unlike the beats of a record are, see above.

    Attributes:
        irregular, alternating: of the pulse [-].
        wandering: of the drop of the mean pressure [dyn/cm²].
    """

    irregular: float
    alternating: float
    wandering: float


def steadiness(conditions: Sequence[Mapping[str, np.ndarray]]) -> Steadiness:
    """How unlike the beats of a record are; zeros where no condition has `FEWEST_BEATS`.

    Args:
        conditions: beats × samples of each sensor; without P_distal where that may not be used.
    """
    pulses, seconds, rests = [], [], []
    for beats in conditions:
        P_aorta = beats.get("P_aorta")
        if P_aorta is None or P_aorta.shape[0] < FEWEST_BEATS:
            continue
        pulse = np.ptp(P_aorta, axis=1)
        pulse = pulse / max(float(np.mean(pulse)), 1e-9)
        pulses.append(pulse - 1.0)
        second = 0.5 * (pulse[1:-1] - 0.5 * (pulse[:-2] + pulse[2:]))
        seconds.append(second * (-1.0) ** np.arange(second.size))
        P_distal = beats.get("P_distal")
        if P_distal is not None and P_distal.shape == P_aorta.shape:
            rests.append(_beside_breathing(P_aorta.mean(axis=1), P_distal.mean(axis=1)))
    if not pulses:
        return Steadiness(0.0, 0.0, 0.0)
    irregular = 1.4826 * float(np.median(np.abs(np.concatenate(pulses))))
    wandering = float(np.sqrt(np.mean(np.concatenate(rests) ** 2))) if rests else 0.0
    return Steadiness(irregular, _alternating(seconds), wandering)


def _alternating(seconds: Sequence[Float[np.ndarray, " _"]]) -> float:
    """The mean of each condition, of either sign, if these make nearly all of the squares."""
    shown = sum(one.size * one.mean() ** 2 for one in seconds)
    if shown <= ALTERNATING_SHARE * sum(float(one @ one) for one in seconds):
        return 0.0
    return float(np.mean([abs(one.mean()) for one in seconds]))


def _beside_breathing(
    aortic: Float[np.ndarray, " k"], distal: Float[np.ndarray, " k"]
) -> Float[np.ndarray, " k"]:
    """Drop of each beat less its regression on the aortic mean, for two numbers fitted."""
    drop, x = aortic - distal, aortic - aortic.mean()
    drop = drop - drop.mean()
    rest = drop - x * (x @ drop) / max(float(x @ x), 1e-12)
    return rest * np.sqrt(rest.size / (rest.size - 2))


def unlike(found: Float[np.ndarray, "3"]) -> tuple[str, ...]:
    """In which ways beats are not alike, names of `WORDS`; none where they are.

    Args:
        found: numbers of `Steadiness`.
    """
    irregular, alternating, wandering = map(float, found)
    names = []
    if alternating > MOST_ALTERNATING:
        names.append("alternating")
    elif irregular > MOST_IRREGULAR:
        names.append("irregular")
    if wandering > MOST_WANDERING:
        names.append("wandering")
    return tuple(names)
