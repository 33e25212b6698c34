"""Tubes with the cross-section of a circle and thin elements at the wall."""

import numpy as np
from jaxtyping import Float

from jaxfsi.mesh import Mesh
from jaxfsi.meshing import tube


def round_tube(
    *,
    radius: float,
    length: float,
    n_around: int,
    n_axial: int,
    n_rings: int,
    thickness: float | None = None,
    n_layers: int = 1,
    grading: float = 0.5,
    columns: bool = False,
) -> Mesh:
    """A `tube` whose polygonal lumen and wall have the areas of circle and annulus.

    Args:
        radius: of the lumen [cm].
        length: of the tube [cm].
        n_around: edges round the lumen.
        n_axial: elements along the axis.
        n_rings: rings of elements from the axis to the lumen's surface.
        thickness: of the wall [cm]; None for a tube without a wall.
        n_layers: layers of elements through the wall.
        grading: share by which the outermost ring is thinner than their mean.
        columns: build the wall in columns, so that it has wedges.
    """
    angle = 2.0 * np.pi / n_around
    scale = np.sqrt(angle / np.sin(angle))

    def towards_wall(points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 3"]:
        r = np.hypot(points[:, 0], points[:, 1])
        inside = np.maximum(1.0 - r / (scale * radius), 0.0)
        stretch = 1.0 + grading * inside
        return points * np.stack([stretch, stretch, np.ones_like(r)], axis=1)

    return tube(
        radius=scale * radius,
        length=length,
        thickness=1.0 if thickness is None else scale * thickness,
        n_around=n_around,
        n_axial=n_axial,
        n_layers=0 if thickness is None else n_layers,
        n_rings=n_rings,
        mapping=towards_wall,
        columns=columns,
    )
