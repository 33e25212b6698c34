"""The document of a diagnosis, `diagnosis.json`: what the report and the summary are made from."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from diagnosis import Diagnosis, Record, find_effect, noise_of
from diagnosis.circuit import PHASE
from diagnosis.measured import SENSORS
from diagnosis.next_measurement import aliases, next_measurements
from diagnosis.shrink import Shrink, expected_waves, fitted_gap, held_out_gap
from diagnosis.verdict import key_of
from diagnosis.where import (
    DRAWS,
    Map,
    forcing_shares,
    joint_map,
    place_probabilities,
    rest_map,
)
from lumped import MMHG
from study.report.diagnosis_words import sentence, size_of, to_do
from study.store.json_form import as_json
from study.store.layouts import FORMAT
from study.store.provenance import Provenance

SMALLEST_SHOWN = 1e-4
"""Probability below which a hypothesis is not listed on its own."""

Document = dict[str, Any]


def diagnosis_document(
    record: Record, remarks: Sequence[str], diagnosis: Diagnosis, provenance: Provenance
) -> Document:
    """The document of a diagnosis.

    Args:
        record: the record.
        remarks: what the record lacks, in sentences.
        diagnosis: the diagnosis.
        provenance: where the result comes from.
    """
    judgement = diagnosis.judgement
    noise = noise_of(record)
    names = [c.name for c in record.conditions]
    rest = rest_map(diagnosis.record)
    fitted, joint = fitted_gap(diagnosis), joint_map(diagnosis)
    return {
        "kind": "diagnose",
        "format": FORMAT,
        "id": record.id,
        "verdict": judgement.verdict,
        "sentence": sentence(diagnosis, joint.p_value),
        "to_do": to_do(diagnosis, names),
        "named": list(judgement.named),
        "probabilities": _listed(judgement.probabilities),
        "inclusion": {k: round(v, 6) for k, v in judgement.inclusion.items()},
        "closed": judgement.closed,
        "effects": [_effect(diagnosis, e) for e in _shown_effects(diagnosis)],
        "where": _blocks(joint, names),
        "where_after_rest_alone": None if rest is None else _blocks(rest, names),
        "place_in_model": place_probabilities(diagnosis),
        "free_forcing": forcing_shares(diagnosis),
        "unknown_beside": {key_of(h): round(p, 6) for h, p in diagnosis.beside.items()},
        "smallest_global_p": 1.0 / (DRAWS + 1),
        "gap": {
            "fitted": fitted._asdict(),
            "held_out": [
                {
                    "condition": names[h.condition],
                    "P_distal_rms_mmHg": _shrink(h.P_distal_rms, MMHG),
                    "ffr_error": _shrink(h.ffr_error, 1.0),
                }
                for h in held_out_gap(diagnosis)
            ],
        },
        "aliases": [list(pair) for pair in aliases(diagnosis)],
        "next_measurements": [
            {**option._asdict(), "separates": list(option.separates)}
            for option in next_measurements(diagnosis)
        ],
        "noise": {
            "pressure_sd_mmHg": noise.pressure_sd / MMHG,
            "offset_sd_mmHg": noise.offset_sd / MMHG,
            "white_share": noise.white_share,
            "origin": noise.origin,
        },
        "remarks": list(remarks),
        "provenance": as_json(provenance),
        "waveforms": _waveforms(record, diagnosis),
    }


def _listed(probabilities: Mapping[str, float]) -> dict[str, float]:
    """Probabilities that matter; the rest of the pairs are folded into one entry."""
    kept = {k: v for k, v in probabilities.items() if "+" not in k or v >= SMALLEST_SHOWN}
    rest = 1.0 - sum(kept.values())
    ordered = dict(sorted(kept.items(), key=lambda item: -item[1]))
    return {**ordered, "other pairs": rest} if rest > 1e-9 else ordered


def _shown_effects(diagnosis: Diagnosis) -> list[str]:
    inclusion = diagnosis.judgement.inclusion
    ranked = sorted(inclusion, key=lambda name: -inclusion[name])
    return [name for k, name in enumerate(ranked) if k < 3 or inclusion[name] > 0.02]


def _effect(diagnosis: Diagnosis, name: str) -> Document:
    effect = find_effect(diagnosis.effects, name)
    hypothesis = diagnosis.judgement.best if name in diagnosis.judgement.best else (name,)
    fitted = diagnosis.fits[hypothesis]
    place = [e.id for e in diagnosis.effects].index(name)
    size, sd = float(fitted.sizes[place]), float(fitted.size_sd[hypothesis.index(name)])
    return {
        "id": name,
        "place": effect.place,
        "size": size,
        "sd": sd,
        "unit": effect.unit,
        "equation": effect.equation,
        "sentence": f"{effect.sentence} ({size_of(effect, size, sd)})",
        "settled_by": effect.settled_by,
        "log_bayes_factor": diagnosis.log_B[(name,)],
        "score_scan": diagnosis.scan[name],
    }


def _blocks(found: Map, names: list[str]) -> list[Document]:
    return [
        {
            "condition": names[b.condition],
            "site": b.sensor,
            "phase": b.part,
            "excess": round(b.excess, 4),
            "z": round(b.z, 3),
            "global_p": found.p_value,
        }
        for b in found.blocks
    ]


def _shrink(value: Shrink | None, unit: float) -> Document | None:
    if value is None:
        return None
    return {name: part / unit for name, part in value._asdict().items()}


def _waveforms(record: Record, diagnosis: Diagnosis) -> list[Document]:
    """Traces of each condition [mmHg, mL/s]: measured, base model, after the diagnosis."""
    expected = expected_waves(diagnosis)
    found = []
    for c, condition in enumerate(record.conditions):
        traces = {}
        for s, name in enumerate(SENSORS):
            has = s < diagnosis.record.n_sensors and np.isfinite(
                float(diagnosis.record.wave_sd[c, s])
            )
            unit = 1.0 if name == "Q" else MMHG
            traces[name] = {
                "measured": _rounded(diagnosis.record.waves[c, s] / unit) if has else None,
                "before": _rounded(np.asarray(diagnosis.base.waves)[c, s] / unit),
                "after": _rounded(expected[c, s] / unit),
            }
        found.append(
            {
                "condition": condition.name,
                "held_out": condition.held_out,
                "t_s": [round(float(t), 6) for t in PHASE * condition.period],
                "traces": traces,
            }
        )
    return found


def _rounded(wave: Any) -> list[float]:
    return [round(float(v), 4) for v in np.asarray(wave)]
