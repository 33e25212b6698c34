"""Diagnoses of a folder of records, without any look at labels."""

import pathlib
import sys
from collections.abc import Iterable
from typing import Any

import numpy as np
from scipy.stats import chi2 as chi2_distribution

from benchmarks.blind.sparse import strongest_term
from diagnosis import Diagnosis, Record, diagnose, measured, stacked
from diagnosis.prediction import n_unknowns
from diagnosis.shrink import expected_waves
from lumped import MMHG
from study.case.faults import CaseError
from study.case.record import read_record
from study.store.cache_folder import use_cache


def records_in(places: Iterable[pathlib.Path]) -> dict[pathlib.Path, Record]:
    """Records of some folders; one that is refused is left out, and says so on standard error."""
    found = {}
    for place in places:
        try:
            found[place], _ = read_record(place)
        except CaseError as error:
            print(f"{place.name} is refused and left out: {error}", file=sys.stderr, flush=True)
    return found


def diagnoses_of(
    places: Iterable[pathlib.Path], richness: str, *, prior_scale: float = 1.0
) -> dict[pathlib.Path, Diagnosis]:
    """Diagnoses of the records of some folders in one batch.

    Raises:
        ValueError: all of them are refused.
    """
    use_cache()
    records = records_in(places)
    if not records:
        raise ValueError("no record is left to diagnose; `make` writes some")
    batch = stacked([measured(record, richness) for record in records.values()])
    return dict(zip(records, diagnose(batch, prior_scale=prior_scale), strict=True))


def diagnose_folder(
    folder: pathlib.Path, richness: str, *, prior_scale: float = 1.0, first: int | None = None
) -> list[dict[str, Any]]:
    """One row a record: probabilities, verdict, baselines, predictions of what is held out.

    Args:
        folder: of the records.
        richness: what is used of them.
        prior_scale: factor on the prior of every size.
        first: only so many of them.
    """
    places = sorted(place for place in folder.iterdir() if (place / "record.toml").is_file())[
        :first
    ]
    return [
        {"case": int(place.name.split("-")[1]), **row_of(diagnosis)}
        for place, diagnosis in diagnoses_of(places, richness, prior_scale=prior_scale).items()
    ]


def row_of(d: Diagnosis) -> dict[str, Any]:
    """What is kept of a diagnosis, for the score."""
    j = d.judgement
    singles = {h[0]: f for h, f in d.fits.items() if len(h) == 1}
    bic = {name: float(f.cost) + np.log(d.n_data) for name, f in singles.items()}
    base = float(d.base.cost)
    best = min(bic, key=lambda name: bic[name])

    def wave(waves: Any) -> list[float]:
        return [round(float(v) / MMHG, 4) for v in np.asarray(waves)[-1, 1]]

    return {
        "verdict": j.verdict,
        "named": list(j.named),
        "probabilities": {k: v for k, v in j.probabilities.items() if v > 1e-9},
        "inclusion": dict(j.inclusion),
        "cover": list(j.cover),
        "closed": j.closed,
        "chi2": [float(d.base.chi2), float(d.best.chi2), d.n_data],
        "chi2_p": float(
            chi2_distribution.sf(float(d.base.chi2), max(d.n_data - n_unknowns(d.record), 1))
        ),
        "bic": best if bic[best] < base else "none",
        "scan": max(d.scan, key=lambda name: d.scan[name]),
        "sparse": strongest_term(d),
        "forcing_log_B": float(np.max(d.forcing)),
        "log_B": {"+".join(h): v for h, v in d.log_B.items()},
        "visibility": dict(d.visibility),
        "held_out_waves": {
            "before": wave(d.base.waves),
            "after": wave(expected_waves(d)),
            "single": {name: wave(f.waves) for name, f in singles.items()},
        },
    }
