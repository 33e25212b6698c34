"""A measured beat of aortic pressure, read from a CSV file.

The header names the columns `time_s` and `P_aorta_mmHg`; other columns are ignored. Samples are
uniform, start at t = 0 with ejection, and cover one period. A sample at t = period repeats the
first one and is dropped, so that sample k of n belongs to t = k period/n.
"""

import math
import pathlib
from collections.abc import Sequence

from lumped.units import MMHG
from study.case.advice import explain_wrong_unit, nearest, range_cure
from study.case.beat import Beat
from study.case.faults import Fault, shown, unreadable
from study.case.schema import Quantity

FEWEST_SAMPLES = 8
"""Smallest number of samples that resolves the shape of a beat."""

MOST_SAMPLES = 10_000
"""Largest number of samples; more cost time and add no detail."""

LARGEST_SIZE = 2**24
"""Largest size of a file; one beat is far smaller [bytes]."""

_UNEVENNESS = 0.2
"""Allowed deviation of a sample from uniform times [steps]: rounding passes, a lost sample (0.5)
fails."""

_PEAK_FACTOR = 2.0
"""Beat and stated pressure may be of different minutes; a slip of unit is a larger factor."""

_TIME = Quantity("time", "s", -60.0, 60.0, name="time")
_P_AORTA = Quantity("pressure", "mmHg", 10.0, 350.0, name="P_aorta")


def read_beat(
    path: pathlib.Path, period: float, P_systolic: float, key: str, faults: list[Fault]
) -> Beat | None:
    """Read a measured beat; faults are added to the list.

    Args:
        path: the CSV file.
        period: length of the cycle that the beat must cover [s].
        P_systolic: systolic pressure that the case states [dyn/cm²]; the peak must be near it.
        key: the key of the case file that names the beat, for the messages.
        faults: where faults are collected.

    Returns:
        The beat, or None where it is at fault.
    """

    def refuse(value: object, problem: str, allowed: str, cure: str) -> None:
        faults.append(Fault(path, key, value, problem, allowed, cure))

    try:
        if path.stat().st_size > LARGEST_SIZE:
            refuse(None, "too large for one beat", "16 MiB", "cut the record to one beat")
            return None
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, ValueError) as error:
        cure = "give a CSV text file with the header time_s,P_aorta_mmHg"
        refuse(None, unreadable(error), "", cure)
        return None
    if len(lines) > MOST_SAMPLES + 1:
        count, allowed = len(lines) - 1, f"at most {MOST_SAMPLES}"
        cure = f"keep every {-(-count // 1000)}th sample, or cut the record to one beat"
        refuse(count, "more samples than a beat needs", allowed, cure)
        return None
    rows = [[cell.strip() for cell in line.split(",")] for line in lines if line.strip()]
    wrong = _wrong_header(rows[0] if rows else [])
    if wrong is not None:
        refuse(*wrong)
        return None
    header, samples = rows[0], rows[1:]
    try:
        t, P_mmHg = _columns(header, samples)
    except _BadRow as bad:
        refuse(bad.row, "not a row of finite numbers", f"{len(header)} numbers a row", bad.cure)
        return None
    wrong = _wrong_times(t, period) or _wrong_pressures(P_mmHg, P_systolic / MMHG)
    if wrong is not None:
        refuse(*wrong)
        return None
    dt = (t[-1] - t[0]) / (len(t) - 1)
    count = len(t) - 1 if abs(t[-1] - t[0] - period) <= 0.5 * dt else len(t)
    return Beat(path, tuple(t[:count]), tuple(P * MMHG for P in P_mmHg[:count]))


class _BadRow(Exception):
    """A row of the file that holds no numbers."""

    def __init__(self, row: str, cure: str):
        Exception.__init__(self, row)
        self.row = row
        self.cure = cure


_Wrong = tuple[object, str, str, str]
"""Value, problem, what is allowed, cure."""


