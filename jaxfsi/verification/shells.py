"""Thin shells in large rotations: four problems with published load-deflection curves.

| problem | size | material | full load |
|---|---|---|---|
| `cantilever_under_shear` | 10 × 1 × 0.1 | E 1.2e6, ν 0 | 4 across the tip |
| `cantilever_under_moment` | 12 × 1 × 0.1 | E 1.2e6, ν 0 | 50 π/3, into a full circle |
| `slit_annular_plate` | radii 6 and 10, 0.03 thick | E 21e6, ν 0 | 0.8 a length along one lip |
| `pinched_hemisphere` | radius 10, 0.04 thick, hole of 18° | E 6.825e7, ν 0.3 | two pairs of 400 |

All are of St. Venant-Kirchhoff material, in consistent units. One layer of wedges, with forces and
stiffness of the core, is brought into equilibrium by Newton's method with a sparse factor of the
stiffness. In its part that follows the stress, the stress is extrapolated from the last iterate,
wrong by the square of the last rotation: few iterations where Newton's method proper diverges.

Sources: Sze, Liu & Lo 2004, Popular benchmark problems for geometric nonlinear analysis of shells,
Finite Elements in Analysis and Design 40:1551, sections 3.1 to 3.4, for problems and references;
Magisano, Leonetti & Garcea 2017, How to improve efficiency and robustness of the Newton method in
geometrically non-linear structural problem discretized via displacement-based finite elements,
CMAME 313:986, for the stress in the stiffness.
"""

import dataclasses
from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Bool, Float, Int
from scipy.sparse.linalg import splu

from jaxfsi.core.elements.wall import Weights
from jaxfsi.core.elements.wedge import (
    N_SAMPLES,
    WedgeElement,
    nodal_forces,
    strain_change,
    wedge_corners,
    wedge_geometry,
)
from jaxfsi.core.laws.materials import SaintVenantKirchhoff
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.laws.wedge_solid import WedgeTangent, element_matrices, wedge_tangent
from jaxfsi.mesh import Mesh
from jaxfsi.meshing import strip

Points = Float[np.ndarray, "nodes 3"]
Work = Float[np.ndarray, "12 wedges"]

_BATCH = 256
"""Wedges that are linearised at once."""

_MAX_ITERATIONS = 40
_STATIC = Weights(0.0, 0.0, 1.0)


class Deflection(NamedTuple):
    """A displacement that is compared.

    Attributes:
        name: as in the source.
        nodes: whose mean displacement counts.
        axis: component of it, 0 to 2.
        sign: of the component in the source.
        reference: value at the full load.
    """

    name: str
    nodes: Int[np.ndarray, " some"]
    axis: int
    sign: float
    reference: float


class Couples(NamedTuple):
    """Moments about a fixed axis that turn with the wall's columns.

    A column from x_b up to x_t, D = x_t − x_b, carries the forces ±m × D/|D|².

    Attributes:
        bottom: lower node of each column.
        top: upper node.
        moment: vector m of each column.
    """

    bottom: Int[np.ndarray, " columns"]
    top: Int[np.ndarray, " columns"]
    moment: Float[np.ndarray, "columns 3"]


class ShellProblem(NamedTuple):
    """A shell, what holds it and what loads it.

    Attributes:
        mesh: one layer of wedges.
        material: of the shell.
        fixed: components of displacement that are held, (nodes, 3).
        force: dead forces at the full load, (nodes, 3).
        couples: moments at the full load; None: there are none.
        deflections: what is compared.
        loads: shares of the full load, one after the other.
    """

    mesh: Mesh
    material: SaintVenantKirchhoff
    fixed: Bool[np.ndarray, "nodes 3"]
    force: Float[np.ndarray, "nodes 3"]
    couples: Couples | None
    deflections: tuple[Deflection, ...]
    loads: Float[np.ndarray, " steps"]


class ShellPath(NamedTuple):
    """Deflections of a shell while its load is raised.

    Attributes:
        deflections: at each load, in the order of the problem's.
        n_iterations: linear systems solved.
    """

    deflections: Float[np.ndarray, "steps deflections"]
    n_iterations: int


