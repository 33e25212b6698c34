"""From evidences to probabilities, and from probabilities to one of four verdicts.

Prior: no gap 0.20; one effect 0.50, shared evenly; two effects 0.15, shared evenly; unknown 0.15,
shared evenly over all kinds of a free forcing. A fraction `BESIDE` of the prior of every effect or
pair is for an additional unknown effect, and counts as "unknown". The inclusion probability of an
effect sums its probabilities alone, in pairs, and together with an unknown effect.

No form of an effect is exactly that of nature: what is left beside a strong effect looks like a
weak second one. With the lengths λ of their traces in units of noise, λ² = 2 Δ ln Z, and a
difference of forms that takes a share ε = `FORM_ERROR` of the first length, a second effect is
such a difference with probability

    exp(−λ₂² / (2 ε² λ₁²)) = exp(−(ln Z_ab − ln Z_a) / (2 ε² (ln Z_a − ln Z_0))),

by which the probability of the pair goes to the effect alone; likewise that of an unknown effect
beside it, or beside the pair. Effects whose equation is settled (no further form: a constant
offset) have no such difference.

| verdict | when |
|---|---|
| no_gap | P(none) ≥ 0.1: no gap can be demonstrated |
| named | effects have an inclusion ≥ 0.9, close the gap, and predict what was left out no worse |
| unknown | P(unknown) ≥ 0.5, or effects would be named but do not close the gap or predict worse |
| ambiguous | else: the smallest set of hypotheses with 90 % of the probability |

Nothing is named, and no gap is not stated, where the beats are not alike (`steadiness`): the
verdict is then unknown, or stays ambiguous.

Closed: the remaining misfit has p > 0.001 or is below 10 % of the base model's excess.
(The noise is never known exactly: 5 % of its variance is a quarter of what p = 0.001 allows.)
Predicts worse: the ln predictive density of the held-out conditions falls by more than 1 against no
gap, by more than 5 where that of the fitted ones, each left out in turn, rises; without such
conditions, that of the fitted ones falls (`predictive`).
"""

from collections.abc import Collection, Mapping
from typing import Literal, NamedTuple

import numpy as np
from scipy.special import chdtrc, logsumexp

PRIOR = {"none": 0.20, "single": 0.50, "pair": 0.15, "unknown": 0.15}
"""Prior probability of each kind of hypothesis."""

BESIDE = 0.06
"""Probability that an effect outside the catalogue acts together with one of the catalogue: one
cause in six has a second (pair : single), of which two or three in ten are not in the catalogue."""

FORM_ERROR = 0.15
"""Difference of an effect's trace from that of its nearest form in the catalogue, as a share of its
length. In records of other hands, where the remainder looked like a second effect, it was 5 to 25 %
as long as the first in most cases (docs/theory/diagnosis.md)."""

NO_GAP, NAMED, UNKNOWN, COVER = 0.1, 0.9, 0.5, 0.9
"""Thresholds of the verdict, see above."""

WORSE = -1.0
"""Gain in ln predictive density of held-out conditions below which an effect is not named."""

CLEARLY_WORSE = -5.0
"""The same where the fitted conditions, each left out in turn, are predicted better: a patient far
from the priors can make up for an effect in all conditions, and then both predict alike."""

CLOSED_P, CLOSED_EXCESS = 0.001, 0.10
"""Closure: p-value of the misfit, or remaining share of the base excess."""

Verdict = Literal["no_gap", "named", "ambiguous", "unknown"]
Hypothesis = tuple[str, ...]
"""Effects of a hypothesis in the catalogue's order; () is no gap."""


class Judgement(NamedTuple):
    """The verdict on a record, with probabilities.

    Attributes:
        verdict: one of four.
        named: the named effects, the ambiguous set, or the nearest effect.
        probabilities: of "none", "unknown", every effect and pairs "a+b"; they sum to 1.
        inclusion: of every effect.
        cover: the smallest set of hypotheses with 90 % of the probability.
        best: the most probable hypothesis other than "unknown".
        closed: whether the best hypothesis closes the gap.
        confirmed: whether it predicts conditions that were left out no worse than no gap does.
        unlike_beats: in which ways the beats are not alike, names of `steadiness.WORDS`.
    """

    verdict: Verdict
    named: tuple[str, ...]
    probabilities: Mapping[str, float]
    inclusion: Mapping[str, float]
    cover: tuple[str, ...]
    best: Hypothesis
    closed: bool
    confirmed: bool = True
    unlike_beats: tuple[str, ...] = ()


def key_of(hypothesis: Hypothesis) -> str:
    """Name of a hypothesis in results: "none", "a", or "a+b"."""
    return "+".join(hypothesis) or "none"


