"""Writes imported conditions as a record, and as conditions of a case file.

The CSV file of a condition holds the samples of its used beats one after the other, from the onset
of ejection at 0 s; the beats between them are left out, and later times follow on. Nothing is
resampled: the reader averages the beats itself and estimates noise from their scatter. A case file
takes one mean beat at uniform phases.
"""

import datetime
import hashlib
import json
from collections.abc import Sequence

import numpy as np

from study.case.catheter.beat_means import ImportedCondition
from study.case.catheter.drift import LEAST_DRIFT, WireDrift
from study.case.record_beats import MOST_BEATS, MOST_SAMPLES
from study.case.template import RECORD_FILE

CONDITIONS_FILE = "conditions.toml"
"""Conditions of a case file."""

_COLUMNS = {
    "P_aorta": "P_aorta_mmHg",
    "P_distal": "P_distal_mmHg",
    "Q_coronary": "Q_coronary_ml_per_min",
}
_MOST_BEATS = MOST_BEATS - 10
_MOST_SAMPLES = int(0.95 * MOST_SAMPLES)
_FEWEST_PHASES, _MOST_PHASES = 40, 200


def record_texts(
    patient: str,
    conditions: Sequence[ImportedCondition],
    drift: WireDrift | None,
    made: datetime.date | None = None,
) -> dict[str, str]:
    """Files of a record and of conditions of a case, `record.toml` last.

    Args:
        patient: name of the patient.
        conditions: in the order of measurement.
        drift: of the wire, where known.
        made: date of the import, for the file; None: not said.
    """
    files: dict[str, str] = {}
    for c in conditions:
        files[f"{c.name}.csv"] = used_beats_csv(c)
        files[f"{c.name}_beat.csv"] = mean_beat_csv(c)
    files[CONDITIONS_FILE] = _conditions(conditions)
    return {**files, RECORD_FILE: _record(patient, conditions, drift, made)}


def used_beats_csv(c: ImportedCondition) -> str:
    """The samples of the used beats, from the onset of ejection at 0 s."""
    rows: list[np.ndarray] = []
    end, last, count = 0.0, -np.inf, 0
    names = [name for name in _COLUMNS if name in c.trace.waves]
    table = np.stack([c.trace.waves[name] for name in names], axis=1)
    for k in c.beats.used[:_MOST_BEATS]:
        onset, length = c.beats.onset[k], c.beats.length[k]
        inside = np.flatnonzero((c.trace.t >= onset) & (c.trace.t < onset + length))
        if count + inside.size > _MOST_SAMPLES:
            break
        t = c.trace.t[inside] - onset + end
        kept = t > last + 0.2 * c.trace.step
        rows.append(np.column_stack([t[kept], table[inside[kept]]]))
        end, last, count = end + length, float(t[-1]), count + inside.size
    found = np.concatenate(rows)
    found[:, 0] -= found[0, 0]
    return _csv([_COLUMNS[name] for name in names], found)


def mean_beat_csv(c: ImportedCondition) -> str:
    """The mean beat at uniform times, from the onset of ejection at 0 s, over one period."""
    rate = round(c.means.period / c.trace.step)
    n = int(np.clip(rate, _FEWEST_PHASES, _MOST_PHASES))
    wave = c.means.mean_beat["P_aorta"]
    known = (np.arange(wave.size) + 0.5) / wave.size
    beat = np.interp(np.arange(n) / n, known, wave, period=1.0)
    period = float(f"{c.means.period:.4f}")
    return _csv([_COLUMNS["P_aorta"]], np.column_stack([np.arange(n) / n * period, beat]))


def _csv(names: Sequence[str], rows: np.ndarray) -> str:
    lines = [",".join(["time_s", *names])]
    lines += [",".join([f"{row[0]:.6f}", *(f"{v:.7g}" for v in row[1:])]) for row in rows]
    return "\n".join(lines) + "\n"


def source_of(c: ImportedCondition) -> str:
    """Where the numbers of a condition come from: its file with a digest."""
    digest = hashlib.sha256(c.trace.path.read_bytes()).hexdigest()[:12]
    return f"{c.trace.path.name} (sha256 {digest})"


def _record(
    patient: str,
    conditions: Sequence[ImportedCondition],
    drift: WireDrift | None,
    made: datetime.date | None,
) -> str:
    lines = ["[patient]", f"id = {json.dumps(patient, ensure_ascii=False)}"]
    if made is not None:
        lines.append(f'notes = "imported {made.isoformat()} by jaxfsi import-record"')
    lines += [
        "",
        "[noise]  # of the mean beat: diagnose estimates it from the scatter of the beats",
    ]
    for c in conditions:
        n = np.sqrt(c.beats.used.size)
        said = ", ".join(
            f"{s / n:.2f} {name}" for name, s in c.means.noise.items() if name[0] == "P"
        )
        lines.append(f"# {c.name}: samples of the mean beat scatter by {said} [mmHg]")
    if drift is not None and abs(drift.size) > LEAST_DRIFT:
        lines.append(f"pressure_offset_sd_mmHg = {abs(drift.size):.2f}  # {drift.origin}")
    for order, c in enumerate(conditions):
        m = c.means
        lines += ["", f"[condition.{c.name}]", *_told(c), f'drug = "{c.drug}"', f"order = {order}"]
        lines += _pressures(c)
        lines += [
            f"mean_P_aorta_mmHg = {m.mean_P_aorta:.2f}",
            f"mean_P_distal_mmHg = {m.mean_P_distal:.2f}",
            f"ffr = {m.ratio:.4f}",
        ]
        if m.mean_Q is not None:
            lines.append(f"mean_flow_ml_per_min = {m.mean_Q:.1f}")
        lines.append(f'waveform = "{c.name}.csv"')
    return "\n".join(lines) + "\n"


def _conditions(conditions: Sequence[ImportedCondition]) -> str:
    lines = [
        "# Conditions for a case file: copy these tables into case.toml and the files *_beat.csv",
        "# beside it. Add the cardiac output of each where it was measured.",
    ]
    for c in conditions:
        lines += ["", f"[condition.{c.name}]", *_told(c)]
        if c.drug != "none" and c.name != c.drug:
            lines.append(f'drug = "{c.drug}"')
        lines += [*_pressures(c), "#cardiac_output_l_per_min = 4.5   # example"]
        above = "" if c.means.ratio < 1.0 else "#"
        why = "" if c.means.ratio < 1.0 else "   # at 1 or above there is no loss to calibrate"
        lines.append(f"{above}ffr = {c.means.ratio:.4f}{why}")
        lines.append(f'waveform = "{c.name}_beat.csv"')
    return "\n".join(lines) + "\n"


def _told(c: ImportedCondition) -> list[str]:
    """Source and remarks of a condition, as texts of its table."""
    notes = " ".join(c.remarks())
    notes += f" Distal upstroke {1e3 * c.means.delay:+.0f} ms after the aortic one."
    texts = {"source": source_of(c), "notes": notes}
    return [f"{key} = {json.dumps(text, ensure_ascii=False)}" for key, text in texts.items()]


def _pressures(c: ImportedCondition) -> list[str]:
    m = c.means
    return [
        f"period_s = {m.period:.4f}",
        f"P_systolic_mmHg = {m.P_systolic:.2f}",
        f"P_diastolic_mmHg = {m.P_diastolic:.2f}",
    ]
