"""What a diagnosis holds and advises, as numbers: enough to take up a further reading without it.

A row keeps the probabilities, the parts of "unknown" by the effects beside it, and of every
fitted hypothesis the misfit and the Gaussian posteriors of its sizes, each with its form. The
labels are not looked at. `LEVELS` says how an advised flow is added to a record: its mean by using
more of what the record holds, its waveform from the generator's true flow Q with the diagnosis's
noise,

    Q_seen = Q + 0.05 |mean Q| (ε(t) + ε₀),     ε(t), ε₀ of unit variance.
"""

import dataclasses
import json
import pathlib
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.blind.diagnoses import records_in
from benchmarks.blind.sensors import noise
from benchmarks.blind.truth import SAMPLED
from diagnosis import Diagnosis, Record, diagnose, measured, stacked
from diagnosis.next_measurement import FLOW_ERROR, READINGS, next_measurements
from diagnosis.prediction import n_unknowns
from diagnosis.shrink import WORSE, WORSE_BY
from diagnosis.verdict import Hypothesis, key_of
from study.store.cache_folder import use_cache

FLOWS = "flow_truth.npy"
"""Flow of the cases without noise, cases × conditions × samples [mL/s]."""

MEAN_FLOW, FLOW_WAVEFORM = "mean flow in every condition", "flow waveform in every condition"
"""Sensors that `next_measurements` may advise beside `READINGS`."""

WITH_FLOW = ("waveforms, flow waveform", "means, flow waveform")
"""Records to which a flow waveform was added, with and without waveforms of pressure."""

LEVELS: dict[str, dict[str, str]] = {
    "means": {MEAN_FLOW: "means+flow", FLOW_WAVEFORM: WITH_FLOW[1]},
    "means+flow": {FLOW_WAVEFORM: WITH_FLOW[1]},
    "waveforms": {MEAN_FLOW: "waveforms+flow", FLOW_WAVEFORM: WITH_FLOW[0]},
    "waveforms+flow": {FLOW_WAVEFORM: WITH_FLOW[0]},
}
"""By richness of a record, what it becomes when a flow is added."""

CHUNK = 20
"""Records diagnosed together; what is done is stored after each chunk."""

LEAST = 1e-9
"""Probability below which a hypothesis without a fit is left out."""

Row = dict[str, Any]


def row_of(d: Diagnosis) -> Row:
    """What is kept of a diagnosis, see above."""
    j = d.judgement
    fits = {h: f for h, f in d.fits.items() if bool(f.sound) or not h}
    misses = {h: _missed(d, h) for h in fits}
    return {
        "verdict": j.verdict,
        "named": list(j.named),
        "best": key_of(j.best),
        "confirmed": j.confirmed,
        "probabilities": {
            key: p for key, p in j.probabilities.items() if p > LEAST or _hypothesis(key) in fits
        },
        "beside": {key_of(h): p for h, p in d.beside.items()},
        "misfit": {key_of(h): float(f.misfit) for h, f in fits.items()},
        "sizes": {key_of(h): _sizes(d, h) for h in fits if h},
        "worse": [key_of(h) for h, miss in misses.items() if miss > WORSE * misses[()] + WORSE_BY],
        "n_data": d.n_data,
        "n_unknowns": n_unknowns(d.record),
        "last": float(np.max(np.asarray(d.record.order))),
        "advice": [
            [option.sensor, list(option.separates), option.expected_log_bayes_factor]
            for option in next_measurements(d, len(READINGS) + 2)
        ],
    }


def _hypothesis(key: str) -> Hypothesis:
    return () if key == "none" else tuple(key.split("+"))


def _sizes(d: Diagnosis, hypothesis: Hypothesis) -> dict[str, tuple[float, float, str]]:
    """Mean and sd of the size of each effect of a hypothesis [its unit], and its form."""
    fitted, names = d.fits[hypothesis], [effect.id for effect in d.effects]
    return {
        effect.id: (float(fitted.sizes[names.index(effect.id)]), float(sd), effect.form)
        for effect, sd in zip(d.acting[hypothesis], np.asarray(fitted.size_sd), strict=False)
    }


