"""The anatomy of a patient from a segmented lumen: any triangulated surface.

The surface is cleaned (`triangles`), its ends are found (`flat_ends`), it is smoothed without
shrinking and carried on beyond its ends (`surface_edits`); the lumen function is the signed
distance to the result (`surface_distance`).

The wall is offset by a thickness that follows the local radius (`walled_surface`, `medial`).
"""

import dataclasses
import os
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Literal, NamedTuple

import numpy as np
import scipy.sparse
import scipy.spatial
from jaxtyping import Bool, Float

from jaxfsi.anatomy.anatomy import MARGIN, OPENING_BALL, OVERRUN, Anatomy, Centerline, Opening
from jaxfsi.anatomy.sources.ct_course import smoothed
from jaxfsi.anatomy.surfaces.crossings import crossing_faces
from jaxfsi.anatomy.surfaces.edits import (
    extended_and_closed,
    refined,
    taubin_smoothed,
    with_flat_loops,
)
from jaxfsi.anatomy.surfaces.end_names import (
    AORTA_INLET,
    AORTA_OUTLET,
    inlet_of,
    middles,
    named_ends,
)
from jaxfsi.anatomy.surfaces.flat_ends import FlatEnd, ends_of, open_ends, outwards, without_caps
from jaxfsi.anatomy.surfaces.medial import medial_path, medial_radius
from jaxfsi.anatomy.surfaces.triangles import (
    Triangles,
    check_span,
    cleaned,
    edges_of,
    read_triangles,
)
from jaxfsi.anatomy.surfaces.walled_surface import (
    WalledSurface,
    local_radius,
    local_thickness,
    lumen_distance,
    wall_distance,
    walled_surface,
)
from jaxfsi.anatomy.wall import thickness_from_radius
from jaxfsi.measures import edge_lengths, enclosed_volume
from jaxfsi.mesh_files import Axes, stated_axes, turned
from jaxfsi.opening import ANOMALOUS, canonically_ordered

Unit = Literal["mm", "cm", "m"]

_CM: dict[str, float] = {"mm": 0.1, "cm": 1.0, "m": 100.0}
_LONG = 2.0  # of the continuations for radii, over the radius
_LARGEST = 300.0  # from the middle of the surface to its farthest corner [cm]
_LONGEST = 3.0  # edge over the median one
_CROSSING = 1e-9  # of the cube of the longest edge, beyond which triangles cross
_OWN = 1.5  # way over the surface from an end to what belongs to it, over the radius of its ball
_AORTA_RADIUS = (0.3, 4.0)
_CORONARY_RADIUS = (0.03, 0.6)
_ALONE = ("inlet", "outlet", ANOMALOUS)  # begin the names of ends of a coronary without the aorta
_LINE_STEP = 0.05
_LINE_SMOOTHING = 0.2
_AORTIC = 0.6  # radius over that of the aorta below which a path is a branch


@dataclasses.dataclass(frozen=True)
class SurfaceOptions:
    """How a surface becomes an anatomy.

    Attributes:
        smoothing_steps: pairs of Taubin steps; 0 keeps the surface as it is.
        thickness_per_radius: wall thickness over local radius.
        thickness_minimum: least wall thickness [cm].
        thickness_maximum: greatest wall thickness [cm].
        radius_range: in which the radius of the largest opening must lie [cm]; catches units
            that are wrong by a factor of ten. None: that of an aorta, or of a coronary artery
            where every end is named ``inlet``, ``outlet...`` or ``anomalous...``.
    """

    smoothing_steps: int = 10
    thickness_per_radius: float = 0.1
    thickness_minimum: float = 0.05
    thickness_maximum: float = 0.15
    radius_range: tuple[float, float] | None = None


class Cut(NamedTuple):
    """A plane where a vessel without a flat end shall be cut, in the unit of the surface.

    Attributes:
        centre: a point inside the vessel.
        normal: direction out of the domain.
        radius: of the vessel there.
    """

    centre: Sequence[float]
    normal: Sequence[float]
    radius: float


