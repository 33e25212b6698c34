"""Reads the samples of one file: ascending times, pressures in mmHg, lost samples left out."""

import pathlib

import numpy as np

from study.case.catheter.columns import ChosenColumns, ExportFormat, choose_columns
from study.case.catheter.dicom_channels import is_dicom
from study.case.catheter.dicom_table import read_dicom_table
from study.case.catheter.samples import CatheterTrace
from study.case.catheter.table import ConsoleTable, read_console_table, refusal
from study.case.catheter.units import PRESSURE_UNITS
from study.case.faults import shown
from study.case.record_beats import COLUMNS, SWAPPED_MMHG

LONGEST_STEP = 0.05
"""Longest usual step between samples: below 20 Hz an upstroke is lost [s]."""

LEAST_PULSE = 2.0
"""Pulse of a connected pressure sensor [mmHg]."""

KPA_MEDIAN = 35.0
"""Median aortic pressure below which numbers are no mmHg of a living patient."""

LEAST_KPA = 5.0
"""Median above which such numbers may be kPa."""

_RANGES = {column.name: (column.low, column.high) for column in COLUMNS}
_SENSORS = {"aortic": "P_aorta", "distal": "P_distal", "flow": "Q_coronary"}
_LOST_SHARE = 0.3
_TWINS_SHARE = 0.02
_WINDOW = 5


def read_trace(path: pathlib.Path, given: ExportFormat) -> CatheterTrace:
    """Read the traces of a file.

    Args:
        path: the export.
        given: what the user says of its columns.

    Raises:
        CaseError: it holds no usable traces; the first fault in a sentence.
    """
    dicom = is_dicom(path)
    table = read_dicom_table(path, given) if dicom else read_console_table(path)
    chosen = choose_columns(table, given)
    remarks = list(table.remarks)
    t, kept = _times(table, chosen, given, remarks)
    units = {"aortic": chosen.pressure_mmHg, "distal": chosen.pressure_mmHg, "flow": 1.0}
    waves = {
        _SENSORS[role]: table.values[kept, at] * units[role]
        for role, at in chosen.index.items()
        if role in _SENSORS
    }
    if chosen.pressure_mmHg != 1.0:
        remarks.append("Pressures were converted from kPa to mmHg.")
    _check_unit(path, waves["P_aorta"], chosen)
    for name, wave in waves.items():
        low, high = _RANGES[name]
        wave[(wave < low) | (wave > high)] = np.nan
    whole = np.isfinite(sum(waves.values(), np.zeros(t.size)))
    _check_lost(path, whole, waves, remarks)
    t, waves = t[whole], {name: wave[whole] for name, wave in waves.items()}
    trace = CatheterTrace(path, t, waves, _step(path, t), tuple(remarks), chosen.names)
    _check_traces(trace)
    return trace