def _missed(d: Diagnosis, hypothesis: Hypothesis) -> float:
    """Greatest RMS error of a held-out distal pressure [dyn/cm²]; zero without any."""
    record, waves = d.record, np.asarray(d.fits[hypothesis].waves)
    if record.n_sensors < 2:
        return 0.0
    seen = np.isfinite(np.asarray(record.wave_sd)[:, 1]) & (np.asarray(record.held_out) > 0.5)
    error = (waves[:, 1] - np.asarray(record.waves)[:, 1])[seen]
    return float(np.max(np.sqrt(np.mean(error**2, axis=-1)), initial=0.0))


def advised_rows(
    folder: pathlib.Path,
    noise: float,
    kind: str,
    first: int | None,
    wanted: set[int] | None = None,
) -> list[Row]:
    """Rows of the records of a folder; those that are stored there are not made again.

    Args:
        folder: of the benchmark.
        noise: of the mean beat [mmHg].
        kind: a richness, or one of `WITH_FLOW`.
        first: only so many records.
        wanted: numbers of the cases; None for all.
    """
    file = folder / f"advice-{kind.replace(', ', '-').replace(' ', '-')}-{noise:g}.json"
    rows: list[Row] = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else []
    place = folder / f"noise-{noise:g}"
    places = sorted(place.iterdir())[:first] if place.is_dir() else []
    done = {row["case"] for row in rows}
    left = [p for p in places if _number(p) not in done]
    if wanted is not None:
        left = [p for p in left if _number(p) in wanted]
    flows = folder / FLOWS
    if kind in WITH_FLOW and left and not flows.is_file():
        print(f"{folder} lacks {FLOWS}: no flow waveform can be added", file=sys.stderr)
        left = []
    for start in range(0, len(left), CHUNK):
        some = left[start : start + CHUNK]
        rows += _rows(some, kind, np.load(flows) if kind in WITH_FLOW else None)
        file.write_text(json.dumps(rows), encoding="utf-8")
        print(f"{kind}: {len(rows)} records", file=sys.stderr, flush=True)
    return [row for row in rows if first is None or row["case"] < first]


def _number(place: pathlib.Path) -> int:
    return int(place.name.split("-")[1])


def _rows(places: list[pathlib.Path], kind: str, flows: np.ndarray | None) -> list[Row]:
    use_cache()
    found = records_in(places)
    cases = [_number(place) for place in found]
    records = list(found.values())
    if flows is not None:
        pressures = kind == WITH_FLOW[0]
        records = [
            with_flow(record, flows[case], case, pressures)
            for case, record in zip(cases, records, strict=True)
        ]
    richness = kind if flows is None else "waveforms+flow"
    batch = stacked([measured(record, richness) for record in records])
    rows = [row_of(d) for d in diagnose(batch)]
    for case, row, record in zip(cases, rows, records, strict=True):
        row["case"] = case
        # cm³/s; records hold it at every level, the diagnosis uses it at some
        row["flow"] = max(float(c.mean_Q or 0.0) for c in record.conditions if not c.held_out)
    return rows


def with_flow(record: Record, flows: np.ndarray, seed: int, pressures: bool) -> Record:
    """A record with a flow waveform, see above.

    Args:
        record: without one.
        flows: true flow of its conditions, conditions × samples [mL/s].
        seed: of the noise.
        pressures: whether it keeps its waveforms of pressure.
    """
    rng = np.random.default_rng([seed, SAMPLED])
    conditions = []
    for condition, Q in zip(record.conditions, flows, strict=True):
        scale = FLOW_ERROR * abs(float(Q.mean()))
        seen = Q + noise(rng, (1, SAMPLED), scale) + scale * rng.standard_normal()
        kept: Mapping[str, np.ndarray] = condition.beats if pressures else {}
        conditions.append(dataclasses.replace(condition, beats={**kept, "Q": seen}))
    return dataclasses.replace(record, conditions=tuple(conditions))
