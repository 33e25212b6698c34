"""Pooled evidence of several patients with sparse records.

If one cause acts in all of them, evidences multiply: ln B of an effect is the sum over patients,
each with its own size. The hypotheses are no gap and one common effect; the prior is
that of a single record without pairs and unknown.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from diagnosis.result import Diagnosis
from diagnosis.verdict import NAMED, NO_GAP, PRIOR


class Pooled(NamedTuple):
    """Verdict on a cohort.

    Attributes:
        verdict: "no_gap", "named" or "ambiguous".
        named: the common effect, or the smallest set with 90 % of the probability.
        probabilities: of "none" and of every effect as the common cause.
        log_B: pooled ln B of every effect.
        patients: number of patients.
    """

    verdict: str
    named: tuple[str, ...]
    probabilities: dict[str, float]
    log_B: dict[str, float]
    patients: int


def pool(diagnoses: Sequence[Diagnosis]) -> Pooled:
    """Pool the evidence of patients diagnosed with one catalogue.

    Raises:
        ValueError: no patient, or different catalogues.
    """
    if not diagnoses:
        raise ValueError("A cohort needs at least one diagnosis. Give the records of its patients.")
    names = [effect.id for effect in diagnoses[0].effects]
    if any([e.id for e in d.effects] != names for d in diagnoses):
        raise ValueError("The diagnoses used different effects. Diagnose all with one catalogue.")
    log_B = {n: float(sum(d.log_B[(n,)] for d in diagnoses)) for n in names}
    logs = {"none": np.log(PRIOR["none"])}
    logs |= {n: np.log(PRIOR["single"] / len(names)) + v for n, v in log_B.items()}
    total = logsumexp(list(logs.values()))
    probabilities = {n: float(np.exp(v - total)) for n, v in logs.items()}
    ranked = sorted(probabilities, key=lambda n: -probabilities[n])
    mass = np.cumsum([probabilities[n] for n in ranked])
    if probabilities["none"] >= NO_GAP:
        verdict, named = "no_gap", ()
    elif probabilities[ranked[0]] >= NAMED:
        verdict, named = "named", (ranked[0],)
    else:
        verdict, named = "ambiguous", tuple(ranked[: int(np.searchsorted(mass, 0.9)) + 1])
    return Pooled(verdict, named, probabilities, log_B, len(diagnoses))
