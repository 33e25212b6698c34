"""What noise alone leaves of a held-out distal pressure: the error of a method that knows all.

    floor² = mean(e)² + var(e) / beats,    e = recorded trace − noise-free trace

A prediction that knows patient and effect still misses the recorded trace by its noise, which the
mean of several beats has less of, and by the error that all beats share.
"""

import pathlib
import tomllib
from typing import Any

import numpy as np

LEAST_GAP = 0.2
"""Held-out gap above the floor from which a share of it is meaningful [mmHg]."""

Row = dict[str, Any]


def noise_floor(folder: pathlib.Path, record: str) -> float | None:
    """Root mean square error that noise alone leaves [mmHg].

    None without a held-out trace, or without the noise-free ones.

    Args:
        folder: a set, see `benchmarks.foreign.make`.
        record: its name.
    """
    place, known = folder / "records" / record, folder / "truth" / f"{record}.npz"
    if not known.is_file():
        return None
    squares = []
    stated = tomllib.loads((place / "record.toml").read_text(encoding="utf-8"))["condition"]
    with np.load(known) as truth:
        for name, condition in stated.items():
            if not condition.get("held_out") or f"{name}/with/P_distal" not in truth:
                continue
            seen = np.genfromtxt(place / condition["waveform"], delimiter=",", names=True)
            error = seen["P_distal_mmHg"] - truth[f"{name}/with/P_distal"]
            times = seen["time_s"]
            beats = max(round((times[-1] - times[0]) / condition["period_s"]), 1)
            squares.append(np.mean(error) ** 2 + np.var(error) / beats)
    return float(np.sqrt(np.mean(squares))) if squares else None


def share_closed(row: Row, floor: float | None) -> float | None:
    """Share of the held-out gap that a method closes over that which noise leaves to be closed."""
    if floor is None or "held_out_rms_mmHg" not in row:
        return None
    before, after = row["held_out_rms_mmHg"]
    return (before - after) / (before - floor) if before - floor > LEAST_GAP else None
