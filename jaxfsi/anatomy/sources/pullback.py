"""Cross-sections of an anomalous coronary from ultrasound, turned to face the aorta.

A pullback gives contours in the coordinates of the catheter. Only their shape means something: the
catheter lies anywhere in the lumen, so each contour is taken about its own centroid, and turned so
that u points away from the aorta and v runs along its wall, u × v downstream. Which way the aorta
lies follows from the contour where it is a slit, because a slit lies flat on the aorta; round
contours, which have no direction of their own, take the direction between their neighbours. Of the
two sides of a slit the reference point, marked by the reader in the aortic wall, picks one.

The direction of a slit is the axis of its second moments: tan 2ψ = 2 S_xy/(S_xx − S_yy) with
S = Σ (p − c)(p − c)ᵀ over the outline.
"""

import os
import pathlib
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxfsi.anatomy.sources.external_wall import ExternalWall, read_external_wall
from jaxfsi.contours import read_frames, read_ivus_contours
from jaxfsi.lumen import Lumen
from jaxfsi.polygons import polygon_centroids
from jaxfsi.text_files import read_separated, read_table
from lumped.units import MM

_DIRECTED_ELLIPTICITY = 1.25
_THICKNESS_COLUMN = "measurement_1"
_THICKNESS_RANGE_MM = (0.05, 10.0)
_USUAL_THICKNESS_MM = 0.15  # median of a pullback; in cm a newborn's septum lies below
_LENGTH_RANGE_MM = (3.0, 250.0)
_LENGTHS_APART = 3.0  # factor between two lengths of one pullback that no motion explains
_AREAS_APART = 3.0
_REFERENCE_REACH_MM = 40.0
_REFERENCE_SLIP_MM = 2.0
_MOST_SHOWN = 8


class Pullback(NamedTuple):
    """Cross-sections from the ostium downstream, each in the frame (u, v) of the aortic wall.

    Attributes:
        s: distance of each section from the ostium [cm].
        sections: points of each section about its centroid [cm]: u away from the aorta, v along
            its wall; anticlockwise.
        septum: tissue measured between the aortic and the coronary lumen [cm]; nan where none was
            measured.
        side_known: whether a reference point told on which side the aorta lies.
        wall: thickness of the wall that was measured at each frame; None: not measured.
    """

    s: Float[np.ndarray, " frames"]
    sections: Float[np.ndarray, "frames points 2"]
    septum: Float[np.ndarray, " frames"]
    side_known: bool
    wall: ExternalWall | None = None


def read_pullback(
    contours: str | os.PathLike[str],
    *,
    frame_table: str | os.PathLike[str] | None = None,
    reference: str | os.PathLike[str] | None = None,
    external: str | os.PathLike[str] | None = None,
) -> Pullback:
    """Read a pullback and turn its sections to face the aorta.

    Args:
        contours: points (frame, x, y, z in mm), see `read_ivus_contours`.
        frame_table: comma-separated table of frames with ``frame``, ``position`` [mm] and
            ``measurement_1``, the tissue between aorta and coronary lumen [mm], empty where not
            measured. Without it frames keep their order along z and no tissue is known.
        reference: one line (frame, x, y, z in mm): a point on the aortic side of
            that frame. Without it the side is chosen arbitrarily (slits are nearly symmetric).
        external: contours of the external elastic membrane in the form of the first file, see
            `jaxfsi.anatomy.sources.external_wall`.

    Raises:
        ValueError: a file cannot be read as described; file, line and value are named.
    """
    lumen = read_ivus_contours(contours, frame_table=frame_table)
    points = np.asarray(lumen.contours)
    z_mm = {number: f.z_mm for number, f in read_frames(pathlib.Path(contours)).items()}
    _check_length(pathlib.Path(contours), float(np.ptp(list(z_mm.values()))), "z spans")
    numbers = np.array(list(z_mm))
    septum = np.full(len(numbers), np.nan)
    if frame_table is None:
        numbers = numbers[::-1]
    else:
        table = pathlib.Path(frame_table)
        position, thickness = _thicknesses(table)
        _check_table(table, lumen, z_mm, [position[number] for number in numbers])
        numbers = np.array(sorted(numbers, key=lambda number: position[number]))
        septum = np.array([thickness[number] for number in numbers]) * MM
    centroids = polygon_centroids(points)
    centred = points - centroids[:, None]
    towards = _aortic_directions(centred, np.asarray(lumen.s))
    if reference is not None:
        place = pathlib.Path(reference)
        number, point, height = _reference_point(place, numbers)
        k = int(np.flatnonzero(numbers == number)[0])
        _check_reference(place, number, point - centroids[k], height - z_mm[number])
        if (point - centroids[k]) @ towards[k] < 0.0:
            towards = -towards
    along = np.stack([-towards[:, 1], towards[:, 0]], axis=1)
    # The image plane (x, y) with z, which grows towards the ostium, is right-handed; so is
    # (u, v) with the downstream direction.
    u = -np.einsum("fpi,fi->fp", centred, towards)
    v = np.einsum("fpi,fi->fp", centred, along)
    sections = np.stack([u, v], axis=2)[:, ::-1]
    wall = None if external is None else read_external_wall(contours, external, numbers)
    return Pullback(np.asarray(lumen.s), sections, septum, reference is not None, wall)