def cantilever_under_shear(n_length: int, n_width: int = 1) -> ShellProblem:
    """A strip clamped at one end with a dead force of 4 across the other.

    Args:
        n_length: elements along the strip.
        n_width: elements across it.
    """
    mesh = _strip(10.0, 1.0, 0.1, n_length, n_width)
    force = _along(mesh, "x_max", np.array([0.0, 0.0, 4.0]))
    tip = np.unique(mesh.labelled("x_max"))
    watched = (Deflection("-U tip", tip, 0, -1.0, 3.286), Deflection("W tip", tip, 2, 1.0, 6.698))
    return _problem(mesh, (1.2e6, 0.0), ("x_min",), force, watched, n_steps=2)


def cantilever_under_moment(n_length: int, n_width: int = 1) -> ShellProblem:
    """A strip clamped at one end, bent into a full circle by a moment of 50 π/3 at the other.

    The end comes back to the clamp: U = −12, W = 0, exactly for a strip that does not stretch.
    Halfway it is a half circle: U = −12, W = 24/π.

    Args:
        n_length: elements along the strip.
        n_width: elements across it.
    """
    mesh = _strip(12.0, 1.0, 0.1, n_length, n_width)
    tip = np.unique(mesh.labelled("x_max"))
    n = len(mesh.points) // 2
    bottom = tip[tip < n]
    share = _shares(mesh.points[bottom, 1])
    moment = np.outer(share, [0.0, -50.0 * np.pi / 3.0, 0.0])
    watched = (Deflection("-U tip", tip, 0, -1.0, 12.0), Deflection("W tip", tip, 2, 1.0, 0.0))
    problem = _problem(
        mesh, (1.2e6, 0.0), ("x_min",), np.zeros_like(mesh.points), watched, n_steps=20
    )
    return problem._replace(couples=Couples(bottom, bottom + n, moment))


def slit_annular_plate(n_radial: int, n_around: int) -> ShellProblem:
    """A ring-shaped plate slit along a radius; one lip is clamped, the other lifted.

    Args:
        n_radial: elements from the inner to the outer edge.
        n_around: elements round the plate.
    """
    inner, outer = 6.0, 10.0
    mesh = _strip(outer - inner, 2.0 * np.pi, 0.03, n_radial, n_around)
    r, angle, z = mesh.points.T
    r = inner + r
    force = _along(mesh, "y_min", np.array([0.0, 0.0, 0.8 * (outer - inner)]))
    lip = np.unique(mesh.labelled("y_min"))
    at_inner, at_outer = (lip[np.isclose(r[lip], radius)] for radius in (inner, outer))
    watched = (
        Deflection("W_A", at_inner, 2, 1.0, 13.891),
        Deflection("W_B", at_outer, 2, 1.0, 17.528),
    )
    mesh = _moved(mesh, np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1))
    return _problem(mesh, (21e6, 0.0), ("y_max",), force, watched, n_steps=5)


def pinched_hemisphere(n: int) -> ShellProblem:
    """A hemisphere with a hole of 18° at its pole, pulled along x and pushed along y at its rim.

    A quarter of it is meshed; half of each force acts on it.

    Args:
        n: elements along each side of the quarter.
    """
    mesh = _strip(np.radians(72.0), np.pi / 2.0, 0.04, n, n)
    polar, azimuth, up = mesh.points.T
    polar, radius = np.radians(18.0) + polar, 10.0 + up
    points = np.stack(
        [
            radius * np.sin(polar) * np.cos(azimuth),
            radius * np.sin(polar) * np.sin(azimuth),
            radius * np.cos(polar),
        ],
        axis=1,
    )
    rim = np.unique(mesh.labelled("x_max"))
    pulled, pushed = (rim[np.isclose(azimuth[rim], angle)] for angle in (0.0, np.pi / 2.0))
    force = np.zeros_like(points)
    force[pulled, 0], force[pushed, 1] = 400.0 / 4.0, -400.0 / 4.0
    watched = (
        Deflection("outward", pulled, 0, 1.0, 4.067),
        Deflection("inward", pushed, 1, -1.0, 8.178),
    )
    fixed = np.zeros_like(points, bool)
    fixed[np.unique(mesh.labelled("y_min")), 1] = True
    fixed[np.unique(mesh.labelled("y_max")), 0] = True
    fixed[pulled[0], 2] = True
    problem = _problem(_moved(mesh, points), (6.825e7, 0.3), (), force, watched, n_steps=5)
    return problem._replace(fixed=fixed)


