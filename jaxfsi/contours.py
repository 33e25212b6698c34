"""Lumen contours drawn on an intravascular ultrasound pullback, read from a file.

One point a line, separated by tabs, commas, or semicolons with decimal points or commas: frame
number, x, y, z in millimetres. The points of a frame stand together and share their z; z = 0 is the
distal end and the last frame is the ostium. A first line may name the columns, in any order and
with others between; a column ``position`` in place of z counts from the ostium, and the frames may
then stand in either order.

The catheter moves back and forth with heart and breath while it is pulled, so the order in which
frames were taken is not exactly their order along the vessel. Who has sorted them by eye keeps a
table with a row per frame (columns ``frame`` and ``position``, the latter in mm from the ostium);
given that table, its positions are used instead of z.
"""

import itertools
import math
import os
import pathlib
import re
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxfsi.lumen import Lumen
from jaxfsi.text_files import read_separated, read_table
from lumped.units import MM

_MIN_FRAMES = 3
_MIN_POINTS = 8
_WIDTH_RANGE_MM = (0.2, 60.0)
# The catheter alone is about 1 mm thick, and no pullback lies in aneurysms from end to end.
_WIDEST_RANGE_MM = (1.0, 30.0)
_MAX_FAULTS_SHOWN = 8
_HINT = (
    "Expected one point a line: frame number, x, y, z in mm, separated by tabs, commas or "
    "semicolons; frames from the distal end (z = 0) to the ostium, each with the same number of "
    "points. A first line may name the columns: frame, x, y, and z, or position (mm from the "
    "ostium)."
)


_FRAME, _POSITION = {"frame", "frame_number", "number", "nr", "bild", "image"}, {"position", "pos"}
_UNIT = re.compile(r"[\[(]\s*(\w*)\s*[\])]")


class _Frame(NamedTuple):
    number: int
    z_mm: float
    line: int
    points_mm: list[tuple[float, float]]


class FrameContour(NamedTuple):
    """One contour of a pullback, as drawn.

    Attributes:
        z_mm: height of the frame [mm].
        points_mm: its points, counter-clockwise, not closed by a repeated one [mm].
    """

    z_mm: float
    points_mm: np.ndarray


def read_frames(path: pathlib.Path) -> dict[int, FrameContour]:
    """Contours of a file by the number of their frame.

    Args:
        path: as for `read_ivus_contours`.

    Raises:
        ValueError: the file cannot be read as described.
    """
    frames = _parse(path)
    contours = _contours(path, frames)
    return {
        frame.number: FrameContour(frame.z_mm, points)
        for frame, points in zip(frames, contours, strict=True)
    }


def read_ivus_contours(
    path: str | os.PathLike[str], *, frame_table: str | os.PathLike[str] | None = None
) -> Lumen:
    """Read the contours of a pullback as a lumen.

    Args:
        path: file of points (frame, x, y, z in mm), see above; a byte-order mark is skipped.
        frame_table: table separated by commas or semicolons with the columns ``frame`` and
            ``position`` [mm from the ostium]. Where it is given, frames lie at their position and
            are sorted by it; where it is not, s is the distance from the last frame along z.

    Returns:
        The lumen, in cm, from the ostium (s = 0) downstream. A closing point that repeats the
        first one is dropped and every contour runs counter-clockwise.

    Raises:
        ValueError: the file cannot be read as described; the message names file, line and value
            of every fault.
    """
    path = pathlib.Path(path)
    frames = _parse(path)
    contours = _contours(path, frames)
    z_mm = np.array([frame.z_mm for frame in frames])
    if frame_table is None:
        s_mm = z_mm[-1] - z_mm
    else:
        s_mm = _positions(pathlib.Path(frame_table), frames)
    order = np.argsort(s_mm)
    s_mm = s_mm[order] - s_mm[order[0]]
    return Lumen(contours=jnp.asarray(contours[order] * MM), s=jnp.asarray(s_mm * MM))


def _refuse(path: pathlib.Path, faults: list[str], hint: str = _HINT) -> ValueError:
    shown = faults[:_MAX_FAULTS_SHOWN]
    if len(faults) > len(shown):
        shown.append(f"and {len(faults) - len(shown)} more")
    return ValueError(f"{path}: " + "; ".join(shown) + f". {hint}")


def _number(field: str) -> float | None:
    try:
        value = float(field)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _rows(path: pathlib.Path) -> list[tuple[int, list[str]]]:
    """Lines that are not blank, with their number and their fields; frame, x, y, z if named."""
    lines = enumerate(read_separated(path, "\t").splitlines(), start=1)
    rows = [(i, line.split("\t")) for i, line in lines if line.strip()]
    if not rows or any(_number(field) is not None for field in rows[0][1]):
        return rows
    names = [_UNIT.sub("", name).strip().lower().replace(" ", "_") for name in rows[0][1]]
    units = {unit.lower() for name in rows[0][1] for unit in _UNIT.findall(name)}
    at = [
        next((k for k, name in enumerate(names) if name in spelt), None)
        for spelt in (_FRAME, {"x"}, {"y"}, {"z", *_POSITION})
    ]
    frame, x, y, z = at
    if frame is None or x is None or y is None or z is None:
        raise _refuse(path, [f"line {rows[0][0]}: the columns are {', '.join(names)}"])
    if units - {"mm", ""}:
        raise _refuse(path, [f"line {rows[0][0]}: units {', '.join(sorted(units))}, not mm"])
    wide = max(frame, x, y, z)
    rows = [(i, [*fields, *[""] * wide]) for i, fields in rows[1:]]
    rows = [(i, [fields[k] for k in (frame, x, y, z)]) for i, fields in rows]
    return _from_distal_end(rows) if names[z] in _POSITION else rows


