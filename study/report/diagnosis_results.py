"""The document of a diagnosis, `diagnosis.json`: what the report and the summary are made from."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from diagnosis import Diagnosis, Record, find_effect, noise_of
from diagnosis.measured import SENSORS
from diagnosis.next_measurement import Next, aliases, next_measurements, usual_visibility
from diagnosis.shrink import expected_waves, fitted_gap, held_out_gap
from diagnosis.spectra import PHASE
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
from study.report.documents.diagnose import (
    BeforeAfter,
    DataBlock,
    DiagnoseDocument,
    EffectEntry,
    Gap,
    HeldOutGap,
    NoiseLevel,
    PredictedGain,
    RecordWaveforms,
    TraceModels,
)
from study.report.documents.parts import NextMeasurement
from study.store.json_form import ABSENT, Absent
from study.store.layouts import FORMAT
from study.store.provenance import Provenance

SMALLEST_SHOWN = 1e-4
"""Probability below which a hypothesis is not listed on its own."""


def diagnosis_document(
    record: Record, remarks: Sequence[str], diagnosis: Diagnosis, provenance: Provenance
) -> DiagnoseDocument:
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
    joint = joint_map(diagnosis)
    return DiagnoseDocument(
        kind="diagnose",
        format=FORMAT,
        id=record.id,
        verdict=judgement.verdict,
        sentence=sentence(diagnosis, joint.p_value),
        to_do=to_do(diagnosis, names),
        named=list(judgement.named),
        probabilities=_listed(judgement.probabilities),
        inclusion={k: round(v, 6) for k, v in judgement.inclusion.items()},
        closed=judgement.closed,
        other_bed=_other_bed(diagnosis),
        effects=[_effect(diagnosis, e) for e in _shown_effects(diagnosis)],
        where=_blocks(joint, names),
        where_after_rest_alone=None if rest is None else _blocks(rest, names),
        place_in_model=place_probabilities(diagnosis),
        free_forcing=forcing_shares(diagnosis),
        unknown_beside={key_of(h): round(p, 6) for h, p in diagnosis.beside.items()},
        smallest_global_p=1.0 / (DRAWS + 1),
        gap=Gap(BeforeAfter(*fitted_gap(diagnosis)), list(_held_out(diagnosis, names))),
        predicted=_predicted(diagnosis, names),
        aliases=[list(pair) for pair in aliases(diagnosis)],
        next_measurements=measurements(next_measurements(diagnosis)),
        noise=NoiseLevel(
            pressure_sd_mmHg=noise.pressure_sd / MMHG,
            offset_sd_mmHg=noise.offset_sd / MMHG,
            white_share=noise.white_share,
            origin=noise.origin,
        ),
        remarks=list(remarks),
        provenance=provenance,
        waveforms=_waveforms(record, diagnosis),
    )


def measurements(found: Sequence[Next]) -> list[NextMeasurement]:
    """Recommended measurements as documents hold them."""
    return [
        NextMeasurement(option.sensor, list(option.separates), option.expected_log_bayes_factor)
        for option in found
    ]


def _held_out(diagnosis: Diagnosis, names: list[str]) -> Iterator[HeldOutGap]:
    for held in held_out_gap(diagnosis):
        rms, ratio = held.P_distal_rms, held.ffr_error
        yield HeldOutGap(
            condition=names[held.condition],
            P_distal_rms_mmHg=None if rms is None else BeforeAfter(*(v / MMHG for v in rms)),
            ffr_error=None if ratio is None else BeforeAfter(*ratio),
        )


def _other_bed(diagnosis: Diagnosis) -> float | Absent:
    return round(diagnosis.other_bed, 4) if diagnosis.record.n_sensors else ABSENT


def _predicted(diagnosis: Diagnosis, names: list[str]) -> PredictedGain | Absent:
    if diagnosis.predicted is None:
        return ABSENT
    hidden = np.asarray(diagnosis.record.held_out) > 0.5
    gains = np.asarray(diagnosis.predicted.left_out)
    return PredictedGain(
        held_out=round(float(diagnosis.predicted.held_out), 3) if hidden.any() else None,
        left_out={
            name: round(float(gain), 3)
            for name, gain, held in zip(names, gains, hidden, strict=True)
            if not held
        },
        confirmed=diagnosis.judgement.confirmed,
    )


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


def _effect(diagnosis: Diagnosis, name: str) -> EffectEntry:
    hypothesis = diagnosis.judgement.best if name in diagnosis.judgement.best else (name,)
    effect = find_effect(diagnosis.acting[hypothesis], name)
    fitted = diagnosis.fits[hypothesis]
    place = [e.id for e in diagnosis.effects].index(name)
    size, sd = float(fitted.sizes[place]), float(fitted.size_sd[hypothesis.index(name)])
    return EffectEntry(
        id=name,
        place=effect.place,
        size=size,
        sd=sd,
        unit=effect.unit,
        equation=effect.equation,
        sentence=f"{effect.sentence} ({size_of(effect, size, sd)})",
        settled_by=effect.settled_by,
        log_bayes_factor=diagnosis.log_B[(name,)],
        score_scan=float(diagnosis.scan[name]),
        forms={form or "first": round(p, 4) for form, p in diagnosis.forms[name].items()}
        if name in diagnosis.forms
        else ABSENT,
        visibility=round(usual_visibility(diagnosis, name), 3),
    )


def _blocks(found: Map, names: list[str]) -> list[DataBlock]:
    return [
        DataBlock(
            condition=names[b.condition],
            site=b.sensor,
            phase=b.part,
            excess=round(b.excess, 4),
            z=round(b.z, 3),
            global_p=found.p_value,
        )
        for b in found.blocks
    ]


def _waveforms(record: Record, diagnosis: Diagnosis) -> list[RecordWaveforms]:
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
            traces[name] = TraceModels(
                measured=_rounded(diagnosis.record.waves[c, s] / unit) if has else None,
                before=_rounded(np.asarray(diagnosis.base.waves)[c, s] / unit),
                after=_rounded(expected[c, s] / unit),
            )
        found.append(
            RecordWaveforms(
                condition=condition.name,
                held_out=condition.held_out,
                t_s=[round(float(t), 6) for t in PHASE * condition.period],
                traces=traces,
            )
        )
    return found


def _rounded(wave: Any) -> list[float]:
    return [round(float(v), 4) for v in np.asarray(wave)]
