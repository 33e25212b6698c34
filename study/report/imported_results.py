"""What `import-record` found, for the terminal and as JSON."""

from collections.abc import Mapping
from typing import Any

from study.case.catheter.beat_means import ImportedCondition
from study.case.catheter.exports import Exports


def import_document(found: Exports) -> Mapping[str, Any]:
    """Conditions with their beats, remarks, and the drift of the wire."""
    drift = None
    if found.drift is not None:
        last = found.conditions[-1].means
        drift = {
            "size_mmHg": found.drift.size,
            "origin": found.drift.origin,
            "sentence": found.drift.sentence(last.ratio, last.mean_P_aorta),
        }
    return {
        "kind": "import",
        "id": found.patient,
        "conditions": [_condition(c) for c in (*found.conditions, *found.checks)],
        "drift": drift,
    }


def _condition(c: ImportedCondition) -> dict[str, Any]:
    means = c.means
    return {
        "name": c.name,
        "file": str(c.trace.path),
        "beats_found": len(c.beats.reason),
        "beats_used": len(c.beats.used),
        "left_out": [
            {"start_s": float(c.beats.onset[k]), "reason": why}
            for k, why in enumerate(c.beats.reason)
            if why
        ],
        "period_s": means.period,
        "P_systolic_mmHg": means.P_systolic,
        "P_diastolic_mmHg": means.P_diastolic,
        "mean_P_aorta_mmHg": means.mean_P_aorta,
        "mean_P_distal_mmHg": means.mean_P_distal,
        "mean_flow_ml_per_min": means.mean_Q,
        "ratio": means.ratio,
        "ratio_sd": means.ratio_sd,
        "sample_sd_mmHg": {n: sd for n, sd in means.noise.items() if n.startswith("P")},
        "delay_s": means.delay,
        "remarks": c.remarks(),
    }
