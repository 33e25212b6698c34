"""Measured records: a folder with `record.toml` and a CSV file a condition with waveforms."""

import dataclasses
import pathlib
from collections.abc import Mapping
from typing import Any

import numpy as np

import diagnosis
from lumped.units import ML_PER_MIN, MMHG
from study.case.combinations import check_recorded
from study.case.faults import CaseError
from study.case.record_beats import read_beats
from study.case.record_tables import homes, old_spelling, read_record_tables
from study.case.schema import FREE_TEXT
from study.case.table_reader import Context
from study.case.template import RECORD_FILE
from study.case.toml_file import read_document

OLDER = "The record is written in an older spelling"
"""How the remark begins that says how it is spelt now."""

MEAN_SLIP = 0.15
"""Relative difference between a stated mean and that of the trace beyond which one is wrong."""


_CLINICAL = (
    "P_systolic", "P_diastolic", "mean_P_aorta", "mean_P_distal", "pressure_sd",
    "pressure_offset_sd", "R0", "K", "L",
)  # fmt: skip
"""Values that are read in mmHg, mL and s."""


def record_path(path: pathlib.Path) -> pathlib.Path:
    """The record's file, whether it or its folder was named."""
    return path / RECORD_FILE if path.is_dir() else path


def read_record(
    path: pathlib.Path, *, needs_data: bool = True
) -> tuple["diagnosis.Record", tuple[str, ...]]:
    """Read a record and its waveforms.

    Args:
        path: the folder, or its `record.toml`.
        needs_data: whether a record without any measurement is refused.

    Returns:
        The record, and remarks about what it lacks, in sentences.

    Raises:
        CaseError: the record holds faults; all of them are listed.
    """
    file = record_path(path)
    document = read_document(file)
    context = Context(file, [], {key: {} for key in FREE_TEXT}, homes())
    values = read_record_tables(document, context)
    found = [_condition(entry, context) for entry in values["condition"]]
    if context.faults:  # before `diagnosis` is used, which takes seconds to import
        raise CaseError(context.faults)
    conditions = [diagnosis.RecordedCondition(**_in_cgs(parts)) for parts in found if parts]
    if needs_data and not any(_has_data(c) for c in conditions if not c.held_out):
        cure = "give ffr, mean pressures or a file with waveforms for at least one condition"
        context.add("condition", None, "no condition holds anything to compare with", cure)
        raise CaseError(context.faults)
    noise = values["noise"]
    record = diagnosis.Record(
        id=values["id"],
        conditions=tuple(conditions),
        **_in_cgs(noise),
        **_in_cgs(values["prior"]),
    )
    return record, (*_remarks(record), *_spelling(document))


def _in_cgs(parts: Mapping[str, Any]) -> dict[str, Any]:
    """Parts of a record with their pressures, resistances and losses in CGS, read in mmHg."""
    found = dict(parts)
    for name in _CLINICAL:
        if found.get(name) is not None:
            found[name] *= MMHG
    if "beats" in found:
        found["beats"] = {
            name: wave if name == "Q" else wave * MMHG for name, wave in found["beats"].items()
        }
    return found


def _spelling(document: dict[str, Any]) -> tuple[str, ...]:
    old = old_spelling(document)
    if not old:
        return ()
    return (
        f"{OLDER}, which is still read. As in a case file, write {'; '.join(old)} "
        "(jaxfsi template --record shows it).",
    )


def _condition(entry: Mapping[str, Any], context: Context) -> dict[str, Any] | None:
    """Parts of a condition; None where one that it needs is missing."""
    values = {
        name: value
        for name, value in entry.items()
        if name not in ("waveform", "heading", "traces")
    }
    beats: Mapping[str, np.ndarray] = {}
    folding = None
    key = entry["traces"]
    period, peak = values["period"], values["P_systolic"]
    if entry["waveform"] is not None and period is not None and peak is not None:
        folded = read_beats(entry["waveform"], period, peak, key, context.faults)
        if folded is not None:
            beats, folding, values["period"] = folded.beats, folded.folding, folded.period
        _check_means(values, beats, entry["heading"], key, context)
    check_recorded(values, beats, entry["heading"], key, context)
    needed = ("name", "drug", "period", "P_systolic", "P_diastolic")
    if any(values[name] is None for name in needed):
        return None
    return {**values, "beats": beats, "folding": folding}


