"""Structured tubes: blood in a wall of any number of layers, straight or mapped to another shape.

The section is a disc of concentric rings with evenly spaced nodes, surrounded by the layers of the
wall; it is drawn along z and its prisms are cut into tetrahedra. No mesher is needed. Nodes lie
exactly on the radii, so that the volume of the inscribed polygon is short of the cylinder's by
1 − sin(2π/n)/(2π/n).
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from jaxfsi.faces import boundary_of
from jaxfsi.mesh import Mesh, Region, tet_volumes
from jaxfsi.mesh_parts import submesh
from jaxfsi.meshing.labels import label_faces
from jaxfsi.meshing.structured.prisms import PlaneMesh, extruded, in_columns, strip_between
from jaxfsi.opening import Opening

PointMap = Callable[[Float[np.ndarray, "points 3"]], Float[np.ndarray, "points 3"]]

_LEAST_AROUND = 3
_ROUND_CENTRE = 6  # nodes that fit round a centre with near-equilateral triangles


def tube(
    *,
    radius: float,
    length: float,
    thickness: float,
    n_around: int,
    n_axial: int,
    n_layers: int = 2,
    n_rings: int | None = None,
    mapping: PointMap | None = None,
    columns: bool = False,
) -> Mesh:
    """A tube of blood along z from the opening ``inlet`` at z = 0 to ``outlet`` at z = length.

    Args:
        radius: of the lumen [cm].
        length: of the tube [cm].
        thickness: of the wall [cm]; ignored without layers.
        n_around: edges round the lumen.
        n_axial: elements along the axis.
        n_layers: layers of elements through the wall; 0 for a tube without a wall.
        n_rings: rings of elements from the axis to the lumen's surface; None: as many as make
            near-equilateral triangles.
        mapping: moves the points of the straight tube to another shape, such as `bent`.
        columns: build the wall in columns on the lumen's triangles, so that it has wedges.

    Returns:
        The labelled mesh.

    Raises:
        ValueError: a size or count is out of range, or the mapping turns tetrahedra inside out.
    """
    _check_sizes(radius=radius, length=length, thickness=thickness if n_layers else 1.0)
    _check_counts(n_around=n_around, n_axial=n_axial, n_layers=n_layers, n_rings=n_rings)
    in_section = 0 if columns else n_layers
    section = _tube_section(radius, thickness, n_around, in_section, n_rings)
    points, tets, region = extruded(section, np.linspace(0.0, length, n_axial + 1))
    wedges = np.zeros((0, 6), dtype=np.int64)
    if columns and n_layers:
        points, tets, region, wedges = _with_wall(points, tets, radius, thickness, n_layers)
    outer = radius + (thickness if n_layers else 0.0)
    down, up = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0])
    openings = (
        Opening("inlet", np.zeros(3), down, 1.01 * outer),
        Opening("outlet", length * up, up, 1.01 * outer),
    )
    mesh = label_faces(points, tets, region, openings)
    return mapped(dataclasses.replace(mesh, wedges=wedges), mapping)


def _with_wall(
    points: Float[np.ndarray, "nodes 3"],
    tets: Int[np.ndarray, "tets 4"],
    radius: float,
    thickness: float,
    n_layers: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points, tetrahedra, regions and wedges of a tube of blood with layers of wall about it."""
    surface = boundary_of(tets)
    axial = np.ptp(points[surface][:, :, 2], axis=1) > 0.0
    foot, triangles = np.unique(surface[axial], return_inverse=True)
    heights = thickness / radius * np.arange(1, n_layers + 1) / n_layers
    outward = points[foot] * np.array([1.0, 1.0, 0.0])
    levels = points[foot] + heights[:, None, None] * outward
    points, wall, wedges = in_columns(triangles.reshape(-1, 3), levels, points, foot)
    region = np.repeat([int(Region.FLUID), int(Region.SOLID)], [len(tets), len(wall)])
    return points, np.concatenate([tets, wall]), region, wedges


def ring(
    *,
    radius: float,
    length: float,
    thickness: float,
    n_around: int,
    n_axial: int,
    n_layers: int = 2,
    mapping: PointMap | None = None,
    columns: bool = False,
) -> Mesh:
    """The wall of a `tube` alone, such as a short thick ring under pressure or pinched.

    Its labels are ``interface`` (inside), ``outer_wall``, ``inlet_ring`` and ``outlet_ring``.

    Args:
        radius: inner radius [cm].
        length: along z [cm].
        thickness: of the wall [cm].
        n_around: edges round the ring.
        n_axial: elements along z.
        n_layers: layers of elements through the wall.
        mapping: moves the points to another shape.
        columns: see `tube`.

    Raises:
        ValueError: a size or count is out of range, or the mapping turns tetrahedra inside out.
    """
    _check_counts(n_layers=n_layers, least_layers=1)
    whole = tube(
        radius=radius,
        length=length,
        thickness=thickness,
        n_around=n_around,
        n_axial=n_axial,
        n_layers=n_layers,
        n_rings=1,
        mapping=mapping,
        columns=columns,
    )
    return dataclasses.replace(submesh(whole, Region.SOLID).mesh, node_ids=None)