def _times(
    table: ConsoleTable, chosen: ChosenColumns, given: ExportFormat, remarks: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Ascending times [s], and the rows that they belong to."""
    rows = np.arange(len(table.values))
    if given.rate is not None:
        return rows / given.rate, rows
    t = table.values[:, chosen.index["time"]] * chosen.time_s
    rows = rows[np.isfinite(t)]
    if rows.size < 0.5 * t.size:
        cure = "name the column of the times with --columns time=..., or give --rate"
        raise refusal(table.path, "most times are no numbers", cure)
    t = t[rows]
    kept = _plausible_times(t)
    if not kept.all():
        remarks.append(f"{int((~kept).sum())} samples with a wrong time were left out.")
        t, rows = t[kept], rows[kept]
    steps = np.diff(t)
    if np.median(steps) < 0.0 or (steps < 0.0).sum() > 3:
        problem = "the times run backwards"
        raise refusal(table.path, problem, "export in the order of time, or give --rate instead")
    back = np.flatnonzero(steps < 0.0)
    if back.size:
        problem = f"the time falls back to {shown(float(t[back[0] + 1]))} s"
        cure = "the file holds more than one recording: give each in a file of its own"
        line = int(table.lines[rows[back[0] + 1]])
        raise refusal(table.path, problem, cure, key=f"line {line}")
    twins = np.flatnonzero(steps == 0.0) + 1
    if twins.size > _TWINS_SHARE * t.size:
        problem = f"{twins.size} of {t.size} samples have the time of the one before"
        cure = "the clock is rounded too far: give the sampling rate, such as --rate 100"
        raise refusal(table.path, problem, cure)
    if twins.size:
        remarks.append(f"{twins.size} samples with the time of the one before were left out.")
    first = np.ones(t.size, bool)
    first[twins] = False
    return t[first], rows[first]


def _plausible_times(t: np.ndarray) -> np.ndarray:
    """Which times lie near those of their neighbours; all where many do not."""
    if t.size < _WINDOW:
        return np.ones(t.size, bool)
    reach = _WINDOW // 2
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(t, reach, mode="edge"), _WINDOW)
    step = float(np.median(np.abs(np.diff(t))))
    kept = np.abs(t - np.median(windows, axis=1)) <= 10.0 * step
    return kept if (~kept).sum() <= _TWINS_SHARE * t.size else np.ones(t.size, bool)


def _check_unit(path: pathlib.Path, P: np.ndarray, chosen: ChosenColumns) -> None:
    """Refuse pressures that are no mmHg, and an export without any."""
    finite = P[np.isfinite(P)]
    if finite.size == 0:
        cure = "choose the column with --columns aortic=..."
        raise refusal(path, "the aortic column holds no numbers", cure)
    middle = float(np.median(finite))
    if middle >= KPA_MEDIAN and middle <= _RANGES["P_aorta"][1]:
        return
    said = f"an aortic pressure near {middle:.3g} mmHg is not plausible"
    cure = "choose another column with --columns aortic=..., or check the unit"
    if LEAST_KPA < middle < KPA_MEDIAN and chosen.pressure_mmHg == 1.0:
        read = f"{middle:.3g} kPa are {middle * PRESSURE_UNITS['kPa']:.0f} mmHg"
        cure = f"if it is in kPa ({read}), add --unit kPa, whatever the header says; else choose"
        cure += " another column with --columns aortic=..."
    raise refusal(path, said, cure)


def _check_lost(
    path: pathlib.Path, whole: np.ndarray, waves: dict[str, np.ndarray], remarks: list[str]
) -> None:
    lost = int((~whole).sum())
    if lost > _LOST_SHARE * whole.size:
        worst = max(waves, key=lambda name: int(np.isnan(waves[name]).sum()))
        problem = f"{lost} of {whole.size} samples hold no plausible {worst}"
        cure = "choose other columns with --columns, check the unit, or cut with --span"
        raise refusal(path, problem, cure)
    if lost:
        remarks.append(f"{lost} of {whole.size} samples hold no plausible number: left out.")


def _step(path: pathlib.Path, t: np.ndarray) -> float:
    steps = np.diff(t)
    step = float(np.median(steps))
    if step > LONGEST_STEP:
        problem = f"a sample every {step:.3g} s"
        cure = "export at 50 Hz or more; if times are in milliseconds, add --time-unit ms"
        raise refusal(path, problem, cure)
    if step < 1e-4:
        problem = f"a sample every {step:.3g} s: the recording would last {t[-1] - t[0]:.3g} s"
        cure = (
            "check the unit of the times: --time-unit s, whatever the header says, or give --rate"
        )
        raise refusal(path, problem, cure)
    return step


def _check_traces(trace: CatheterTrace) -> None:
    """Refuse sensors that were not connected, and columns that were exchanged."""
    for name in ("P_aorta", "P_distal"):
        low, high = np.percentile(trace.waves[name], [2.0, 98.0])
        if high - low < LEAST_PULSE:
            problem = f"{name} hardly moves ({high - low:.2g} mmHg)"
            cure = "choose the phasic trace, not its mean, with --columns; was it connected?"
            raise refusal(trace.path, problem, cure)
    excess = float(trace.waves["P_distal"].mean() - trace.waves["P_aorta"].mean())
    if excess > SWAPPED_MMHG:
        problem = f"the distal mean pressure lies {excess:.1f} mmHg above the aortic one"
        cure = "exchange aortic and distal with --columns; else check the zero of both sensors"
        raise refusal(trace.path, problem, cure)
    same = np.abs(trace.waves["P_distal"] - trace.waves["P_aorta"]).max()
    if same == 0.0:
        problem = "aortic and distal pressure are the same numbers"
        raise refusal(trace.path, problem, "choose different columns with --columns")