def surface_anatomy(
    surface: str | os.PathLike[str] | Triangles,
    *,
    unit: Unit,
    names: Mapping[str, Sequence[float]] | None = None,
    cuts: Mapping[str, Cut] | None = None,
    axes: Axes | None = None,
    options: SurfaceOptions | None = None,
) -> Anatomy:
    """Lumen and wall of a patient from a segmented lumen surface.

    Args:
        surface: STL, PLY, OBJ or VTP file, or triangles. Vessel ends are flat: open or capped.
        unit: of its coordinates.
        names: a point near the middle of each end by the name it shall have, in the unit of the
            surface. Default: the two largest ends are the aorta, the one nearer to the others its
            inlet (of two ends only, the lower one); one more is ``anomalous_outlet``, several
            more ``coronary_outlet_1``, ... from the largest.
        cuts: further openings by name, where a vessel ends round.
        axes: of names and cuts. A file that states others is turned to these; the result's
            ``meta`` says so.
        options: smoothing, wall thickness and plausible sizes.

    Returns:
        The anatomy, in cm in the coordinates of the surface, or in ``axes``.

    Raises:
        ValueError: the surface cannot be repaired; says why and what to change.
    """
    options = SurfaceOptions() if options is None else options
    if unit not in _CM:
        raise ValueError(f"{unit!r} is not a known unit. Use one of {', '.join(_CM)}.")
    given, notes = surface, []
    if not isinstance(given, Triangles):
        given, notes = _in_axes(given, axes)
    if len(given.faces) == 0:
        raise ValueError("the surface holds no triangles. Export it again.")
    scale = _CM[unit]
    scaled = Triangles(scale * given.points, given.faces)
    check_span(scaled, _LARGEST)
    body, ends = _opened(scaled)
    _check_ends(ends, names or {}, cuts or {}, options, unit)
    smooth, longest = _smooth(body, ends, options.smoothing_steps)
    ends = ends_of(smooth)
    closed = refined(extended_and_closed(smooth, ends, OVERRUN, step=longest), longest)
    radius = _radius(smooth, ends, closed, longest)
    thickness = _thickness(closed, radius, ends, options)
    walled = walled_surface(closed, radius, thickness)
    named = named_ends(ends, names, scale)
    openings = _openings(closed, named, radius, thickness) + _cut_openings(
        cuts or {}, scale, walled
    )
    return Anatomy(
        name="surface" if isinstance(surface, Triangles) else os.path.basename(surface),
        lumen=partial(lumen_distance, walled),
        wall=partial(wall_distance, walled),
        local_radius=partial(local_radius, walled),
        thickness=partial(local_thickness, walled),
        openings=canonically_ordered(openings),
        bounds=_bounds(smooth, float(np.max(thickness))),
        centerlines=_centerlines(closed, radius, named),
        meta={
            "source": "surface",
            "unit": unit,
            "triangles": len(given.faces),
            **({"notes": notes} if notes else {}),
            "options": dataclasses.asdict(options),
        }
        | _change(body, smooth),
    )


def _in_axes(path: str | os.PathLike[str], axes: Axes | None) -> tuple[Triangles, list[str]]:
    """The triangles of a file in the wanted axes, and what was done to get them there."""
    found = read_triangles(path)
    said = stated_axes(path)
    if axes is None or said is None or said == axes:
        return found, []
    note = (
        f"{os.path.basename(path)} is in {said}; it was turned to {axes}, the axes of the case:"
        " x and y changed their signs"
    )
    return Triangles(turned(found.points, said, axes), found.faces), [note]


def _opened(surface: Triangles) -> tuple[Triangles, list[FlatEnd]]:
    """The cleaned surface without caps, and its ends."""
    whole, _ = open_ends(outwards(cleaned(surface)))
    return without_caps(whole)


def _smooth(body: Triangles, ends: list[FlatEnd], steps: int) -> tuple[Triangles, float]:
    """The smoothed surface with flat loops, and its longest edge [cm]."""
    loops = np.concatenate([np.zeros(0, dtype=np.int64), *(end.loop for end in ends)])
    smooth = taubin_smoothed(with_flat_loops(body, ends), steps, fixed=loops)
    longest = _LONGEST * float(np.median(edge_lengths(smooth.points, edges_of(smooth.faces).ends)))
    smooth = refined(smooth, longest)
    _check_crossings(smooth)
    return smooth, longest


