"""Whether 90 % intervals of FFR cover, and chances of FFR ≤ 0.80 are what they say.

Virtual patients of another hand (`benchmarks.independent_patients`): another 0D model, other
waveforms, a bed that is squeezed, reserve that is partly used up, slits that narrow in systole, and
measurements with drift, height and imaging errors, all drawn from the literature without knowledge
of the defaults that are tested here (`calibration.patient_inputs`, `calibration.stress_evidence`).
A third of them have a measured flow reserve, which narrows their interval.

Brier score: mean of (chance − outcome)²; for a point estimate the chance is 0 or 1.
"""

import itertools
import time
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from benchmarks.independent_patients import patients
from calibration import (
    Evidence,
    MeasurementErrors,
    StressRatio,
    Uncertainty,
    patient_inputs,
    stress_evidence,
)
from lumped import Surrogate, condition_from_clinic, nominal_coronary, stress_rule
from lumped.nominal import RESERVE_ERROR
from study.run.ratio_uncertainty import ratio_uncertainty

SEED = 20261126
N_PATIENTS = 200
N_SAMPLES = 2**12
COVERS = (0.86, 0.94)
LIMIT = 0.80
REST_RATIO_ERROR = 0.014
"""Standard deviation of a resting ratio, as of one of two readings that differ by 0.02."""

IM_FACTOR = {"left": 1.0, "right": 0.5}


class Prediction(NamedTuple):
    """One patient: what was predicted, and what is true."""

    patient: Mapping[str, Any]
    found: Uncertainty
    point: Mapping[str, float]
    seconds: float

    @property
    def truth(self) -> float:
        """True FFR."""
        return self.patient["truth"]["ffr"]

    def covered(self, level: float) -> bool:
        """Whether the interval holds the truth."""
        low, high = self.found.interval(level)
        return low <= self.truth <= high


def run(rounds: int = 1) -> dict[str, Any]:
    """Predict every patient once.

    Args:
        rounds: not used: nothing is timed twice.

    Returns:
        {"name", "rows", "notes", "passed"}, ready for JSON.
    """
    del rounds
    outcomes = [predicted(patient) for patient in patients(N_PATIENTS, SEED)]
    rows = [_row("all", outcomes)]
    for key in ("drug", "age_group", "side"):
        for value in sorted({o.patient[key] for o in outcomes}):
            rows.append(_row(value, [o for o in outcomes if o.patient[key] == value]))
    for known in (True, False):
        part = [o for o in outcomes if (o.patient["measured"]["cfr"] is not None) == known]
        rows.append(_row("reserve measured" if known else "no reserve measured", part))
    low, high = COVERS
    return {
        "name": "coverage",
        "rows": rows,
        "notes": [
            f"Reliability: {_reliability(outcomes)}.",
            f"Brier score of point estimates: {_point_scores(outcomes)}.",
            f"Median time of a patient, {N_SAMPLES} samples, after compilation:"
            f" {np.median([o.seconds for o in outcomes]):.2f} s.",
        ],
        "passed": low <= rows[0]["covers_90"] <= high,
    }


def predicted(patient: Mapping[str, Any], *, n_samples: int = N_SAMPLES) -> Prediction:
    """FFR of a patient with its uncertainty, from what was measured alone."""
    seen = patient["measured"]
    model = patient_model(patient)
    errors = MeasurementErrors(rest_ratio=REST_RATIO_ERROR)
    evidence = stress_evidence(patient["drug"], patient["age_group"])
    start = time.perf_counter()
    reserve = seen["cfr"]
    measured = []
    if reserve is not None:
        measured = [Evidence(model.reserve, reserve, RESERVE_ERROR * reserve)]
    inputs = patient_inputs(model, evidence, errors)
    found = ratio_uncertainty(model, inputs, measured, n_samples=n_samples)
    seconds = time.perf_counter() - start
    point = {}
    for name in ("printed", "all"):
        other = patient_model(patient, name)
        point[name] = float(other.ffr({}))
    return Prediction(patient, found, point, seconds)


def patient_model(patient: Mapping[str, Any], rule: str = "all") -> StressRatio:
    """A patient as seen by the measurements, with a stress rule."""
    seen = patient["measured"]
    bed = nominal_coronary(im_factor=IM_FACTOR[patient["side"]])
    artery = Surrogate(R0=seen["R0_dyn_s_per_cm5"], K=seen["K_dyn_s2_per_cm8"], coronary=bed)
    rest, stress = (condition_from_clinic(**seen[name]) for name in ("rest", "stress"))
    ratio = min(seen["rest_ratio"], 0.995)
    return StressRatio(artery, rest, stress, stress_rule(rule), ratio)


def _row(name: str, outcomes: Sequence[Prediction]) -> dict[str, Any]:
    widths = [high - low for low, high in (o.found.interval() for o in outcomes)]
    medians = np.array([o.found.median for o in outcomes])
    truth = np.array([o.truth for o in outcomes])
    return {
        "who": name,
        "patients": len(outcomes),
        "covers_50": float(np.mean([o.covered(0.5) for o in outcomes])),
        "covers_80": float(np.mean([o.covered(0.8) for o in outcomes])),
        "covers_90": float(np.mean([o.covered(0.9) for o in outcomes])),
        "covers_95": float(np.mean([o.covered(0.95) for o in outcomes])),
        "mean_width_90": float(np.mean(widths)),
        "bias": float(np.mean(medians - truth)),
        "rmse": float(np.sqrt(np.mean((medians - truth) ** 2))),
        "brier": _brier([o.found.chance(LIMIT) for o in outcomes], truth),
    }


def _brier(chances: Sequence[float], truth: np.ndarray) -> float:
    return float(np.mean((np.asarray(chances) - (truth <= LIMIT)) ** 2))


def _point_scores(outcomes: Sequence[Prediction]) -> str:
    truth = np.array([o.truth for o in outcomes])
    share = float(np.mean(truth <= LIMIT))
    scores = {
        f"rule {n}": [float(o.point[n] <= LIMIT) for o in outcomes] for n in outcomes[0].point
    }
    scores["share of the cohort for everybody"] = [share] * len(outcomes)
    return ", ".join(f"{name} {_brier(c, truth):.3f}" for name, c in scores.items())


def _reliability(outcomes: Sequence[Prediction]) -> str:
    """Predicted chances in five bins beside how often FFR is at or below the limit."""
    chance = np.array([o.found.chance(LIMIT) for o in outcomes])
    low = np.array([o.truth <= LIMIT for o in outcomes])
    edges = [0.0, 0.05, 0.2, 0.4, 0.7, 1.0]
    parts = []
    for i, (start, end) in enumerate(itertools.pairwise(edges)):
        inside = (chance >= start) & ((chance < end) | (i == len(edges) - 2))
        if np.any(inside):
            parts.append(
                f"said {np.mean(chance[inside]):.2f}, was {np.mean(low[inside]):.2f}"
                f" ({np.sum(inside)} patients)"
            )
    return "; ".join(parts)