def _from_distal_end(rows: list[tuple[int, list[str]]]) -> list[tuple[int, list[str]]]:
    """Rows whose last field counts from the ostium, with z from the distal end, sorted by it."""
    positions = [_number(fields[3]) for _, fields in rows]
    known = [p for p in positions if p is not None]
    if len(known) < len(rows):
        return rows  # what is no number is told by who reads them
    z = [max(known) - p for p in known]
    moved = [(i, [*fields[:3], repr(h)]) for (i, fields), h in zip(rows, z, strict=True)]
    return [moved[k] for k in sorted(range(len(rows)), key=z.__getitem__)]


def _parse(path: pathlib.Path) -> list[_Frame]:
    """Group the points by frame, in the order of the file; report every faulty line at once."""
    faults: list[str] = []
    frames: list[_Frame] = []
    seen: set[int] = set()
    for i, fields in _rows(path):
        if len(fields) != 4:
            line = "\t".join(fields)
            faults.append(f"line {i}: {len(fields)} values instead of 4 ({line[:40]!r})")
            continue
        values = [_number(field) for field in fields]
        bad = [field for field, value in zip(fields, values, strict=True) if value is None]
        number, x, y, z = values
        if number is None or x is None or y is None or z is None:
            faults.append(
                f"line {i}: {', '.join(repr(field[:40]) for field in bad)} is not a finite number"
            )
            continue
        if number != int(number):
            faults.append(f"line {i}: frame number {fields[0][:40]!r} is not a whole number")
            continue
        if not frames or frames[-1].number != number:
            if number in seen:
                faults.append(f"line {i}: frame {int(number)} starts a second time")
            seen.add(int(number))
            frames.append(_Frame(int(number), z, i, []))
        if z != frames[-1].z_mm:
            faults.append(
                f"line {i}: z = {z:g} differs from z = {frames[-1].z_mm:g} of frame {int(number)}"
            )
        frames[-1].points_mm.append((x, y))
    if not frames and not faults:
        faults.append("holds no points")
    faults.extend(_frame_faults(frames) if not faults else [])
    if faults:
        raise _refuse(path, faults)
    return frames


def _frame_faults(frames: list[_Frame]) -> list[str]:
    faults = []
    if len(frames) < _MIN_FRAMES:
        faults.append(f"{len(frames)} frames, at least {_MIN_FRAMES} are needed")
    counts = [len(frame.points_mm) for frame in frames]
    expected = max(set(counts), key=counts.count)
    faults.extend(
        f"line {frame.line}: frame {frame.number} has {count} points where the others have"
        f" {expected}"
        for frame, count in zip(frames, counts, strict=True)
        if count != expected
    )
    if expected < _MIN_POINTS:
        faults.append(f"{expected} points a frame, at least {_MIN_POINTS} are needed")
    faults.extend(
        f"line {frame.line}: z = {frame.z_mm:g} of frame {frame.number} does not lie above"
        f" z = {before.z_mm:g} of frame {before.number}"
        for before, frame in itertools.pairwise(frames)
        if frame.z_mm <= before.z_mm
    )
    return faults


def _contours(path: pathlib.Path, frames: list[_Frame]) -> np.ndarray:
    """Points of all frames [mm], not closed by a repeated point, counter-clockwise."""
    points = np.array([frame.points_mm for frame in frames])
    if np.allclose(points[:, 0], points[:, -1], rtol=0.0, atol=1e-9):
        points = points[:, :-1]
    following = np.roll(points, -1, axis=1)
    doubled_area = np.sum(
        points[..., 0] * following[..., 1] - following[..., 0] * points[..., 1], axis=1
    )
    widths = np.max(np.ptp(points, axis=1), axis=1)
    low, high = _WIDTH_RANGE_MM
    faults = [
        f"line {frame.line}: frame {frame.number} is {width:g} mm wide, allowed {low:g}..{high:g}"
        if not low <= width <= high
        else f"line {frame.line}: frame {frame.number} encloses no area"
        for frame, width, doubled in zip(frames, widths, doubled_area, strict=True)
        if not low <= width <= high or abs(doubled) < 1e-6 * width**2
    ]
    low, high = _WIDEST_RANGE_MM
    if not faults and not low <= np.max(widths) <= high:
        faults.append(
            f"the widest of all frames measures {np.max(widths):g} mm, expected {low:g}..{high:g}"
        )
    if faults:
        raise _refuse(path, faults, "Check that x, y and z are in mm.")
    points[doubled_area < 0.0] = points[doubled_area < 0.0, ::-1]
    return points


def _positions(path: pathlib.Path, frames: list[_Frame]) -> np.ndarray:
    """Position of each frame from the ostium [mm], from the table of frames."""
    hint = "Expected a header with the columns frame and position (mm) and a row for each frame."
    table: dict[int, float] = {}
    faults: list[str] = []
    for line, row in read_table(path):
        if not {"frame", "position"} <= set(row):
            raise _refuse(path, ["no columns frame and position"], hint)
        number, position = _number(row["frame"]), _number(row["position"])
        if number is None or position is None:
            faults.append(
                f"line {line}: frame {row['frame'][:40]!r} at position {row['position'][:40]!r}"
            )
            continue
        if number != int(number):
            faults.append(f"line {line}: frame number {row['frame'][:40]!r} is not a whole number")
        elif int(number) in table:
            faults.append(f"line {line}: frame {int(number)} stands there a second time")
        else:
            table[int(number)] = position
    faults.extend(
        f"frame {frame.number} is missing" for frame in frames if frame.number not in table
    )
    if not faults:
        values = [table[frame.number] for frame in frames]
        if len(set(values)) < len(values):
            faults.append("two frames share one position")
    if faults:
        raise _refuse(path, faults, hint)
    return np.array([table[frame.number] for frame in frames])
