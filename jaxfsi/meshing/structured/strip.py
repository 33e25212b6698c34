"""A structured box of solid, such as a clamped strip for checking bending."""

import dataclasses

import numpy as np

from jaxfsi.faces import region_faces
from jaxfsi.mesh import Mesh, Region
from jaxfsi.meshing.labels import labelled_mesh
from jaxfsi.meshing.structured.prisms import PlaneMesh, extruded


def strip(
    *,
    length: float,
    width: float,
    thickness: float,
    n_length: int,
    n_width: int,
    n_layers: int,
) -> Mesh:
    """A solid box [0, length] × [0, width] × [0, thickness] with named sides.

    Its labels are ``x_min``, ``x_max``, ``y_min``, ``y_max``, ``z_min`` and ``z_max``; x runs
    along the strip, z through its thickness, in which direction its wedges are stacked.

    Args:
        length: along x [cm].
        width: along y [cm].
        thickness: along z [cm].
        n_length: elements along x.
        n_width: elements along y.
        n_layers: elements through the thickness.

    Raises:
        ValueError: a size or a count is not positive.
    """
    size = np.array([length, width, thickness], dtype=float)
    counts = (n_length, n_width, n_layers)
    if not (np.all(size > 0.0) and np.all(np.isfinite(size)) and min(counts) >= 1):
        raise ValueError(
            f"no strip of {length} x {width} x {thickness} cm with {n_length} x {n_width} x"
            f" {n_layers} elements can be meshed. Give positive lengths and counts."
        )
    section = _rectangle(length, width, n_length, n_width)
    points, tets, region = extruded(section, np.linspace(0.0, thickness, n_layers + 1))
    bounds = region_faces(tets, region).solid
    corners = points[bounds]
    groups = {
        f"{axis}_{end}": bounds[np.all(corners[:, :, i] == value, axis=1)]
        for i, axis in enumerate("xyz")
        for end, value in (("min", 0.0), ("max", size[i]))
    }
    n = len(section.points)
    triangles = np.concatenate([section.triangles + n * k for k in range(n_layers)])
    mesh = labelled_mesh(points, tets, region, groups)
    return dataclasses.replace(mesh, wedges=np.concatenate([triangles, triangles + n], axis=1))


def _rectangle(length: float, width: float, n_length: int, n_width: int) -> PlaneMesh:
    """Squares cut along alternating diagonals, so that neither direction is favoured."""
    x, y = np.meshgrid(
        np.linspace(0.0, length, n_length + 1), np.linspace(0.0, width, n_width + 1), indexing="ij"
    )
    node = np.arange(x.size).reshape(x.shape)
    a, b = node[:-1, :-1].reshape(-1), node[1:, :-1].reshape(-1)
    c, d = node[1:, 1:].reshape(-1), node[:-1, 1:].reshape(-1)
    i, j = np.indices((n_length, n_width)).reshape(2, -1)
    rising = ((i + j) % 2 == 0)[:, None]
    first = np.where(rising, np.stack([a, b, c], 1), np.stack([a, b, d], 1))
    second = np.where(rising, np.stack([a, c, d], 1), np.stack([b, c, d], 1))
    triangles = np.concatenate([first, second])
    region = np.full(len(triangles), int(Region.SOLID))
    return PlaneMesh(np.stack([x.reshape(-1), y.reshape(-1)], axis=1), triangles, region)
