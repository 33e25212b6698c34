"""Reads the recorded beats of a condition from a CSV file and reports faults of the recording.

Columns are `time_s`, `P_aorta_mmHg`, `P_distal_mmHg` and `Q_coronary_ml_per_min`; a sensor that was
not used has no column. A recording of equal whole beats that starts at ejection, with a whole
number of uniform samples in each, is cut by sample index. Any other may begin and end anywhere: its
beats are found in the aortic pressure and averaged by `study.case.beat_folding`.
"""

import math
import pathlib
from collections.abc import Callable

import numpy as np

from lumped.units import ML_PER_MIN
from study.case.advice import explain_wrong_unit
from study.case.beat_folding import Folded, Unfoldable, fold
from study.case.faults import Fault, shown, unreadable
from study.case.onsets import find_upstrokes
from study.case.schema import Quantity

FEWEST_SAMPLES = 16
"""Samples a beat below which its shape is lost."""

WHOLE_BEATS = 0.1
"""Difference between the file's length and whole beats up to which it is cut by index [steps]."""

EQUAL_BEATS = 0.004
"""Scatter of the upstrokes about equal beats up to which a file of whole beats is cut by index
[beats]: noise moves found upstrokes by so much, and hearts that vary do so by 0.01 and more."""

UNEVENNESS = 0.2
"""Shift of a sample up to which times count as uniform [steps]: rounded clock times pass."""

MOST_SAMPLES, MOST_BEATS = 120_000, 200
"""Samples and beats of a recording beyond which it is refused: two minutes at 1 kHz."""

LARGEST_SIZE = 2**24
"""Largest file [bytes]."""

CLIPPED_SHARE = 0.03
"""Share of a beat at its very maximum (or minimum) that shows a clipped trace."""

SWAPPED_MMHG = 8.0
"""Excess of distal over aortic mean pressure that no sensor error explains."""

FAST_EJECTION = 0.2
"""Ejection of a fast heart [s]: more than half of its beat."""

TIME = Quantity("time", "s", -60.0, 600.0, name="time")
COLUMNS = (
    TIME,
    Quantity("pressure", "mmHg", 5.0, 350.0, name="P_aorta"),
    Quantity("pressure", "mmHg", -20.0, 350.0, name="P_distal"),
    Quantity("flow", "ml_per_min", -3000.0, 6000.0, name="Q_coronary"),
)
_SENSOR = {"P_aorta": "P_aorta", "P_distal": "P_distal", "Q_coronary": "Q"}

Refuse = Callable[[object, str, str, str], None]


def read_beats(
    path: pathlib.Path, period: float, P_systolic: float, key: str, faults: list[Fault]
) -> Folded | None:
    """Read the beats of a condition; faults are added to the list.

    Args:
        path: the CSV file.
        period: length of a beat [s].
        P_systolic: what the record states [mmHg].
        key: the key that names the file, for the messages.
        faults: where faults are collected.

    Returns:
        Beats × samples of each sensor [mmHg, mL/s]; None where the file is at fault.
    """
    before = len(faults)

    def refuse(value: object, problem: str, allowed: str, cure: str) -> None:
        faults.append(Fault(path, key, value, problem, allowed, cure))

    table = _table(path, refuse)
    if table is None:
        return None
    t = table.pop("time")
    if not _ascending(t, refuse):
        return None
    beats_held = float(t[-1] - t[0]) / period
    if beats_held > MOST_BEATS:
        cure = f"cut it to a steady stretch of at most {MOST_BEATS * period:.0f} s"
        refuse(round(beats_held), "too many beats", f"at most {MOST_BEATS}", cure)
        return None
    traces = {_SENSOR[name]: values for name, values in table.items()}
    folded = _by_index(t, traces, period)
    if folded is None:
        try:
            folded = fold(t, traces, period, FEWEST_SAMPLES)
        except Unfoldable as refusal:
            refuse(*refusal.parts)
            return None
    _check_clipping(traces, t, period, refuse)
    _check_beats(folded.beats, P_systolic, folded.period, refuse)
    beats = folded.beats
    if "Q" in beats:
        beats["Q"] = beats["Q"] * ML_PER_MIN
    return folded if len(faults) == before else None


def _table(path: pathlib.Path, refuse: Refuse) -> dict[str, np.ndarray] | None:
    header_text = ",".join(column.key for column in COLUMNS)
    try:
        if path.stat().st_size > LARGEST_SIZE:
            cure = "cut it to a steady stretch of one or two minutes"
            refuse(None, "too large for a recording", f"{LARGEST_SIZE // 2**20} MiB", cure)
            return None
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, ValueError) as error:
        refuse(None, unreadable(error), "", f"give CSV text: {header_text}")
        return None
    if len(lines) > MOST_SAMPLES + 1:
        cure = "cut it to a steady stretch, or keep every second or third sample (100 Hz is enough)"
        refuse(len(lines) - 1, "too many samples", f"at most {MOST_SAMPLES}", cure)
        return None
    rows = [[cell.strip() for cell in line.split(",")] for line in lines if line.strip()]
    header = rows[0] if rows else []
    known = {column.key: column.name for column in COLUMNS}
    if len(set(header)) != len(header):
        refuse(",".join(header), "a column is given twice", header_text, "remove one of them")
        return None
    for name in header:
        if name not in known:
            slip = explain_wrong_unit(name, None, COLUMNS)
            cure = f"convert the column: {slip[2]}" if slip else "remove or rename the column"
            refuse(name, "unknown column", header_text, cure)
            return None
    for needed in ("time_s", "P_aorta_mmHg"):
        if needed not in header:
            cure = "name the columns in the first line, separated by commas"
            refuse(",".join(header), f"the column {needed} is missing", header_text, cure)
            return None
    values = np.full((len(rows) - 1, len(header)), np.nan)
    for k, row in enumerate(rows[1:]):
        try:
            values[k] = [float(cell) for cell in row]
        except ValueError:
            pass
        if not np.isfinite(values[k]).all():
            cure = f"correct sample {k + 1}, or cut the record to beats without gaps"
            refuse(",".join(row), "not a row of finite numbers", f"{len(header)} numbers", cure)
            return None
    found = {known[name]: values[:, k] for k, name in enumerate(header)}
    for column in COLUMNS:
        wave = found.get(column.name)
        if wave is not None and wave.size:
            bad = [v for v in (wave.min(), wave.max()) if not column.holds(float(v))]
            if bad:
                cure = f"check the unit of {column.key} (1 kPa = 7.5 mmHg) and the calibration"
                refuse(float(bad[0]), f"{column.key} is not plausible", column.allowed, cure)
                return None
    return found