def shell_path(problem: ShellProblem, *, tolerance: float = 1e-6) -> ShellPath:
    """Raise the load of a shell step by step.

    Args:
        problem: the shell.
        tolerance: a correction over the largest displacement at which a step of the load ends.
            Rounding of the large membrane forces hides what is left out of balance.

    Raises:
        RuntimeError: a step of the load did not converge.
    """
    x = problem.mesh.points.copy()
    work = np.zeros((N_SAMPLES, len(problem.mesh.wedges)))
    path, total = [], 0
    for load in problem.loads:
        x, work, n = _balanced(problem, x, work, load, tolerance)
        moved = x - problem.mesh.points
        path.append([d.sign * moved[d.nodes, d.axis].mean() for d in problem.deflections])
        total += n
    return ShellPath(np.array(path), total)


def _balanced(
    problem: ShellProblem, x: Points, work: Work, load: float, tolerance: float
) -> tuple[Points, Work, int]:
    """Positions in equilibrium with a share of the load, from a start."""
    free = np.flatnonzero(~problem.fixed.ravel())
    for n in range(1, _MAX_ITERATIONS + 1):
        tangents = [_tangent(part, X, problem.material) for part, X in _batches(problem, x)]
        force, K = _assembled(problem, tangents, work)
        pushed, load_change = load_forces(problem, x, load)
        K, r = (K - load_change).tocsc()[free][:, free], (pushed - force).ravel()[free]
        try:
            found = splu(K).solve(r)
        except RuntimeError:  # exactly singular
            break
        if not np.linalg.norm(K @ found - r) < 1e-3 * np.linalg.norm(r):
            break
        step = np.zeros_like(x)
        step.ravel()[free] = found
        parts = zip(tangents, _batches(problem, step), strict=True)
        work = _joined(problem, [_extrapolated(tangent, part) for tangent, (part, _) in parts])
        x = x + step
        if np.max(np.abs(step)) < tolerance * np.max(np.abs(x - problem.mesh.points)):
            return x, work, n
    raise RuntimeError(
        f"the shell was not brought into equilibrium with {load:.3f} of its load. Raise the load"
        " in more steps."
    )


_APART = WedgeElement(jnp.arange(6 * _BATCH, dtype=jnp.int32).reshape(_BATCH, 6).T)
"""A batch of wedges that share no nodes, so that one compiled function serves all meshes."""


@jax.jit
def _tangent(x: Array, X: Array, material: SaintVenantKirchhoff) -> WedgeTangent:
    shape, still = wedge_geometry(X, _APART), jnp.zeros_like(X)
    return wedge_tangent(still, x - X, _STATIC, Wall(material), _APART, shape)


@jax.jit
def _forces_and_matrices(tangent: WedgeTangent, work: Array) -> tuple[Array, Array]:
    """Forces at the nodes of each wedge, and its matrix with given stresses in it."""
    forces = nodal_forces(tangent.work, tangent.x)
    matrices = element_matrices(tangent._replace(work=tuple(work)))
    return jnp.stack([jnp.stack(node) for node in forces]), matrices


@jax.jit
def _extrapolated(tangent: WedgeTangent, step: Array) -> Array:
    """Stresses after a step of the nodes, as the tangent foretells them."""
    e = jnp.stack(strain_change(wedge_corners(step, _APART), tangent.x))
    return jnp.stack(tangent.work) + jnp.einsum("kiw,kw->iw", tangent.moduli, e)