def mapped(mesh: Mesh, mapping: PointMap | None) -> Mesh:
    """The same mesh with its points moved.

    Args:
        mesh: any mesh.
        mapping: gives the new positions [cm] of points; None leaves them.

    Raises:
        ValueError: the mapping turns tetrahedra inside out.
    """
    if mapping is None:
        return mesh
    points = np.asarray(mapping(mesh.points), dtype=float)
    turned = dataclasses.replace(mesh, points=points)
    n_inverted = int(np.sum(tet_volumes(points, mesh.tets) <= 0.0))
    if n_inverted:
        raise ValueError(
            f"the mapping turns {n_inverted} of {len(mesh.tets)} tetrahedra inside out. Bend less"
            " sharply (the radius of the bend must exceed the tube's), or use smaller elements."
        )
    return turned


def bent(*, bend_radius: float) -> PointMap:
    """Map that bends the z axis into a circle about the y axis, towards +x.

    A point at (x, y, z) goes to the angle z / bend_radius on a circle of radius bend_radius − x;
    lengths on the axis are kept.

    Args:
        bend_radius: radius of the circle that the axis becomes [cm].
    """
    _check_sizes(bend_radius=bend_radius)

    def bend(points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 3"]:
        x, y, z = points.T
        angle, distance = z / bend_radius, bend_radius - x
        return np.stack(
            [bend_radius - distance * np.cos(angle), y, distance * np.sin(angle)], axis=1
        )

    return bend


def elliptic(*, axis_ratio: float, radius: float | None = None) -> PointMap:
    """Map that turns circles about z into ellipses of the same area, long axis along x.

    Args:
        axis_ratio: major over minor axis, 1 or more.
        radius: of the lumen, outside of which points keep their distance from it along its normal,
            so that the wall keeps its thickness [cm]; None: the wall is scaled with the lumen.
    """
    if not axis_ratio >= 1.0:
        raise ValueError(
            f"the ratio of major to minor axis is {axis_ratio}. Give a ratio of 1 or more."
        )
    stretch = np.array([np.sqrt(axis_ratio), 1.0 / np.sqrt(axis_ratio), 1.0])

    def squeeze(points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 3"]:
        if radius is None:
            return points * stretch
        axis = points * np.array([1.0, 1.0, 0.0])
        distance = np.linalg.norm(axis, axis=1, keepdims=True)
        outside = np.maximum(distance - radius, 0.0)
        outwards = axis / stretch
        outwards /= np.maximum(np.linalg.norm(outwards, axis=1, keepdims=True), 1e-300)
        inside = points - outside * axis / np.maximum(distance, 1e-300)
        return inside * stretch + outside * outwards

    return squeeze


def _tube_section(
    radius: float, thickness: float, n_around: int, n_layers: int, n_rings: int | None
) -> PlaneMesh:
    """Disc and wall; nodes run from the centre outwards, ring by ring."""
    if n_rings is None:
        n_rings = max(1, round(n_around / _ROUND_CENTRE))
    counts = np.full(n_rings + n_layers, n_around)
    inside = np.arange(1, n_rings + 1)
    counts[:n_rings] = np.maximum(_LEAST_AROUND, np.rint(n_around * inside / n_rings))
    radii = np.concatenate(
        [
            radius * inside / n_rings,
            radius + thickness * np.arange(1, n_layers + 1) / max(1, n_layers),
        ]
    )
    starts = np.concatenate([[1], 1 + np.cumsum(counts)])
    rings = [np.arange(starts[i], starts[i + 1]) for i in range(len(counts))]
    angles = np.concatenate([2.0 * np.pi * np.arange(count) / count for count in counts])
    rho = np.repeat(radii, counts)
    circle = np.stack([rho * np.cos(angles), rho * np.sin(angles)], axis=1)
    first = rings[0]
    fan = np.stack([np.zeros_like(first), first, np.roll(first, -1)], axis=1)
    bands = [strip_between(rings[i], rings[i + 1]) for i in range(len(rings) - 1)]
    triangles = np.concatenate([fan, *bands])
    n_wall = sum(len(band) for band in bands[n_rings - 1 :])
    region = np.full(len(triangles), int(Region.FLUID))
    region[len(triangles) - n_wall :] = int(Region.SOLID)
    return PlaneMesh(np.concatenate([np.zeros((1, 2)), circle]), triangles, region)


def _check_sizes(**sizes: float) -> None:
    bad = [f"{name} = {value}" for name, value in sizes.items() if not 0.0 < value < np.inf]
    if bad:
        raise ValueError(f"sizes must be positive: {', '.join(bad)}. Give lengths in cm.")


def _check_counts(
    *,
    n_around: int = _LEAST_AROUND,
    n_axial: int = 1,
    n_layers: int = 0,
    n_rings: int | None = None,
    least_layers: int = 0,
) -> None:
    faults = []
    if n_around < _LEAST_AROUND:
        faults.append(f"n_around = {n_around} is below {_LEAST_AROUND}")
    if n_axial < 1:
        faults.append(f"n_axial = {n_axial} is below 1")
    if n_layers < least_layers:
        faults.append(f"n_layers = {n_layers} is below {least_layers}")
    if n_rings is not None and n_rings < 1:
        faults.append(f"n_rings = {n_rings} is below 1")
    if faults:
        raise ValueError(f"no tube can be meshed: {', '.join(faults)}. Ask for more elements.")
