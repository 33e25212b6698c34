"""Element size over space: fine in narrow lumens and thin walls, growing away from them.

At the lumen's surface::

    h₀ = k · min(a · local radius, b · thickness of the solid behind),   h₀ ≤ 2 · radius / n,

where n elements across the minor axis are asked for, there and down to the middle of the lumen.
Elsewhere h(x) = minᵢ (h₀(xᵢ) + g |x − xᵢ|),
so that h is Lipschitz with the growth g. The scale k follows from the number of tetrahedra that a
preset aims at, by a law fitted to meshes of 20 000 to 400 000 tetrahedra::

    N = c S^0.84,   S = 9 ∫ h⁻³ dV + 11 ∫ h⁻² max(1, t/2h) dA,

with dV = (1 − s/r) ds dA at the depth s under the surface, and h⁻² the mean of the wall's two
surfaces, t apart, between which at least two layers lie.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from jaxfsi.anatomy import Anatomy
from jaxfsi.measures import triangle_areas
from jaxfsi.meshing.surface.isosurface import Surface
from jaxfsi.meshing.surface.projection import gradients

_PER_RADIUS = 0.5
_PER_THICKNESS = 1.5
_GROWTH = 0.35
_BINS = 12
_SAMPLES = 6000
_DEPTHS = 8
_BISECTIONS = 14
_TETS_PER_FLUID = 9.0
_TETS_PER_WALL = 11.0
_TETS_SCALE, _TETS_POWER = 5.93, 0.84
# Fewer elements than this across the lumen no longer show its shape.
_LEAST_ACROSS = 3.0
# Edges of a remeshed region are longer than the size asked for by up to this on average.
_SLACK = 0.85


class SizeField(NamedTuple):
    """Element sizes at points of the lumen's surface, and how they grow away from there.

    Attributes:
        trees: points of similar size, one tree for each range of sizes.
        sizes: element size at the points of each tree [cm].
        growth: increase of the size per distance.
        largest: bound of the size [cm].
    """

    trees: tuple[KDTree, ...]
    sizes: tuple[Float[np.ndarray, " _"], ...]
    growth: float
    largest: float


def size_at(field: SizeField, x: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, " points"]:
    """Element size at some points [cm]."""
    size = np.full(len(x), field.largest)
    for tree, sizes in zip(field.trees, field.sizes, strict=True):
        reach = (field.largest - sizes.min()) / field.growth
        found = tree.query(x, distance_upper_bound=max(reach, 1e-12))
        distance, index = (np.asarray(part) for part in found)
        near = np.isfinite(distance)
        size[near] = np.minimum(size[near], sizes[index[near]] + field.growth * distance[near])
    return size


def grown_field(
    points: Float[np.ndarray, "points 3"],
    sizes: Float[np.ndarray, " points"],
    *,
    growth: float = _GROWTH,
) -> SizeField:
    """The field that takes given sizes at points, or less where a neighbour asks for less."""
    ends = np.geomspace(sizes.min(), sizes.max() * (1.0 + 1e-9), _BINS + 1)
    which = np.clip(np.searchsorted(ends, sizes, side="right") - 1, 0, _BINS - 1)
    used = [np.flatnonzero(which == i) for i in np.unique(which)]
    return SizeField(
        trees=tuple(KDTree(points[rows]) for rows in used),
        sizes=tuple(sizes[rows] for rows in used),
        growth=growth,
        largest=float(sizes.max()),
    )


def solid_depth(
    anatomy: Anatomy,
    points: Float[np.ndarray, "points 3"],
    normals: Float[np.ndarray, "points 3"],
    *,
    limit: float,
) -> Float[np.ndarray, " points"]:
    """Way through the solid from the lumen's surface along its outward normal [cm].

    The way ends outside the wall or in another lumen. Each step is the distance to the nearer of
    the two (sphere tracing, Hart 1996), at least a hundredth of the way still possible.

    Args:
        anatomy: what is traced.
        points: start, on L = 0 [cm].
        normals: unit normals out of the lumen.
        limit: longest way [cm].

    Raises:
        ValueError: the anatomy gives no number at some place.
    """
    least = 0.01 * limit
    way = np.full(len(points), least)
    moving = np.arange(len(points))
    while len(moving):
        x = points[moving] + way[moving, None] * normals[moving]
        room = np.minimum(anatomy.lumen(x), -anatomy.wall(x))
        _check_numbers(anatomy, "lumen or wall", room, x)
        # A step back onto the surface ends the way of a ray that has left the solid.
        done = (room <= 0.0) | (way[moving] >= limit)
        way[moving] += np.where(room <= 0.0, np.maximum(room, -least), 0.0)
        way[moving[~done]] += np.maximum(room[~done], least)
        moving = moving[~done]
    return np.clip(way, 1e-3 * limit, limit)


def _check_numbers(
    anatomy: Anatomy,
    what: str,
    values: Float[np.ndarray, " points"],
    x: Float[np.ndarray, "points 3"],
) -> None:
    """Refuse an anatomy with functions that are no numbers at points x."""
    bad = np.flatnonzero(np.isnan(values))
    if len(bad):
        where = ", ".join(f"{v:.3g}" for v in x[bad[0]])
        raise ValueError(
            f"{what} of {anatomy.name!r} is not a number at {len(bad)} of {len(x)} places, first at"
            f" ({where}) cm. Give functions that hold wherever its bounds reach."
        )


class SurfaceSamples(NamedTuple):
    """Points of the lumen's surface with what sets the element size there.

    Attributes:
        points: positions on L = 0 [cm].
        normals: unit normals out of the lumen.
        radius: half the local width of the lumen [cm].
        depth: way through the solid behind the point [cm].
        area: area that the point stands for [cm²].
    """

    points: Float[np.ndarray, "points 3"]
    normals: Float[np.ndarray, "points 3"]
    radius: Float[np.ndarray, " points"]
    depth: Float[np.ndarray, " points"]
    area: Float[np.ndarray, " points"]


def sample_surface(anatomy: Anatomy, surface: Surface) -> SurfaceSamples:
    """Sample the part of the lumen's surface that lies inside the openings.

    Raises:
        ValueError: the anatomy gives no number at some place.
    """
    a, b, c = (surface.points[surface.triangles[:, i]] for i in range(3))
    area = triangle_areas(*surface)
    centre = (a + b + c) / 3.0
    kept = ~beyond_openings(anatomy, centre)
    area, centre = area[kept], centre[kept]
    # Every n-th triangle of a list that follows space stands for n of them.
    stride = max(len(area) // _SAMPLES, 1)
    rows = np.arange(0, len(area), stride)
    area = np.add.reduceat(area, rows)
    points = centre[rows]
    radius = np.asarray(anatomy.local_radius(points))
    _check_numbers(anatomy, "local_radius", radius, points)
    slope = gradients(anatomy.lumen, points, step=1e-3)
    norm = np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-12)
    normals = slope / norm
    points = points - anatomy.lumen(points)[:, None] * slope / norm**2
    thickness = np.asarray(anatomy.thickness(points))
    _check_numbers(anatomy, "thickness", thickness, points)
    limit = 2.0 * float(np.max(thickness))
    depth = solid_depth(anatomy, points, normals, limit=limit)
    return SurfaceSamples(points, normals, radius, depth, area)


def beyond_openings(
    anatomy: Anatomy, points: Float[np.ndarray, "points 3"]
) -> "np.ndarray[tuple[int], np.dtype[np.bool_]]":
    """Whether points lie in the vessel that goes on outside an opening."""
    beyond = np.zeros(len(points), dtype=bool)
    for opening in anatomy.openings:
        from_centre = points - opening.centre
        height = from_centre @ opening.normal
        aside = np.linalg.norm(from_centre - height[:, None] * opening.normal, axis=1)
        beyond |= (height > 0.0) & (aside < opening.radius)
    return beyond


def choose_sizes(
    samples: SurfaceSamples,
    *,
    target: int,
    elements_across: int | None = None,
    wall_layers: int = 2,
) -> SizeField:
    """The size field whose mesh has about ``target`` tetrahedra.

    Args:
        samples: of the lumen's surface.
        target: number of tetrahedra aimed at; `elements_across` and `wall_layers` go first.
        elements_across: least number of elements across the local width of the lumen.
        wall_layers: layers through the wall; more than two bound the size by the thickness.
    """
    low, high = np.log(0.05), np.log(8.0)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        field = _scaled(samples, float(np.exp(middle)), elements_across, wall_layers)
        if predicted_tets(field, samples) > target:
            low = middle
        else:
            high = middle
    return _scaled(samples, float(np.exp(high)), elements_across, wall_layers)


def _scaled(
    samples: SurfaceSamples, scale: float, elements_across: int | None, wall_layers: int
) -> SizeField:
    size = scale * np.minimum(_PER_RADIUS * samples.radius, _PER_THICKNESS * samples.depth)
    size = np.minimum(size, 2.0 * samples.radius / _LEAST_ACROSS)
    if wall_layers > 2:
        size = np.minimum(size, 1.3 * samples.depth / wall_layers)
    if elements_across is None:
        return grown_field(samples.points, size)
    # Inside the lumen sizes must not grow either: points down to its middle ask for the same.
    across = _SLACK * 2.0 * samples.radius / elements_across
    below = [
        samples.points - share * samples.radius[:, None] * samples.normals
        for share in (0.25, 0.5, 0.75, 1.0)
    ]
    return grown_field(
        np.concatenate([samples.points, *below]),
        np.concatenate([np.minimum(size, across), *([across] * len(below))]),
    )


def predicted_tets(field: SizeField, samples: SurfaceSamples) -> float:
    """About how many tetrahedra blood and wall will have."""
    nodes, weights = np.polynomial.legendre.leggauss(_DEPTHS)
    share = 0.5 * (nodes + 1.0)
    size = size_at(field, samples.points)
    s = samples.radius[:, None] * share
    below = np.minimum(size[:, None] + field.growth * s, field.largest)
    column = samples.radius * ((1.0 - share) * below**-3.0 @ (0.5 * weights))
    outside = np.minimum(size + field.growth * samples.depth, field.largest)
    layers = np.maximum(1.0, 0.5 * samples.depth / size)
    wall = 0.5 * samples.area * layers * (size**-2.0 + outside**-2.0)
    count = np.sum(_TETS_PER_FLUID * samples.area * column + _TETS_PER_WALL * wall)
    return float(_TETS_SCALE * count**_TETS_POWER)