def _batches(problem: ShellProblem, x: Points) -> Iterator[tuple[Array, Array]]:
    """A vector at the nodes of each batch of wedges, and their reference positions."""
    wedges = problem.mesh.wedges
    padded = np.resize(wedges, (_BATCH * -(-len(wedges) // _BATCH), 6)).reshape(-1, 6 * _BATCH)
    for nodes in padded:
        yield jnp.asarray(x[nodes].T), jnp.asarray(problem.mesh.points[nodes].T)


def _joined(problem: ShellProblem, parts: list[Array]) -> np.ndarray:
    """Values of all wedges, from those of the batches."""
    return np.concatenate(parts, axis=-1)[..., : len(problem.mesh.wedges)]


def _assembled(
    problem: ShellProblem, tangents: list[WedgeTangent], work: Work
) -> tuple[Points, sp.csc_matrix]:
    """Forces of the shell and its stiffness."""
    wedges = problem.mesh.wedges
    n = len(wedges)
    padded = np.resize(work.T, (_BATCH * len(tangents), N_SAMPLES)).T
    parts = [
        _forces_and_matrices(t, w)
        for t, w in zip(tangents, np.split(padded, len(tangents), axis=1), strict=True)
    ]
    size = problem.mesh.points.size
    unknowns = (3 * wedges[:, :, None] + np.arange(3)).reshape(n, 18)
    forces = _joined(problem, [force for force, _ in parts]).reshape(18, n).T
    matrices = np.concatenate([matrix for _, matrix in parts])[:n]
    rows, columns = np.repeat(unknowns, 18, axis=1), np.tile(unknowns, (1, 18))
    total = np.bincount(unknowns.ravel(), forces.ravel(), size).reshape(-1, 3)
    K = sp.csc_matrix((matrices.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size))
    return total, K


def load_forces(problem: ShellProblem, x: Points, load: float) -> tuple[Points, sp.csc_matrix]:
    """Forces of the loads on a deformed shell, and their derivative by the positions.

    Args:
        problem: the shell.
        x: positions of the nodes.
        load: share of the full load.
    """
    force = load * problem.force
    size = (x.size, x.size)
    if problem.couples is None:
        return force, sp.csc_matrix(size)
    bottom, top, moment = problem.couples
    D = x[top] - x[bottom]
    square = np.sum(D * D, axis=1)[:, None]
    pair = load * np.cross(moment, D) / square
    np.add.at(force, top, pair)
    np.add.at(force, bottom, -pair)
    spin = np.cross(load * moment[:, None, :], np.eye(3)[None]).transpose(0, 2, 1)
    by_D = (spin - 2.0 * pair[:, :, None] * D[:, None, :]) / square[:, :, None]
    unknowns = 3 * np.stack([top, bottom], axis=1)[:, :, None] + np.arange(3)
    sign = np.array([[1.0, -1.0], [-1.0, 1.0]])
    blocks = sign[None, :, None, :, None] * by_D[:, None, :, None, :]
    rows = np.broadcast_to(unknowns[:, :, :, None, None], blocks.shape)
    columns = np.broadcast_to(unknowns[:, None, None, :, :], blocks.shape)
    change = sp.csc_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=size)
    return force, change


def _strip(length: float, width: float, thickness: float, n_length: int, n_width: int) -> Mesh:
    """One layer of wedges, its middle surface at z = 0."""
    counts = {"n_length": n_length, "n_width": n_width, "n_layers": 1}
    mesh = strip(length=length, width=width, thickness=thickness, **counts)
    return _moved(mesh, mesh.points - np.array([0.0, 0.0, thickness / 2.0]))


def _moved(mesh: Mesh, points: Float[np.ndarray, "nodes 3"]) -> Mesh:
    return dataclasses.replace(mesh, points=points)


def _along(mesh: Mesh, label: str, total: Float[np.ndarray, "3"]) -> Float[np.ndarray, "nodes 3"]:
    """An evenly spread force on one side of a strip before it is bent into shape."""
    side = np.unique(mesh.labelled(label))
    force = np.zeros_like(mesh.points)
    along = mesh.points[side][:, 1 if label.startswith("x") else 0]
    force[side] = np.outer(_shares(along), total)
    return force


def _shares(along: Float[np.ndarray, " nodes"]) -> Float[np.ndarray, " nodes"]:
    """Share of an even load at each of evenly spaced nodes of an edge: half at its ends."""
    inside = ~(np.isclose(along, along.min()) | np.isclose(along, along.max()))
    share = np.where(inside, 2.0, 1.0)
    return share / share.sum()


def _problem(
    mesh: Mesh,
    moduli: tuple[float, float],
    clamped: tuple[str, ...],
    force: Float[np.ndarray, "nodes 3"],
    deflections: tuple[Deflection, ...],
    *,
    n_steps: int,
) -> ShellProblem:
    fixed = np.zeros_like(mesh.points, bool)
    for name in clamped:
        fixed[np.unique(mesh.labelled(name))] = True
    material = SaintVenantKirchhoff(*moduli)
    loads = np.arange(1, n_steps + 1) / n_steps
    return ShellProblem(mesh, material, fixed, force, None, deflections, loads)
