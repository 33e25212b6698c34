"""A DICOM file of haemodynamic waveforms as the table that an export as text makes.

Column 0 is the time, the others are the channels of the file in their order. Channels that were
not sampled at the same times are brought to those of the slower pressure by linear interpolation:
in between there would be samples that were never measured, and the scatter of the beats would
look less than it is. The time is 0 s at the first sample that both pressures have.
"""

import pathlib
from collections.abc import Mapping

import numpy as np

from study.case.catheter.columns import ExportFormat, choose_columns
from study.case.catheter.dicom_channels import Channel, read_channels
from study.case.catheter.table import FEWEST_ROWS, ConsoleTable, refusal
from study.case.catheter.units import PRESSURE_UNITS

_KNOWN = "mm[Hg] and kPa"
_LEAST_SHIFT = 5e-5


def read_dicom_table(path: pathlib.Path, given: ExportFormat) -> ConsoleTable:
    """Read the channels of a file that hold pressures, and the flow where it is chosen.

    Args:
        path: the file.
        given: what the user says of its columns.

    Raises:
        CaseError: it cannot be read, or a channel is missing, without unit or without samples.
    """
    for key, value in (("--rate", given.rate), ("--time-unit", given.time_unit)):
        if value is not None:
            problem = "a DICOM file says its own times"
            raise refusal(path, problem, f"leave out {key}", key=key, value=value)
    channels = read_channels(path)
    _check_pressures(path, channels, given)
    header = ("time", *(channel.name for channel in channels))
    units = ("s", *(channel.unit for channel in channels))
    roles = ("time", *(channel.role for channel in channels))
    names = ConsoleTable(
        path, header, units, np.zeros((0, len(header))), np.zeros(0, int), (), roles
    )
    index = choose_columns(names, given).index
    if index["time"] != 0:
        raise refusal(path, "the time is column 0", "leave out time=", key="--columns time")
    used = {role: channels[at - 1] for role, at in index.items() if role != "time"}
    for role, channel in used.items():
        _check_channel(path, role, channel, given)
    t, columns = _together(path, used)
    values = np.full((t.size, len(header)), np.nan)
    values[:, 0] = t
    for role, column in columns.items():
        values[:, index[role]] = column
    remarks = _remarks(channels, used)
    return ConsoleTable(path, header, units, values, np.arange(1, t.size + 1), remarks, roles)


def _check_pressures(path: pathlib.Path, channels: list[Channel], given: ExportFormat) -> None:
    """Refuse a file without any pressure."""
    if given.columns or any(c.unit in PRESSURE_UNITS or c.role for c in channels):
        return
    if given.pressure_unit is None:
        held = ", ".join(f"{c.name} ({c.code or 'no unit'})" for c in channels)
        cure = f"give the object with the pressures, in {_KNOWN}; or choose channels with --columns"
        raise refusal(path, f"it holds no pressure; its channels are {held}", cure)


def _check_channel(path: pathlib.Path, role: str, channel: Channel, given: ExportFormat) -> None:
    """Refuse a chosen channel whose values mean nothing."""
    where = f"channel {channel.name}"
    if channel.problem:
        cure = "export calibrated channels; else export them as text and give --unit"
        raise refusal(path, channel.problem, cure, key=where)
    said = f"its unit is {channel.code}" if channel.code else "it has no unit"
    if role == "flow":
        if channel.unit != "ml/min":
            raise refusal(path, f"{said}, not mL/min", "leave the flow out", key=where)
    elif channel.unit not in PRESSURE_UNITS and given.pressure_unit is None:
        cure = "choose another channel with --columns; or, if its numbers are mmHg or kPa, say"
        cure += " which with --unit"
        raise refusal(path, f"{said}; known are {_KNOWN}", cure, key=where)


def _together(
    path: pathlib.Path, used: Mapping[str, Channel]
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Common times from 0 s, and the values of each channel at them."""
    clock = min((used["aortic"], used["distal"]), key=lambda channel: channel.rate)
    t = clock.start + np.arange(clock.values.size) / clock.rate
    columns: dict[str, np.ndarray] = {}
    for role, c in used.items():
        same = (c.rate, c.start, c.values.size) == (clock.rate, clock.start, clock.values.size)
        known = c.start + np.arange(c.values.size) / c.rate
        columns[role] = c.values if same else np.interp(t, known, c.values, np.nan, np.nan)
    ends = [(c.start, c.start + (c.values.size - 1) / c.rate) for c in used.values()]
    slack = 1e-6 / clock.rate
    kept = (t >= max(low for low, _ in ends) - slack) & (t <= min(high for _, high in ends) + slack)
    if kept.sum() < FEWEST_ROWS:
        names = ", ".join(c.name for c in used.values())
        problem = f"the chosen channels ({names}) have {int(kept.sum())} samples in common"
        cure = (
            "choose channels of one part of the recording, by number: --columns aortic=1,distal=2"
        )
        raise refusal(path, problem, cure)
    t = t[kept]
    return t - t[0], {role: column[kept] for role, column in columns.items()}


def _remarks(channels: list[Channel], used: Mapping[str, Channel]) -> tuple[str, ...]:
    """What a user should know of the channels, in sentences."""
    aortic, distal = used["aortic"], used["distal"]
    remarks = [remark for channel in used.values() for remark in channel.remarks]
    others = [c.name for c in channels if not any(c is one for one in used.values())]
    if others:
        remarks.append(f"Channels not read: {', '.join(others)}.")
    if aortic.rate != distal.rate:
        remarks.append(
            f"The aortic pressure has {aortic.rate:g} samples a second, the distal one "
            f"{distal.rate:g}: both are taken at the times of the slower."
        )
    later = distal.shift - aortic.shift
    if abs(later) > _LEAST_SHIFT:
        which = "later" if later > 0.0 else "earlier"
        remarks.append(
            f"The file states skews and offsets by which distal samples are {abs(later) * 1e3:.3g} "
            f"ms {which} than aortic ones: they are taken so."
        )
    return tuple(remarks)