def _aortic_directions(
    centred: Float[np.ndarray, "frames points 2"], s: Float[np.ndarray, " frames"]
) -> Float[np.ndarray, "frames 2"]:
    """Unit vector across each slit; of the two, the one that turns least from frame to frame."""
    moments = np.einsum("fpi,fpj->fij", centred, centred)
    values, vectors = np.linalg.eigh(moments)
    ellipticity = np.sqrt(values[:, 1] / values[:, 0])
    directed = np.flatnonzero(ellipticity >= _DIRECTED_ELLIPTICITY)
    if len(directed) == 0:
        directed = np.array([int(np.argmax(ellipticity))])
    across = vectors[directed, :, 0]
    angle = np.unwrap(np.arctan2(across[:, 1], across[:, 0]), period=np.pi)
    angles = np.interp(s, s[directed], angle)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def _rows(path: pathlib.Path) -> list[list[str]]:
    lines = read_separated(path, "\t").splitlines()
    return [line.split("\t") for line in lines if line.strip()]


def _check_length(path: pathlib.Path, length_mm: float, what: str) -> None:
    """Refuse a pullback that is too short or too long for a coronary in mm."""
    low, high = _LENGTH_RANGE_MM
    if not low <= length_mm <= high:
        guess = " Is it in cm? Then multiply by 10." if length_mm < low else " Is it in µm?"
        raise ValueError(
            f"{path}: {what} {length_mm:g} mm, where a pullback of a coronary is {low:g} to"
            f" {high:g} mm long.{guess}"
        )


def _check_table(
    path: pathlib.Path, lumen: Lumen, z_mm: dict[int, float], positions_mm: list[float]
) -> None:
    """Refuse a frame table whose lengths or areas are not those of the contours."""
    span, height = float(np.ptp(positions_mm)), float(np.ptp(list(z_mm.values())))
    if not height / _LENGTHS_APART <= span <= height * _LENGTHS_APART:
        guess = "Is the table in cm? Then multiply position and measurement_1 by 10"
        if span > height:
            guess = "Is it in µm, or are the contours in cm"
        raise ValueError(
            f"{path}: positions span {span:g} mm, z of the contours {height:g} mm."
            f" {guess}; or take the frame table of the same pullback."
        )
    stated = {int(float(r["frame"])): r.get("lumen_area", "") for _, r in read_table(path)}
    along = [number for _, number in sorted(zip(positions_mm, z_mm, strict=True))]
    own = dict(zip(along, (np.asarray(lumen.area) / MM**2).tolist(), strict=True))
    ratios = [float(text) / own[n] for n, text in stated.items() if n in own and _is_number(text)]
    middle = float(np.median(ratios)) if ratios else 1.0
    if not 1.0 / _AREAS_APART <= middle <= _AREAS_APART:
        raise ValueError(
            f"{path}: lumen_area is {middle:.2g} times that of the contours. Is it in cm² (the"
            " table is to be in mm and mm²)? Or take the frame table of the same pullback."
        )