def _wrong_header(header: Sequence[str]) -> _Wrong | None:
    allowed = f"{_TIME.key},{_P_AORTA.key}"
    missing = [column.key for column in (_TIME, _P_AORTA) if column.key not in header]
    if not missing and len(set(header)) < len(header):
        return ",".join(header), "a column is given twice", allowed, "remove one of them"
    if not missing:
        return None
    cure = f"write a first line with the names of the columns, {allowed}"
    others = [name for name in header if name not in (_TIME.key, _P_AORTA.key)]
    for name in others:
        slip = explain_wrong_unit(name, None, (_TIME, _P_AORTA))
        if slip is not None:
            cure = f"convert column {name}: {slip[2]}"
        elif nearest(name, missing):
            cure = f"rename column {name} to {nearest(name, missing)}"
    if len(header) == 1 and any(mark in header[0] for mark in ";\t"):
        cure = "separate the columns by commas"
    return ",".join(header), f"the header lacks {' and '.join(missing)}", allowed, cure


def _columns(header: list[str], rows: list[list[str]]) -> tuple[list[float], list[float]]:
    places = header.index(_TIME.key), header.index(_P_AORTA.key)
    t, P_mmHg = [], []
    for number, row in enumerate(rows, start=1):
        cure = f"correct sample {number}: as many numbers as columns, with a point as decimal mark"
        if len(row) != len(header):
            raise _BadRow(",".join(row), cure)
        try:
            sample = [float(row[place]) for place in places]
        except ValueError:
            raise _BadRow(",".join(row), cure) from None
        if not all(math.isfinite(value) for value in sample):
            raise _BadRow(",".join(row), cure)
        t.append(sample[0])
        P_mmHg.append(sample[1])
    return t, P_mmHg


def _wrong_times(t: Sequence[float], period: float) -> _Wrong | None:
    if len(t) < FEWEST_SAMPLES:
        allowed = f"at least {FEWEST_SAMPLES} samples"
        return len(t), "too few samples for a beat", allowed, "export the beat at a higher rate"
    dt = (t[-1] - t[0]) / (len(t) - 1)
    if dt <= 0.0:
        return t[-1], "the times do not increase", "uniform times", "sort the samples by time"
    shifts = [abs(t_k - t[0] - k * dt) for k, t_k in enumerate(t)]
    worst = max(range(len(t)), key=shifts.__getitem__)
    if shifts[worst] > _UNEVENNESS * dt:
        cure = f"resample to a uniform step, near {dt:.4g} s; look for lost samples at t = "
        return (
            t[worst],
            "the samples are not uniform in time",
            "uniform times",
            f"{cure}{t[worst]:g}",
        )
    if abs(t[0]) > 0.5 * dt:
        cure = f"subtract {t[0]:g} s from all times; t = 0 is the start of ejection"
        return t[0], "the beat does not start at t = 0", "0 s", cure
    allowed = f"one period, {period:g} s"
    span = t[-1] - t[0]
    if span + dt < period - 0.5 * dt:
        cure = "export the whole beat, or correct period_s"
        return span + dt, "the beat is shorter than the period", allowed, cure
    if span > period + 0.5 * dt:
        cure = "cut the record to one beat, or correct period_s"
        return span, "the beat is longer than the period", allowed, cure
    return None


def _wrong_pressures(P_mmHg: Sequence[float], P_systolic_mmHg: float) -> _Wrong | None:
    for value in P_mmHg:
        if not _P_AORTA.holds(value):
            problem = f"a pressure of {shown(value)} mmHg is not plausible in the aorta"
            return value, problem, _P_AORTA.allowed, range_cure(_P_AORTA, value)
    peak = max(P_mmHg)
    if not P_systolic_mmHg / _PEAK_FACTOR <= peak <= P_systolic_mmHg * _PEAK_FACTOR:
        allowed = f"peak within a factor {_PEAK_FACTOR:g} of P_systolic_mmHg = {P_systolic_mmHg:g}"
        cure = "check that both are in mmHg (1 kPa = 7.5 mmHg) and of the same condition"
        return peak, "the peak is far from the systolic pressure of the case", allowed, cure
    return None
