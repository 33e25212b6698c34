"""Answers of this project to a foreign set: one entry a record, in the form that any method gives.

An answer says for each record

    {"verdict": "no_gap" | "named" | "ambiguous" | "unknown", "named": [ids],
     "probabilities": {"none": p, "unknown": p, id: p, "id+id": p},
     "held_out_rms_mmHg": [before, after]}                           # the last entry may be absent

and is scored by `benchmarks.foreign.score` alone. Two baselines answer beside the diagnosis, from
the same fits: `bic` names the single effect with the least Bayesian information criterion, `scan`
the one with the largest score, where each beats the model without an effect.
"""

import json
import pathlib
import sys
from typing import Any

import numpy as np

from benchmarks.foreign.plain import in_batches
from diagnosis import Diagnosis, diagnose
from diagnosis.shrink import held_out_gap
from lumped import MMHG
from lumped.whole_files import write_whole
from study.store.cache_folder import use_cache

Answers = dict[str, dict[str, Any]]


def answer(folder: pathlib.Path, records: int | None = None) -> None:
    """Diagnose a set and write `answers-diagnosis.json`, `answers-bic.json`, `answers-scan.json`.

    Answers that are there already are kept.

    Args:
        folder: a set, see `benchmarks.foreign.make`.
        records: only so many of them.
    """
    use_cache()
    found = {name: earlier(folder, name) for name in ("diagnosis", "bic", "scan")}
    places = sorted((folder / "records").iterdir())[:records]
    left = [place for place in places if place.name not in found["diagnosis"]]
    done = len(places) - len(left)
    for at, _, batch in in_batches(left):
        for place, d in zip(at, diagnose(batch), strict=True):
            for name, entry in _entries(d).items():
                found[name][place.name] = entry
        done += len(at)
        for name, answers in found.items():
            keep(folder, name, answers)
        print(f"{done} of {len(places)}", file=sys.stderr, flush=True)


def earlier(folder: pathlib.Path, name: str) -> Answers:
    """The answers of a method that a set holds already."""
    file = folder / f"answers-{name}.json"
    return json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}


def keep(folder: pathlib.Path, name: str, answers: Answers) -> None:
    """Write the answers of a method beside the labels of a set."""
    write_whole(folder / f"answers-{name}.json", json.dumps(answers, indent=0) + "\n")


def _entries(d: Diagnosis) -> dict[str, dict[str, Any]]:
    """The entries of the diagnosis and of both baselines for one record."""
    j = d.judgement
    held = [h.P_distal_rms for h in held_out_gap(d) if h.P_distal_rms is not None]
    own: dict[str, Any] = {
        "verdict": j.verdict,
        "named": list(j.named),
        "probabilities": {k: round(v, 5) for k, v in j.probabilities.items() if v > 5e-6},
        "beside": {"+".join(h): round(p, 5) for h, p in d.beside.items() if h},
        "visibility": {k: round(v, 5) for k, v in d.visibility.items()},
        "forms": {
            effect.id: effect.form or "first" for effect in d.acting[j.best] if effect.forms == ()
        },
        "confirmed": j.confirmed,
    }
    if held:
        own["held_out_rms_mmHg"] = [held[-1].before / MMHG, held[-1].after / MMHG]
    single = {h[0]: float(f.cost) for h, f in d.fits.items() if len(h) == 1}
    least = min(single, key=lambda name: single[name])
    bic = single[least] + np.log(d.n_data) < float(d.base.cost)
    best = max(d.scan, key=lambda name: d.scan[name])
    return {
        "diagnosis": own,
        "bic": _named(least if bic else None),
        "scan": _named(best if d.scan[best] > 0.0 else None),
    }


def _named(effect: str | None) -> dict[str, Any]:
    """An answer that names one effect, or none, for certain."""
    if effect is None:
        return {"verdict": "no_gap", "named": [], "probabilities": {"none": 1.0}}
    return {"verdict": "named", "named": [effect], "probabilities": {effect: 1.0}}
