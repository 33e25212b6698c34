"""Equilibrium of the wall under pressures that follow it.

::

    ∫ (P(F) + F S₀) ∇N_a dV + support = Σ −∫ p N_a n da + f_a

over the deformed faces, with dead forces f. Newton's method with the tangent and GMRES,
preconditioned by the wall's factor at the reference shape; the load is raised in steps. The
derivative is that of the equilibrium (implicit function theorem); not a number where `max_linear`
iterations do not solve its system.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.bending import mid_edges
from jaxfsi.core.elements.wall import Weights
from jaxfsi.core.laws.contact import contact_force, contact_product, contact_slope
from jaxfsi.core.laws.interface import MidEdgeInterface, mid_edge_load
from jaxfsi.core.laws.tissue import tissue_force
from jaxfsi.core.laws.wall_balance import WallShape, wall_geometry, wall_residual
from jaxfsi.core.solve.krylov import fgmres
from jaxfsi.core.solve.wall_blocks import vertex_block
from jaxfsi.core.solve.wall_factor import WallFactor, wall_factor, wall_solve, wall_solve_transposed
from jaxfsi.core.solve.wall_tangent import apply_wall, wall_tangent
from jaxfsi.core.step.model import Model
from jaxfsi.mesh import Mesh, tet_faces
from lumped.parameters import Parameter, is_traced

Field = Float[Array, "3 nodes"]

STATIC = Weights(0.0, 0.0, 1.0)
"""The unknown of an equilibrium is the displacement."""

NO_WALL = "the model has no wall, so that nothing can be in equilibrium; give one"

REDUCTION, DERIVATIVE = 1e-5, 1e-10
"""To what part of its right-hand side a system of Newton's method and of derivatives is solved."""


class RESULTS(eqx.Enumeration):
    """How the search for an equilibrium ended."""

    successful = ""
    not_converged = (
        "The wall was not brought into equilibrium. Raise the load in more steps, or allow more"
        " Newton or linear iterations; without enough support, or where it buckles, there is none."
    )
    not_finite = (
        "The wall's displacement is no longer finite: elements turned inside out. Raise the load"
        " in more steps and check the units of pressures and moduli."
    )


class PressureLoad(NamedTuple):
    """A pressure on triangles of the wall.

    Attributes:
        faces: triangles pointing out of the wall.
        p: pressure at all nodes of the model, of which those of the faces count [dyn/cm²].
        edges: unknowns of the edges opposite to the corners; None where edges do not bow.
    """

    faces: Int[Array, "3 faces"]
    p: Float[Array, " nodes"]
    edges: Int[Array, "3 faces"] | None = None


class Loads(NamedTuple):
    """What acts on the wall.

    Attributes:
        pressures: pressures, which follow the wall.
        force: dead forces on the nodes [dyn]; None: none.
    """

    pressures: tuple[PressureLoad, ...] = ()
    force: Field | None = None


class Equilibrium(NamedTuple):
    """Result of a search.

    Attributes:
        d: displacement [cm].
        result: see `RESULTS`.
        n_newton: linear systems solved.
        n_gmres: iterations of GMRES.
        residual: norm of the forces out of balance over that of the loads.
    """

    d: Field
    result: RESULTS
    n_newton: Int[Array, ""]
    n_gmres: Int[Array, ""]
    residual: Float[Array, ""]


def pressure_load(
    mesh: Mesh, label: str, p: Parameter | Float[np.ndarray, " nodes"], model: Model
) -> PressureLoad:
    """A pressure on a labelled surface of the wall.

    Args:
        mesh: the mesh of the model.
        label: name of the surface; where blood and wall meet, the wall's side is meant.
        p: pressure [dyn/cm²], a number or one value a node of the mesh.
        model: the model.

    Raises:
        ValueError: the model has no wall, or the surface is not one of it.
    """
    if model.wall is None:
        raise ValueError(NO_WALL)
    faces = np.asarray(mesh.labelled(label))
    sides = tet_faces(np.asarray(model.solid_tets, np.int64).T).reshape(-1, 3)
    ours, theirs = np.sort(sides, axis=1), np.sort(faces, axis=1)
    n = len(mesh.points)
    key = [(f[:, 0] * n + f[:, 1]) * n + f[:, 2] for f in (ours, theirs)]
    order = np.argsort(key[0])
    place = np.minimum(np.searchsorted(key[0][order], key[1]), len(order) - 1)
    found = order[place]
    if not len(faces) or np.any(key[0][found] != key[1]):
        raise ValueError(
            f"the faces named {label!r} are not all faces of the wall. Load a surface of the wall,"
            " such as interface or outer_wall."
        )
    value = jnp.broadcast_to(jnp.asarray(p, float), (n,))
    ordered = sides[found].T
    edges = mid_edges(model.element, ordered)
    return PressureLoad(jnp.asarray(ordered), jnp.pad(value, (0, model.n_nodes - n)), edges)


