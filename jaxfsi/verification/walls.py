"""Walls alone under known loads: a clamped strip, a squeezed ring, a tube under pressure.

Small displacements, E = 1 dyn/cm². What counts for strip and ring is the work of the load, f·d:

| problem | reference |
|---|---|
| `clamped_strip` 1 × 0.3 × 0.1, unit traction across the tip | own solution on a fine mesh |
| `squeezed_ring` R 0.5, h 0.1, length 0.3, traction cos 2θ | own solution on a fine mesh |
| `thick_tube` R 0.5, h 0.1, under pressure, no axial strain | Lamé, see `lame_displacement` |

The references of strip and ring come from an assembled program that shares no code with the core:
quadratic tetrahedra on strips of 40 × 10 × 2 and rings of 72 × 4 × 2 blocks cut into tetrahedra,
loads integrated on the quadratic functions. At ν = 0.3 coarser meshes (32 × 8 × 2, 56 × 4 × 2)
differ by 0.1 %. At ν = 0.49 they lie midway between compatible elements, which are too stiff, and
elements with averaged volumes, 1 % apart; those at 0.4999 are these times the ratio of the two ν
on coarser meshes.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxfsi.core.laws.materials import LinearElastic
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.statics.equilibrium import Loads, pressure_load
from jaxfsi.core.step.model import Model, WallElement, build_model
from jaxfsi.mesh import INTERFACE, Mesh
from jaxfsi.meshing import ring, strip

STRIP_WORK: dict[float, float] = {0.3: 11.83, 0.49: 11.36, 0.4999: 11.29}
"""Work of the strip's load by Poisson's ratio."""

RING_WORK: dict[float, float] = {0.3: 53.0, 0.49: 52.1, 0.4999: 51.95}
"""Work of the ring's load by Poisson's ratio."""

_WEAK = 1e-6
"""Support of the ring [dyn/cm³], so that it does not float: 1e-4 of its own stiffness."""


class WallProblem(NamedTuple):
    """A wall, its loads and what is known about the answer.

    Attributes:
        mesh: of the wall.
        model: of the wall.
        loads: what acts on it.
    """

    mesh: Mesh
    model: Model
    loads: Loads


def work(problem: WallProblem, d: Float[Array, "3 nodes"]) -> float:
    """Work of the dead forces along a displacement."""
    assert problem.loads.force is not None
    return float(jnp.sum(problem.loads.force * d))


def clamped_strip(
    nu: float, wall_element: WallElement, *, n_length: int = 10, n_layers: int = 1
) -> WallProblem:
    """A strip clamped at x = 0 with a traction (0, 0, 1) dyn/cm² at its tip.

    Args:
        nu: Poisson's ratio.
        wall_element: which element.
        n_length: elements along the strip; those across are as long.
        n_layers: layers of elements through its thickness.
    """
    n_width = max(1, round(0.3 * n_length))
    mesh = strip(
        length=1.0,
        width=0.3,
        thickness=0.1,
        n_length=n_length,
        n_width=n_width,
        n_layers=n_layers,
    )
    wall = Wall(LinearElastic(1.0, nu))
    model = build_model(mesh, {}, wall=wall, clamped=["x_min"], wall_element=wall_element)
    area = _vertex_areas(mesh, "x_max", model.n_nodes)
    force = np.outer([0.0, 0.0, 1.0], area)
    return WallProblem(mesh, model, Loads(force=jnp.asarray(force)))


def squeezed_ring(
    nu: float,
    wall_element: WallElement,
    *,
    n_around: int = 32,
    n_axial: int = 3,
    n_layers: int = 1,
) -> WallProblem:
    """A free ring with the radial traction cos 2θ dyn/cm² on its inside, which folds it.

    Args:
        nu: Poisson's ratio.
        wall_element: which element.
        n_around: elements round the ring.
        n_axial: elements along it.
        n_layers: layers of elements through its thickness.
    """
    mesh = ring(
        radius=0.5,
        length=0.3,
        thickness=0.1,
        n_around=n_around,
        n_axial=n_axial,
        n_layers=n_layers,
        columns=wall_element == "bending",
    )
    wall = Wall(LinearElastic(1.0, nu), support_stiffness=_WEAK)
    model = build_model(mesh, {}, wall=wall, clamped=[], wall_element=wall_element)
    area = _vertex_areas(mesh, INTERFACE, model.n_nodes)
    x, y = np.asarray(model.x)[:2]
    angle = np.arctan2(y, x)
    push = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)]) * np.cos(2.0 * angle)
    return WallProblem(mesh, model, Loads(force=jnp.asarray(push * area)))


def thick_tube(
    nu: float,
    wall_element: WallElement,
    *,
    pressure: float = 1e-4,
    n_around: int = 32,
    n_axial: int = 20,
    n_layers: int = 2,
) -> WallProblem:
    """A tube of length 2 cm clamped at its ends, which bend it no more midway.

    Its middle shortens all the same: near the ends, where the tube cannot widen, it is longer.

    Args:
        nu: Poisson's ratio.
        wall_element: which element.
        pressure: inside [dyn/cm²].
        n_around: elements round the tube.
        n_axial: elements along it.
        n_layers: layers of elements through its wall.
    """
    mesh = ring(
        radius=0.5,
        length=2.0,
        thickness=0.1,
        n_around=n_around,
        n_axial=n_axial,
        n_layers=n_layers,
        columns=wall_element == "bending",
    )
    wall = Wall(LinearElastic(1.0, nu))
    model = build_model(mesh, {}, wall=wall, wall_element=wall_element)
    return WallProblem(mesh, model, Loads((pressure_load(mesh, INTERFACE, pressure, model),)))


def lame_displacement(
    radius: float,
    inner: float,
    outer: float,
    pressure: float,
    E: float,
    nu: float,
    axial_strain: float = 0.0,
) -> float:
    """Radial displacement of a thick tube under inner pressure with a given axial strain [cm].

    u(r) = (1 + ν) p a² ((1 − 2ν) r + b²/r) / (E (b² − a²)) − ν ε r (Lamé 1852; Timoshenko & Goodier
    1951, eq. 46, with generalised plane strain).

    Args:
        radius: where [cm].
        inner: a [cm].
        outer: b [cm].
        pressure: p inside [dyn/cm²].
        E: Young's modulus [dyn/cm²].
        nu: Poisson's ratio.
        axial_strain: ε.
    """
    shape = (1.0 - 2.0 * nu) * radius + outer**2 / radius
    widening = (1.0 + nu) * pressure * inner**2 * shape / (E * (outer**2 - inner**2))
    return widening - nu * axial_strain * radius


def axial_strain(mesh: Mesh, d: Float[Array, "3 nodes"], z: float, length: float) -> float:
    """Mean axial strain of vertices over a length round a height [cm], by least squares."""
    height = mesh.points[:, 2]
    here = np.abs(height - z) <= length / 2.0
    moved = np.asarray(d)[2, : len(height)][here]
    return float(np.polyfit(height[here], moved, 1)[0])


def radial_displacement(
    problem: WallProblem, d: Float[Array, "3 nodes"], radius: float, z: float
) -> float:
    """Mean radial displacement of the vertices at a radius and height [cm].

    Raises:
        ValueError: no vertex is there.
    """
    x = problem.mesh.points
    r = np.hypot(x[:, 0], x[:, 1])
    here = np.isclose(r, radius, atol=1e-6) & np.isclose(x[:, 2], z, atol=1e-6)
    if not np.any(here):
        raise ValueError(f"no vertex lies at r = {radius}, z = {z} cm; ask where the mesh has some")
    moved = np.asarray(d).T[: len(x)][here]
    return float(np.mean(np.sum(moved[:, :2] * x[here, :2], axis=1) / r[here]))


def _vertex_areas(mesh: Mesh, label: str, n_nodes: int) -> Float[np.ndarray, " nodes"]:
    """Area of a labelled surface that belongs to each of the nodes of a model [cm²]."""
    faces = mesh.labelled(label)
    corner = mesh.points[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = np.linalg.norm(normal, axis=1) / 2.0
    return np.bincount(faces.ravel(), np.repeat(area / 3.0, 3), n_nodes)