def _ascending(t: np.ndarray, refuse: Refuse) -> bool:
    """Whether there are samples at ascending times."""
    if t.size < FEWEST_SAMPLES:
        refuse(t.size, "too few samples", f"{FEWEST_SAMPLES} a beat", "export at a higher rate")
        return False
    back = np.flatnonzero(np.diff(t) <= 0.0)
    if back.size:
        cure = f"sort the samples by time and remove doubles; look at sample {back[0] + 2}"
        refuse(float(t[back[0] + 1]), "the times do not increase", "ascending times", cure)
        return False
    return True


def _by_index(t: np.ndarray, traces: dict[str, np.ndarray], period: float) -> Folded | None:
    """Beats cut by index; None where they are not equal with a whole number of samples each."""
    dt = (t[-1] - t[0]) / (t.size - 1)
    count = max(round(t.size * dt / period), 1)
    n = t.size // count
    drift = abs(t.size * dt - count * period)
    uneven = float(np.abs(t - t[0] - dt * np.arange(t.size)).max())
    if (
        n < FEWEST_SAMPLES
        or n * count != t.size
        or abs(t[0]) > 0.5 * dt
        or drift > WHOLE_BEATS * dt
        or uneven > UNEVENNESS * dt
    ):
        return None
    if count > 1:
        found = find_upstrokes(t, traces["P_aorta"], period)
        if found.at.size == count:
            late = found.at - period * np.arange(count)
            if late.std() > max(3.0 * found.sd, 0.3 * dt, EQUAL_BEATS * period):
                return None
    return Folded({name: wave.reshape(count, n) for name, wave in traces.items()}, period, None)


def _check_clipping(
    traces: dict[str, np.ndarray], t: np.ndarray, period: float, refuse: Refuse
) -> None:
    """Refuse pressures that stay at an extreme."""
    beats = max((t[-1] - t[0]) / period, 1.0)
    for name, trace in traces.items():
        for extreme, side in ((trace.max(), "top"), (trace.min(), "bottom")):
            flat = int(np.sum(np.abs(trace - extreme) < 1e-6 * max(abs(extreme), 1.0)))
            if name != "Q" and flat > CLIPPED_SHARE * trace.size and flat >= 3 * beats:
                cure = f"record {name} again with a larger range, or leave the column out"
                problem = f"{name} is clipped at the {side}"
                refuse(shown(float(extreme)), problem, "no flat stretch at an extreme", cure)


def _check_beats(
    beats: dict[str, np.ndarray], P_systolic: float, period: float, refuse: Refuse
) -> None:
    """Refuse beats that no heart has, or not the stated one."""
    aorta = beats["P_aorta"]
    mean_beat = aorta.mean(axis=0)
    peak = float(mean_beat.max())
    if not P_systolic / 1.6 <= peak <= P_systolic * 1.6:
        cure = "check that both are in mmHg and of the same condition, and that columns match names"
        allowed = f"near P_systolic_mmHg = {P_systolic:g}"
        refuse(round(peak, 1), "the aortic peak is far from the stated one", allowed, cure)
    at = float(mean_beat.argmax()) / mean_beat.size
    latest = max(0.55, min(FAST_EJECTION / period, 0.7))
    if not 0.08 <= at <= latest:
        cure = "shift the trace so that it starts where the aortic valve opens, or correct period_s"
        refuse(
            round(at, 3),
            "the aortic peak lies outside ejection",
            f"0.08 to {latest:.2f} beats",
            cure,
        )
    for name, trace in beats.items():
        if name == "Q":
            continue
        pulse = float(np.ptp(trace.mean(axis=0)))
        if pulse < 2.0:
            refuse(round(pulse, 2), f"{name} hardly moves", "a pulse above 2 mmHg",
                   "was the sensor connected? leave the column out if not")  # fmt: skip
    distal = beats.get("P_distal")
    if distal is not None and distal.mean() > aorta.mean() + SWAPPED_MMHG:
        cure = "swap the two columns if they were exchanged; else check the zero of both sensors"
        excess = round(float(distal.mean() - aorta.mean()), 1)
        refuse(excess, "the distal pressure lies above the aortic one", "at most 8 mmHg", cure)
    flow = beats.get("Q")
    if flow is not None and flow.mean() <= 0.0:
        cure = "turn the sign: flow into the coronary is positive"
        value = round(float(flow.mean()), 2)
        refuse(value, "the mean coronary flow is not positive", "above 0", cure)
    if not all(math.isfinite(float(wave.sum())) for wave in beats.values()):
        refuse(None, "a trace is not finite", "finite numbers", "cut out the gap")