def static_factor(model: Model, *, dtype: type = np.float64) -> WallFactor:
    """Factor of the wall's stiffness at the reference shape of a concrete model.

    Raises:
        ValueError: the model has no wall, or it is not held.
    """
    if model.wall is None:
        raise ValueError(NO_WALL)
    A = vertex_block(model, STATIC).tolil()
    everywhere = jnp.zeros_like(model.x).at[:, : model.n_vertices].set(1.0)
    support = tissue_force(model.wall.support_stiffness * everywhere, model)
    A.setdiag(A.diagonal() + np.asarray(support).T.ravel())
    return wall_factor(sp.csr_matrix(A), model, STATIC, dtype=dtype)


def load_forces(loads: Loads, d: Field, model: Model) -> Field:
    """Forces of the loads on the nodes of the deformed wall [dyn].

    Faces count as flat between their corners.
    """
    total = jnp.zeros_like(d) if loads.force is None else loads.force
    x = model.x + d
    for faces, p, edges in loads.pressures:
        a, b, c = (x[:, faces[i]] for i in range(3))
        area = jnp.cross(b - a, c - a, axis=0) / 2.0
        whole = p[faces[0]] + p[faces[1]] + p[faces[2]]
        for k in range(3):  # ∫ p N_k over a triangle is (p_k + Σ p) A/12
            total = total.at[:, faces[k]].add(-(p[faces[k]] + whole) / 12.0 * area)
        if edges is not None:
            total = total - mid_edge_load(p, x, MidEdgeInterface(faces, edges))
    return total


def equilibrium(
    model: Model,
    loads: Loads,
    factor: WallFactor,
    *,
    n_load_steps: int = 1,
    tolerance: float = 1e-9,
    max_newton: int = 12,
    max_linear: int = 100,
    reduction: float = REDUCTION,
    derivative: float = DERIVATIVE,
    throw: bool = True,
) -> Equilibrium:
    """Displacement at which the wall is in equilibrium with its loads.

    Args:
        model: the model; its blood plays no part.
        loads: what acts on the wall.
        factor: see `static_factor`.
        n_load_steps: equal steps in which the load is raised.
        tolerance: forces out of balance over loads at which to stop.
        max_newton: linear systems in each load step at most.
        max_linear: iterations of GMRES at most.
        reduction: to what part of its right-hand side a system of Newton's method is solved, or
            less far where the equilibrium asks for no more.
        derivative: to what part of its right-hand side a system of derivatives is solved.
        throw: raise where no equilibrium is found; otherwise the result says so.

    Raises:
        ValueError: the model has no wall.
        RuntimeError: no equilibrium was found and `throw` is set.
    """
    if model.wall is None:
        raise ValueError(NO_WALL)
    options = (n_load_steps, tolerance, max_newton, max_linear, reduction, derivative)
    end = _equilibrium(model, loads, factor, options)
    if throw and not is_traced(end.residual) and end.result != RESULTS.successful:
        raise RuntimeError(
            f"{RESULTS[end.result]} The forces are {float(end.residual):.1e} out of balance after"
            f" {int(end.n_newton)} linear systems."
        )
    return end


def _resistance(d: Field, model: Model, shape: WallShape) -> Field:
    """Forces of the wall, of the tissue outside and of sides that nearly touch [dyn]."""
    assert model.wall is not None
    zero = jnp.zeros_like(d)
    r = wall_residual(zero, zero, d, model.wall, model.element, shape, model.prestress)
    r = r + tissue_force(model.wall.support_stiffness * d, model)
    return r if model.contact is None else r + contact_force(d, model.x, model.contact)


def _stiffness(d: Field, model: Model, shape: WallShape) -> Callable[[Field], Field]:
    """Derivative of `_resistance`, as a product."""
    assert model.wall is not None
    wall, contact, zero = model.wall, model.contact, jnp.zeros_like(d)
    about = wall_tangent(zero, d, STATIC, wall, model.element, shape, model.prestress)
    slope = None if contact is None else contact_slope(d, model.x, contact)

    def product(v: Field) -> Field:
        r = apply_wall(about, v, model.element, shape)
        r = r + tissue_force(wall.support_stiffness * v, model)
        if contact is None or slope is None:
            return r
        return r + contact_product(slope, v, contact)

    return product


