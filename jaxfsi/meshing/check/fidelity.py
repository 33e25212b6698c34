"""How well a mesh keeps to its anatomy: wall and septum thickness, elements across the lumen."""

import dataclasses

import numpy as np
from jaxtyping import Float

from jaxfsi.anatomy import Anatomy
from jaxfsi.measures import triangle_normals
from jaxfsi.mesh import INTERFACE, Mesh, Region
from jaxfsi.meshing.check.quality import Distribution, spread_of
from jaxfsi.meshing.check.thickness import Exit, wall_thickness
from jaxfsi.meshing.surface.projection import gradients
from jaxfsi.meshing.surface.sizes import solid_depth

# Cosine between a ray and the normals of both surfaces above which it measures a thickness;
# others run along the wall at tips, creases and cut ends.
_ACROSS = 0.9
_MOST_TETS = 20_000
_STEP = 1e-3  # of the differences for normals [cm]


@dataclasses.dataclass(frozen=True)
class Fidelity:
    """A mesh against the implicit functions that it was made from.

    Attributes:
        wall_ratio: thickness of the wall over that of the anatomy along the same ray.
        septum_ratio: the same where the wall parts two lumens; None where it never does.
        elements_across: local width of the lumen over the mean edge of tetrahedra of the blood.
    """

    wall_ratio: Distribution | None
    septum_ratio: Distribution | None
    elements_across: Distribution

    def to_dict(self) -> dict[str, object]:
        """Plain values for a JSON file."""
        return {
            name: None if spread is None else spread._asdict()
            for name, spread in (
                ("wall_ratio", self.wall_ratio),
                ("septum_ratio", self.septum_ratio),
                ("elements_across", self.elements_across),
            )
        }


def mesh_fidelity(mesh: Mesh, anatomy: Anatomy) -> Fidelity:
    """Compare thickness and resolution of a mesh with its anatomy.

    Thickness is measured along the normals of the interface triangles, in the mesh from
    tetrahedron to tetrahedron, in the anatomy along the implicit functions.
    """
    measured = wall_thickness(mesh)
    normals = triangle_normals(mesh.points, mesh.labelled(INTERFACE))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    slope = gradients(anatomy.lumen, measured.points, step=_STEP)
    square = np.maximum(np.einsum("pk,pk->p", slope, slope), 1e-2)
    start = measured.points - (anatomy.lumen(measured.points) / square)[:, None] * slope
    limit = 2.0 * float(np.max(anatomy.thickness(start)))
    wanted = solid_depth(anatomy, start, normals, limit=limit)
    end = start + wanted[:, None] * normals
    leaves_wall = _along(gradients(anatomy.wall, end, step=_STEP), normals) > _ACROSS
    enters_lumen = _along(gradients(anatomy.lumen, end, step=_STEP), normals) < -_ACROSS
    across = (_along(slope, normals) > _ACROSS) & (wanted < limit)
    ratio = measured.thickness / wanted
    return Fidelity(
        wall_ratio=_spread(ratio[across & leaves_wall & (measured.exit == Exit.OUTER_WALL)]),
        septum_ratio=_spread(ratio[across & enters_lumen & (measured.exit == Exit.LUMEN)]),
        elements_across=spread_of(elements_across(mesh, anatomy)),
    )


def elements_across(mesh: Mesh, anatomy: Anatomy) -> Float[np.ndarray, " tets"]:
    """Local width of the lumen over the mean edge, for tetrahedra of the blood (a sample)."""
    tets = mesh.tets_of(Region.FLUID)
    corners = mesh.points[tets[:: max(len(tets) // _MOST_TETS, 1)]]
    sides = corners[:, [0, 0, 0, 1, 1, 2]] - corners[:, [1, 2, 3, 2, 3, 3]]
    edge = np.linalg.norm(sides, axis=2).mean(axis=1)
    return 2.0 * anatomy.local_radius(corners.mean(axis=1)) / edge


def _along(
    slope: Float[np.ndarray, "rays 3"], direction: Float[np.ndarray, "rays 3"]
) -> Float[np.ndarray, " rays"]:
    """Cosine between gradients and unit directions."""
    norm = np.maximum(np.linalg.norm(slope, axis=1), 1e-12)
    return np.einsum("pk,pk->p", slope, direction) / norm


def _spread(values: Float[np.ndarray, " values"]) -> Distribution | None:
    return spread_of(values) if len(values) else None