def probabilities_of(
    log_evidence: Mapping[Hypothesis, float],
    forcing: Mapping[Hypothesis, np.ndarray],
    n_effects: int,
    settled: Collection[str] = (),
) -> tuple[dict[str, float], dict[Hypothesis, float]]:
    """Posterior probabilities; hypotheses that are not given have probability zero.

    Args:
        log_evidence: ln Z of none, singles and pairs.
        forcing: ln Z of every kind of free forcing beside some of these.
        n_effects: number of effects in the catalogue.
        settled: effects whose equation has no other form.

    Returns:
        Probabilities of all hypotheses by name, with "unknown" as one; and the parts of "unknown"
        by the known effects that act together with it.
    """
    each = {
        0: PRIOR["none"],
        1: PRIOR["single"] / n_effects,
        2: PRIOR["pair"] / max(n_effects * (n_effects - 1) / 2, 1),
    }
    logs, beside = {}, {}
    for h, value in log_evidence.items():
        logs[h] = np.log(each[len(h)] * (1.0 - BESIDE if h else 1.0)) + value
    for h, values in forcing.items():
        prior = each[len(h)] * BESIDE if h else PRIOR["unknown"]
        beside[h] = np.log(prior / values.size) + logsumexp(values)
    total = logsumexp([*logs.values(), *beside.values()])
    parts = {h: float(np.exp(value - total)) for h, value in beside.items()}
    found = {h: float(np.exp(value - total)) for h, value in logs.items()}
    gain = {h: value - log_evidence[()] for h, value in log_evidence.items()}
    for pair in (h for h in gain if len(h) == 2):
        first = max(((e,) for e in pair), key=lambda h: gain.get(h, -np.inf))
        moved = found[pair] * form_difference(gain.get(first, 0.0), gain[pair])
        if moved > 0.0 and first[0] not in settled:
            found[pair], found[first] = found[pair] - moved, found[first] + moved
    for h in (h for h in parts if h):
        first = max(((e,) for e in h), key=lambda e: gain.get(e, -np.inf))
        if first in gain and first[0] not in settled:
            together = logsumexp(forcing[h]) - np.log(forcing[h].size) - log_evidence[()]
            moved = parts[h] * form_difference(gain[first], float(together))
            parts[h], found[first] = parts[h] - moved, found[first] + moved
    return {**{key_of(h): p for h, p in found.items()}, "unknown": sum(parts.values())}, parts


def form_difference(alone: float, together: float) -> float:
    """Probability that what seems a second effect is a difference of forms of the first, see above.

    Args:
        alone: ln Z of the first effect above that of no gap.
        together: ln Z of both above that of no gap.
    """
    if alone <= 0.0:
        return 0.0
    return float(np.exp(-0.5 * max(together - alone, 0.0) / (FORM_ERROR**2 * alone)))


def cover_of(probabilities: Mapping[str, float]) -> tuple[str, ...]:
    """The smallest set of hypotheses with 90 % of the probability, likeliest first."""
    ranked = sorted(probabilities, key=lambda name: -probabilities[name])
    mass = np.cumsum([probabilities[name] for name in ranked])
    return tuple(ranked[: int(np.searchsorted(mass, COVER)) + 1])


def is_closed(chi2: float, base_chi2: float, n_data: int, n_fitted: int) -> bool:
    """Whether a fit closes the gap, see the table above."""
    freedom = max(n_data - n_fitted, 1)
    if chdtrc(freedom, chi2) > CLOSED_P:
        return True
    base_excess = base_chi2 - freedom
    return base_excess > 0 and chi2 - freedom < CLOSED_EXCESS * base_excess


def predicts_no_worse(held_out: float | None, left_out: float) -> bool:
    """Whether a hypothesis predicts what was left out no worse than no gap, see above.

    Args:
        held_out: gain in ln predictive density of the held-out conditions; None without any.
        left_out: the same, summed, of the fitted ones, each left out in turn.
    """
    if held_out is None:
        return left_out > 0.0
    return held_out > (CLEARLY_WORSE if left_out > 0.0 else WORSE)


def judge(
    probabilities: Mapping[str, float],
    effects: tuple[str, ...],
    misfit: Mapping[Hypothesis, float],
    n_data: int,
    n_unknowns: int,
    beside: Mapping[Hypothesis, float] | None = None,
) -> Judgement:
    """The verdict on a record.

    Args:
        probabilities: of all hypotheses.
        effects: names of the catalogue.
        misfit: χ² of the fitted hypotheses, in units of noise and form tolerance together.
        n_data: number of data.
        n_unknowns: unknowns of the base model.
        beside: parts of "unknown" by the effects that act beside it.
    """
    inclusion = dict.fromkeys(effects, 0.0)
    for name, p in probabilities.items():
        for part in name.split("+"):
            if part in inclusion:
                inclusion[part] += p
    for hypothesis, p in (beside or {}).items():
        for part in hypothesis:
            inclusion[part] += p
    best = max(misfit, key=lambda h: probabilities[key_of(h)])
    cover = cover_of(probabilities)
    closed = is_closed(misfit[best], misfit[()], n_data, n_unknowns + len(best))
    sure = tuple(e for e in effects if inclusion[e] >= NAMED)
    nearest = max(effects, key=lambda e: inclusion[e])
    if probabilities["none"] >= NO_GAP:
        verdict, named = "no_gap", ()
    elif probabilities["unknown"] >= UNKNOWN:
        verdict, named = "unknown", (nearest,)
    elif sure:
        verdict, named = ("named", sure) if closed else ("unknown", sure)
    else:
        verdict, named = "ambiguous", cover
    return Judgement(verdict, named, probabilities, inclusion, cover, best, closed)


def of_unlike_beats(judgement: Judgement, ways: tuple[str, ...]) -> Judgement:
    """The verdict once its beats are not alike: nothing is named, and no gap is not excluded."""
    if not ways:
        return judgement
    verdict, named = judgement.verdict, judgement.named
    if verdict in ("named", "no_gap"):
        nearest = max(judgement.inclusion, key=lambda e: judgement.inclusion[e])
        verdict, named = "unknown", named or (nearest,)
    return judgement._replace(verdict=verdict, named=named, unlike_beats=ways)


def unconfirmed(judgement: Judgement) -> Judgement:
    """The verdict once its best hypothesis predicts worse what was left out: nothing is named."""
    verdict = "unknown" if judgement.verdict == "named" else judgement.verdict
    return judgement._replace(verdict=verdict, confirmed=False)