@eqx.filter_jit
def _equilibrium(model, loads, factor, options) -> Equilibrium:
    n_load_steps, tolerance, max_newton, max_linear, reduction, derivative = options
    factor = jax.lax.stop_gradient(factor)
    shape = wall_geometry(model.x, model.element)
    zero = jnp.zeros_like(model.x)
    free = model.in_solid & ~model.prescribed
    size = jax.lax.stop_gradient(
        jnp.linalg.norm(jnp.where(free, load_forces(loads, zero, model), 0.0))
    )
    size = jnp.where(size > 0.0, size, 1.0)

    def out_of_balance(flat, scale):
        d = flat.reshape(3, -1)
        r = _resistance(d, model, shape) - scale * load_forces(loads, d, model)
        return jnp.where(free, r, d).reshape(-1)

    def tangent(flat, scale):
        d = flat.reshape(3, -1)
        stiffness = _stiffness(d, model, shape)
        _, load_change = jax.linearize(lambda d: load_forces(loads, d, model), d)

        def product(flat):
            v = flat.reshape(3, -1)
            return jnp.where(free, stiffness(v) - scale * load_change(v), v).reshape(-1)

        return product

    def approximate(solve):
        return lambda r: jnp.where(
            free, solve(factor, jnp.where(free, r.reshape(3, -1), 0.0)), r.reshape(3, -1)
        ).reshape(-1)

    def linear_solve(matvec, b, inverse, reduction):
        return fgmres(
            matvec,
            b,
            inverse,
            tolerance=reduction * jnp.linalg.norm(b),
            max_iterations=max_linear,
        )

    def raised(scale, start):
        """Newton's method at one load."""

        def function(flat):
            return out_of_balance(flat, scale)

        def proceed(s):
            _, r, k, _ = s
            return (k < max_newton) & (jnp.linalg.norm(r) > tolerance * size)

        def correct(s):
            d, r, k, n = s
            goal = jnp.maximum(0.3 * tolerance * size / jnp.linalg.norm(r), reduction)
            product = tangent(d, scale)
            step = linear_solve(product, r, approximate(wall_solve), goal)
            d = d - step.x
            return d, function(d), k + 1, n + step.n_iterations

        start_state = (start, function(start), jnp.zeros((), int), jnp.zeros((), int))
        d, r, k, n = jax.lax.while_loop(proceed, correct, start_state)
        return d, (k, n, jnp.linalg.norm(r) / size)

    def solve(function, start):
        def one(carry, scale):
            d, (k, n, _) = carry
            d, (dk, dn, left) = raised(scale, d)
            return (d, (k + dk, n + dn, left)), None

        none = jnp.zeros((), int)
        scales = jnp.arange(1, n_load_steps + 1) / n_load_steps
        d, (k, n, left) = jax.lax.scan(one, (start, (none, none, jnp.zeros(()))), scales)[0]
        return d, jnp.stack([k.astype(float), n.astype(float), left])  # derivatives need floats

    def solved(matvec, b, inverse):
        """Solution of a system of derivatives; not a number where it was not found."""
        found = linear_solve(matvec, b, inverse, derivative)
        good = found.residual <= 10.0 * derivative * jnp.linalg.norm(b)
        return jnp.where(good, found.x, jnp.nan)

    def tangent_solve(matvec, b):
        return jax.lax.custom_linear_solve(
            matvec,
            b,
            lambda A, b: solved(A, b, approximate(wall_solve)),
            lambda A, b: solved(A, b, approximate(wall_solve_transposed)),
        )

    flat, report = jax.lax.custom_root(
        lambda flat: out_of_balance(flat, 1.0),
        zero.reshape(-1),
        solve,
        tangent_solve,
        has_aux=True,
    )
    n_newton, n_gmres, left = jax.lax.stop_gradient(report)
    result = RESULTS.where(left <= tolerance, RESULTS.successful, RESULTS.not_converged)
    result = RESULTS.where(jnp.all(jnp.isfinite(flat)), result, RESULTS.not_finite)
    counts = n_newton.astype(int), n_gmres.astype(int)
    return Equilibrium(flat.reshape(3, -1), result, *counts, left)
