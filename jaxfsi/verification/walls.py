"""Walls alone under known loads: a clamped strip, a squeezed ring, tube and slit under pressure.

Small displacements, E = 1 dyn/cm². What counts for strip and ring is the work of the load, f·d:

| problem | reference |
|---|---|
| `clamped_strip` 1 × 0.3 × 0.1, unit traction across the tip | own solution on a fine mesh |
| `squeezed_ring` R 0.5, h 0.02 to 0.1, length 0.3, traction cos 2θ | own solution on a fine mesh |
| `thick_tube` R 0.5, h 0.1, under pressure, no axial strain | Lamé, see `lame_displacement` |
| `pressurised_slit` 4 × 1 mm, h 0.5 mm, length 10 mm | own quadratic solution on a fine mesh |

The references of strip and ring come from an assembled program that shares no code with the core:
quadratic tetrahedra on strips of 40 × 10 × 2 and rings of 72 × 4 × 2 blocks cut into tetrahedra,
loads integrated on the quadratic functions. At ν = 0.3 coarser meshes (32 × 8 × 2, 56 × 4 × 2)
differ by 0.1 %. At ν = 0.45 and 0.49 they lie midway between compatible elements, which are too
stiff, and elements with averaged volumes, 1 to 2 % apart; those at 0.4999 are these times the ratio
of the two ν on coarser meshes. Thin rings have 80 × 4 × 2 blocks; the slit 64 × 16 × 3 at ν = 0.3,
otherwise 40 × 12 × 2 with 1 % more for the missing layer, where both kinds are 4 % apart.
"""

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxfsi.core.laws.materials import LinearElastic
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.statics.loads import Loads, pressure_load
from jaxfsi.core.step.model import Model, WallElement, build_model
from jaxfsi.mesh import INTERFACE, Mesh
from jaxfsi.meshing import ring, strip
from lumped.units import MMHG

STRIP_WORK: dict[float, float] = {0.3: 11.83, 0.45: 11.57, 0.49: 11.36, 0.4999: 11.29}
"""Work of the strip's load by Poisson's ratio."""

RING_WORK: dict[float, dict[float, float]] = {
    0.1: {0.3: 53.0, 0.45: 52.7, 0.49: 52.1, 0.4999: 51.95},
    0.05: {0.3: 358.4, 0.45: 351.8, 0.49: 346.9},
    0.02: {0.3: 4971.0, 0.45: 4710.0, 0.49: 4566.0},
}
"""Work of the ring's load by thickness [cm] and Poisson's ratio."""

SLIT_WIDENING: dict[float, float] = {0.3: 0.591, 0.45: 0.524, 0.49: 0.490}
"""Growth of the slit's area under 40 mmHg by Poisson's ratio, linearised, over the area."""

_WEAK = 1e-6
"""Support of the ring 0.1 cm thick [dyn/cm³], so that it does not float: 1e-4 of its stiffness."""


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
    thickness: float = 0.1,
) -> WallProblem:
    """A free ring with the radial traction cos 2θ dyn/cm² on its inside, which folds it.

    Args:
        nu: Poisson's ratio.
        wall_element: which element.
        n_around: elements round the ring.
        n_axial: elements along it.
        n_layers: layers of elements through its thickness.
        thickness: of the ring [cm].
    """
    mesh = ring(
        radius=0.5,
        length=0.3,
        thickness=thickness,
        n_around=n_around,
        n_axial=n_axial,
        n_layers=n_layers,
        columns=wall_element == "bending",
    )
    weak = _WEAK * (thickness / 0.1) ** 3  # as its stiffness in bending
    wall = Wall(LinearElastic(1.0, nu), support_stiffness=weak)
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


_SLIT_PRESSURE = 40.0 * MMHG / 1.5e7
"""40 mmHg on a wall of 1.5 MPa whose modulus is taken as 1."""

_SLIT_SHARE = 1e-3
"""Share of it that is applied, so that the answer is linear."""


def pressurised_slit(
    nu: float,
    wall_element: WallElement,
    *,
    n_around: int = 24,
    n_axial: int = 10,
    n_layers: int = 1,
) -> WallProblem:
    """A flat tube with half axes of 2 and 0.5 mm, its ends held, under pressure inside.

    At its sharp ends the wall is four times as thick as the inner radius of curvature.

    Args:
        nu: Poisson's ratio.
        wall_element: which element.
        n_around: elements round the slit, evenly spaced.
        n_axial: elements along it; an even number.
        n_layers: layers of elements through its wall.
    """
    round_one = ring(
        radius=1.0,
        length=1.0,
        thickness=0.05,
        n_around=n_around,
        n_axial=n_axial,
        n_layers=n_layers,
        columns=wall_element == "bending",
    )
    x, y, z = round_one.points.T
    section = _ellipse(np.arctan2(y, x), 0.2, 0.05, np.hypot(x, y) - 1.0)
    mesh = dataclasses.replace(round_one, points=np.column_stack([section, z]))
    model = build_model(mesh, {}, wall=Wall(LinearElastic(1.0, nu)), wall_element=wall_element)
    load = pressure_load(mesh, INTERFACE, _SLIT_PRESSURE * _SLIT_SHARE, model)
    return WallProblem(mesh, model, Loads((load,)))


def slit_widening(problem: WallProblem, d: Float[Array, "3 nodes"]) -> float:
    """Linearised growth of the area midway along the slit under 40 mmHg, over the area."""
    points = problem.mesh.points
    inside = np.unique(problem.mesh.labelled(INTERFACE))
    middle = inside[np.isclose(points[inside, 2], 0.5, atol=1e-6)]
    middle = middle[np.argsort(np.arctan2(points[middle, 1] / 0.05, points[middle, 0] / 0.2))]
    before = points[middle, :2]
    moved = np.asarray(d).T[middle, :2]
    after = np.roll(before, -1, axis=0) - np.roll(before, 1, axis=0)
    change = np.sum(moved[:, 0] * after[:, 1] - moved[:, 1] * after[:, 0])
    area = np.sum(before[:, 0] * after[:, 1])
    return float(change / area / _SLIT_SHARE)


def _ellipse(
    turn: Float[np.ndarray, " nodes"], a: float, b: float, out: Float[np.ndarray, " nodes"]
) -> Float[np.ndarray, "nodes 2"]:
    """Points at shares of the arc of an ellipse, given as angles, moved along its normal."""
    fine = np.linspace(0.0, 2.0 * np.pi, 4001)
    steps = np.hypot(np.diff(a * np.cos(fine)), np.diff(b * np.sin(fine)))
    arc = np.append(0.0, np.cumsum(steps))
    angle = np.interp(turn % (2.0 * np.pi), arc / arc[-1] * 2.0 * np.pi, fine)
    normal = np.stack([np.cos(angle) / a, np.sin(angle) / b], axis=1)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return np.stack([a * np.cos(angle), b * np.sin(angle)], axis=1) + out[:, None] * normal


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