def _change(body: Triangles, smooth: Triangles) -> dict[str, object]:
    """Volumes [cm³] before and after smoothing, and the largest move of a point [cm]."""
    moves = smooth.points[: len(body.points)] - body.points
    return {
        "volume": enclosed_volume(*extended_and_closed(body, ends_of(body), 0.0)),
        "smoothed_volume": enclosed_volume(*extended_and_closed(smooth, ends_of(smooth), 0.0)),
        "largest_move": float(np.max(np.linalg.norm(moves, axis=1))),
    }


def _check_ends(
    ends: Sequence[FlatEnd],
    names: Mapping[str, Sequence[float]],
    cuts: Mapping[str, Cut],
    options: SurfaceOptions,
    unit: Unit,
) -> None:
    if len(ends) + len(cuts) < 2:
        raise ValueError(
            f"{len(ends)} caps were found on the surface, at least two are needed (an inlet and an"
            " outlet). Cut the vessel ends flat in the segmentation tool, or say where to cut"
            " (cuts)."
        )
    radii = [end.radius for end in ends] + [_CM[unit] * cut.radius for cut in cuts.values()]
    alone = "inlet" in names and all(name.startswith(_ALONE) for name in names)
    low, high = options.radius_range or (_CORONARY_RADIUS if alone else _AORTA_RADIUS)
    if not low <= max(radii) <= high:
        other, cure = "there is no aorta", "a coronary artery alone, name its ends inlet and outlet"
        if alone:
            other, cure = "there is an aorta", "an aorta, name its ends aorta_inlet, aorta_outlet"
        raise ValueError(
            f"the largest opening has a radius of {max(radii):.3g} cm, expected {low:g}..{high:g}"
            f" cm: the unit ({unit}) is probably wrong, or {other}. Give the unit of the"
            f" coordinates; of {cure} ([anatomy.openings] in a case). The ends lie at"
            f" {middles(ends, _CM[unit])}."
        )


def _check_crossings(surface: Triangles) -> None:
    """Refuse what still crosses after smoothing, which has healed folds of single triangles."""
    found = crossing_faces(surface.points, surface.faces, tolerance=_CROSSING)
    if len(found):
        pairs = np.unique(np.sort(found, axis=1), axis=0)
        place = surface.points[surface.faces[pairs[0, 0]]].mean(axis=0)
        where = ", ".join(f"{x:.3g}" for x in place)
        raise ValueError(
            f"the surface intersects itself: {len(pairs)} pairs of triangles cross, first near"
            f" ({where}) cm. Remesh or smooth the segmentation there."
        )


def _beyond(points: Float[np.ndarray, "points 3"], end: FlatEnd) -> Bool[np.ndarray, " points"]:
    """Points of the continuation of an end."""
    offset = points - end.centre
    height = offset @ end.normal
    across = np.linalg.norm(offset - height[:, None] * end.normal, axis=1)
    return (height > 0.0) & (across <= 1.01 * _reach(points, end))


def _reach(points: Float[np.ndarray, "points 3"], end: FlatEnd) -> float:
    return float(np.max(np.linalg.norm(points[end.loop] - end.centre, axis=1)))


def _radius(
    body: Triangles, ends: list[FlatEnd], closed: Triangles, step: float
) -> Float[np.ndarray, " points"]:
    """Local radius at the points of the closed surface.

    It is found with continuations so long that no ball of the body touches their flat faces;
    points of the shorter continuations take the value of the nearest point of the body.
    """
    length = max((_LONG * _reach(body.points, end) for end in ends), default=0.0)
    long = extended_and_closed(body, ends, length, step=step)
    radius = medial_radius(long)[: len(body.points)]
    _, near = scipy.spatial.KDTree(body.points).query(closed.points)
    return radius[near]


def _thickness(
    surface: Triangles,
    radius: Float[np.ndarray, " points"],
    ends: Sequence[FlatEnd],
    options: SurfaceOptions,
) -> Float[np.ndarray, " points"]:
    thickness = thickness_from_radius(
        radius,
        factor=options.thickness_per_radius,
        minimum=options.thickness_minimum,
        maximum=options.thickness_maximum,
    )
    for end in ends:
        wall = float(np.median(thickness[end.loop]))
        if wall > end.radius:
            raise ValueError(
                f"a wall of {wall:.2g} cm is thicker than the vessel's radius of"
                f" {end.radius:.2g} cm. Lower thickness_minimum or thickness_per_radius (units are"
                " cm)."
            )
    return thickness