def _is_number(text: str) -> bool:
    try:
        return float(text) > 0.0
    except ValueError:
        return False


def _check_reference(
    path: pathlib.Path, number: int, offset_cm: Float[np.ndarray, " 2"], slip_mm: float
) -> None:
    """Refuse a reference point that cannot lie in the aortic wall beside its frame."""
    distance = float(np.hypot(*offset_cm)) / MM
    if distance > _REFERENCE_REACH_MM:
        raise ValueError(
            f"{path}: the reference point lies {distance:.3g} mm from the middle of frame"
            f" {number}. Give a point in the wall of the aorta beside the frame, in mm."
        )
    if abs(slip_mm) > _REFERENCE_SLIP_MM:
        raise ValueError(
            f"{path}: the reference point lies {abs(slip_mm):.3g} mm along the pullback from its"
            f" frame {number}. Is it in cm? Give x, y and z in mm, with the z of the frame."
        )


def _thicknesses(path: pathlib.Path) -> tuple[dict[int, float], dict[int, float]]:
    """Position and tissue thickness [mm] of each frame of the table."""
    position: dict[int, float] = {}
    thickness: dict[int, float] = {}
    faults: list[str] = []
    low, high = _THICKNESS_RANGE_MM
    for line, row in read_table(path):
        number = int(float(row["frame"]))
        position[number] = float(row["position"])
        text = row.get(_THICKNESS_COLUMN, "").strip()
        try:
            thickness[number] = float(text) if text else np.nan
        except ValueError:
            faults.append(f"line {line}: {_THICKNESS_COLUMN} {text[:40]!r}")
            continue
        if text and not low <= thickness[number] <= high:
            faults.append(f"line {line}: {_THICKNESS_COLUMN} = {text[:40]} mm")
    if len(faults) > _MOST_SHOWN:
        faults[_MOST_SHOWN:] = [f"and {len(faults) - _MOST_SHOWN} more"]
    if faults:
        raise ValueError(
            f"{path}: {'; '.join(faults)}. The tissue between aorta and lumen must be a number"
            f" within {low:g}..{high:g} mm, or empty."
        )
    measured = [value for value in thickness.values() if np.isfinite(value)]
    if measured and np.median(measured) < _USUAL_THICKNESS_MM:
        raise ValueError(
            f"{path}: {_THICKNESS_COLUMN} is {np.median(measured):g} mm in the middle; tissue"
            " between two lumens is thicker. Is it in cm? Then multiply by 10."
        )
    return position, thickness


def _reference_point(
    path: pathlib.Path, numbers: Int[np.ndarray, " frames"]
) -> tuple[int, Float[np.ndarray, " 2"], float]:
    """Frame, point [cm] and height z [mm]."""
    rows = _rows(path)
    hint = "Expected one line: frame number, x, y, z in mm, separated by tabs or commas."
    if len(rows) != 1 or len(rows[0]) != 4:
        raise ValueError(f"{path}: {len(rows)} lines instead of one reference point. {hint}")
    try:
        number, x, y, z = (float(field) for field in rows[0])
    except ValueError as error:
        raise ValueError(f"{path}: {_shown(rows[0])} is not four numbers. {hint}") from error
    if not np.all(np.isfinite([number, x, y, z])):
        raise ValueError(f"{path}: {_shown(rows[0])} is not four finite numbers. {hint}")
    if number not in numbers:
        raise ValueError(
            f"{path}: frame {number:g} is not among the contours."
            " Use the reference point of the same pullback."
        )
    return int(number), np.array([x, y]) * MM, z


def _shown(fields: list[str]) -> str:
    return repr(" ".join(fields)[:60])