def _check_means(
    values: Mapping[str, Any],
    beats: Mapping[str, np.ndarray],
    heading: str,
    traces: str,
    context: Context,
) -> None:
    stated = {
        "mean_P_aorta_mmHg": ("P_aorta", values["mean_P_aorta"], 1.0),
        "mean_P_distal_mmHg": ("P_distal", values["mean_P_distal"], 1.0),
        "mean_flow_ml_per_min": ("Q", values["mean_Q"], ML_PER_MIN),
    }
    high, low = values["mean_P_aorta"], values["mean_P_distal"]
    if high is not None and low is not None and "P_distal" in beats:
        P = [float(beats[name].mean()) for name in ("P_aorta", "P_distal")]
        straight, crossed = abs(P[0] - high) + abs(P[1] - low), abs(P[1] - high) + abs(P[0] - low)
        if straight > 2.0 and crossed < 0.3 * straight:
            cure = "swap the columns P_aorta_mmHg and P_distal_mmHg of the file"
            context.add(traces, None, "the traces' means are exchanged", cure)
    for key, (sensor, value, unit) in stated.items():
        if value is None or sensor not in beats:
            continue
        mean = float(beats[sensor].mean())
        limit = 2.0 * MEAN_SLIP if sensor == "Q" else MEAN_SLIP
        if abs(mean - value) > limit * abs(value):
            cure = f"the trace's mean is {mean / unit:.4g}; correct the unit, the sign or the value"
            context.add(f"{heading}.{key}", value / unit, "far from the mean of the trace", cure)


def _has_data(c: "diagnosis.RecordedCondition") -> bool:
    return bool(c.beats) or c.ffr is not None or c.mean_P_distal is not None


def _remarks(record: "diagnosis.Record") -> tuple[str, ...]:
    used = [c for c in record.conditions if not c.held_out and _has_data(c)]
    remarks = []
    if not any(c.drug == "none" for c in used):
        remarks.append(
            "There is no measurement at rest: effects that act under stress alone cannot be told "
            "from those that always act."
        )
    if not any(c.drug != "none" for c in used):
        remarks.append(
            "There is no measurement under stress: only effects that show at rest can be found."
        )
    poor = [c.name for c in used if "P_distal" not in c.beats]
    if poor:
        remarks.append(
            f"No distal waveform in {', '.join(poor)}: means and ratios alone seldom tell one "
            "cause from another."
        )
    return tuple(remarks)


def record_files(record: "diagnosis.Record") -> dict[str, str]:
    """The files of a record as text by name, `record.toml` last; what `read_record` reads."""
    files: dict[str, str] = {}
    lines = ["[patient]", f'id = "{record.id}"']
    stated = {
        "pressure_sd_mmHg": _clinical(record.pressure_sd),
        "pressure_offset_sd_mmHg": _clinical(record.pressure_offset_sd),
        "flow_relative_sd": record.flow_relative_sd,
        "ffr_sd": record.ffr_sd,
    }
    if any(value is not None for value in stated.values()):
        lines += ["", "[noise]"]
        lines += [f"{key} = {value:.10g}" for key, value in stated.items() if value is not None]
    prior = f"{{ value = {record.R0 / MMHG:.10g}, sd_log = {record.R0_sd_log:.10g} }}"
    lines += ["", "[surrogate]", f"R0_mmHg_s_per_ml = {prior}"]
    rest = {"K_mmHg_s2_per_ml2": _clinical(record.K), "L_mmHg_s2_per_ml": _clinical(record.L)}
    lines += [f"{key} = {value:.10g}" for key, value in rest.items() if value is not None]
    for c in record.conditions:
        lines += ["", f"[condition.{c.name}]", f'drug = "{c.drug}"']
        lines += [f"order = {c.order}", f"held_out = {str(c.held_out).lower()}"]
        numbers = {
            "period_s": c.period,
            "P_systolic_mmHg": _clinical(c.P_systolic),
            "P_diastolic_mmHg": _clinical(c.P_diastolic),
            "mean_P_aorta_mmHg": _clinical(c.mean_P_aorta),
            "mean_P_distal_mmHg": _clinical(c.mean_P_distal),
            "ffr": c.ffr,
            "mean_flow_ml_per_min": None if c.mean_Q is None else c.mean_Q / ML_PER_MIN,
        }
        lines += [f"{key} = {value:.10g}" for key, value in numbers.items() if value is not None]
        if c.beats:
            lines.append(f'waveform = "{c.name}.csv"')
            files[f"{c.name}.csv"] = _csv(c)
    return {**files, RECORD_FILE: "\n".join(lines) + "\n"}


def _clinical(value: float | None) -> float | None:
    return None if value is None else value / MMHG


def _csv(c: "diagnosis.RecordedCondition") -> str:
    names = {"P_aorta": "P_aorta_mmHg", "P_distal": "P_distal_mmHg", "Q": "Q_coronary_ml_per_min"}
    columns = {names[n]: b / (ML_PER_MIN if n == "Q" else MMHG) for n, b in c.beats.items()}
    count, n = next(iter(columns.values())).shape
    t = np.arange(count * n) / n * c.period
    rows = np.stack([t, *(wave.reshape(-1) for wave in columns.values())], axis=1)
    head = ",".join(["time_s", *columns])
    return "\n".join([head, *(",".join(f"{v:.10g}" for v in row) for row in rows)]) + "\n"


def without(record: "diagnosis.Record", name: str) -> "diagnosis.Record":
    """The record without one condition."""
    kept = tuple(c for c in record.conditions if c.name != name)
    return dataclasses.replace(record, conditions=kept)