def _openings(
    surface: Triangles,
    named: Mapping[str, FlatEnd],
    radius: Float[np.ndarray, " points"],
    thickness: Float[np.ndarray, " points"],
) -> tuple[Opening, ...]:
    """A plane at each end, in a ball that holds its own vessel only."""
    edges = edges_of(surface.faces).ends
    length = np.linalg.norm(surface.points[edges[:, 0]] - surface.points[edges[:, 1]], axis=1)
    n = len(surface.points)
    graph = scipy.sparse.csr_array((length, (edges[:, 0], edges[:, 1])), shape=(n, n))
    openings = []
    for name, end in named.items():
        ball = OPENING_BALL * (_reach(surface.points, end) + float(np.max(thickness[end.loop])))
        away = np.linalg.norm(surface.points - end.centre, axis=1) - thickness
        along = scipy.sparse.csgraph.dijkstra(
            graph, directed=False, indices=end.loop, min_only=True, limit=_OWN * ball
        )
        own = np.isfinite(along) | _beyond(surface.points, end)
        if np.any((away < ball) & ~own):
            raise ValueError(
                f"another part of the anatomy lies within {ball:.2g} cm of the end {name!r}, whose"
                " wall would be cut with it. Cut the vessel farther from its neighbours."
            )
        openings.append(Opening(name, end.centre, end.normal, ball))
    return tuple(openings)


def _cut_openings(
    cuts: Mapping[str, Cut], scale: float, walled: WalledSurface
) -> tuple[Opening, ...]:
    openings = []
    for name, cut in cuts.items():
        centre = scale * np.array(cut.centre, dtype=float)
        normal = np.array(cut.normal, dtype=float)
        if lumen_distance(walled, centre[None])[0] >= 0.0 or not np.linalg.norm(normal) > 0.0:
            raise ValueError(
                f"the cut {name!r} has no direction or its centre lies outside the lumen. Give a"
                " point inside the vessel, in the unit of the surface."
            )
        ball = OPENING_BALL * (scale * cut.radius + float(local_thickness(walled, centre[None])[0]))
        openings.append(Opening(name, centre, normal / np.linalg.norm(normal), ball))
    return tuple(openings)


def _bounds(surface: Triangles, thickness: float) -> Float[np.ndarray, "2 3"]:
    margin = thickness + MARGIN
    return np.stack([surface.points.min(axis=0) - margin, surface.points.max(axis=0) + margin])


def _centerlines(
    surface: Triangles, radius: Float[np.ndarray, " points"], named: Mapping[str, FlatEnd]
) -> dict[str, Centerline]:
    """The way from the inlet to each other end; of branches of an aorta, from where they leave it.

    See `jaxfsi.anatomy.surfaces.end_names.inlet_of` for which end is the inlet. A cut is no end: a
    surface without flat ends has no lines.
    """
    lines: dict[str, Centerline] = {}
    if not named:
        return lines
    first = inlet_of(named)
    inlet = named[first]
    for name, end in named.items():
        if name == first:
            continue
        points, size = medial_path(surface, radius, inlet.loop, end.loop)
        leaves_aorta = first == AORTA_INLET and name != AORTA_OUTLET
        if leaves_aorta:
            wide = np.flatnonzero(size > _AORTIC * inlet.radius)
            points = points[wide[-1] + 1 if len(wide) else 0 :]
        points = np.concatenate([points, end.centre[None]])
        if not leaves_aorta:
            points = np.concatenate([inlet.centre[None], points])
        points = _evenly(points, _LINE_STEP)
        if len(points) > 2:
            points = smoothed(points, _LINE_SMOOTHING / _LINE_STEP)
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        lines[name.removesuffix("_outlet")] = Centerline(
            points, np.concatenate([[0.0], np.cumsum(steps)])
        )
    return lines


def _evenly(points: Float[np.ndarray, "n 3"], spacing: float) -> Float[np.ndarray, "m 3"]:
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    s = np.linspace(0.0, length[-1], max(int(length[-1] / spacing) + 1, 2))
    return np.stack([np.interp(s, length, points[:, i]) for i in range(3)], axis=1)
