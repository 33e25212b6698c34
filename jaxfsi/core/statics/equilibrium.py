"""Equilibrium of the wall under pressures that follow it.

::

    ∫ (P(F) + F S₀) ∇N_a dV + support = Σ −∫ p N_a n da + f_a

over the deformed faces, with dead forces f. Newton's method with the tangent and GMRES,
preconditioned by the wall's factor at the reference shape; the load is raised in steps. The
derivative is that of the equilibrium (implicit function theorem); not a number where its system is
not solved in `max_iterations`.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.wall import Weights
from jaxfsi.core.laws.contact import contact_force, contact_product, contact_slope
from jaxfsi.core.laws.tissue import tissue_force
from jaxfsi.core.laws.wall_balance import WallShape, wall_geometry, wall_residual
from jaxfsi.core.solve.krylov import KrylovSolution, fgmres
from jaxfsi.core.solve.wall_blocks import vertex_block
from jaxfsi.core.solve.wall_factor import WallFactor, wall_factor, wall_solve, wall_solve_transposed
from jaxfsi.core.solve.wall_tangent import apply_wall, wall_tangent
from jaxfsi.core.statics.held import check_held
from jaxfsi.core.statics.loads import NO_WALL, Field, Loads, load_forces
from jaxfsi.core.step.model import Model
from lumped.device import quick_jit
from lumped.parameters import is_traced

STATIC = Weights(0.0, 0.0, 1.0)
"""The unknown of an equilibrium is the displacement."""

REDUCTION, DERIVATIVE = 1e-5, 1e-10
"""To what part of its right-hand side a system of Newton's method and of derivatives is solved."""


_tissue_force = quick_jit(tissue_force)


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


def static_factor(model: Model, *, dtype: type = np.float64) -> WallFactor:
    """Factor of the wall's stiffness at the reference shape of a concrete model.

    Raises:
        ValueError: the model has no wall, or nothing holds a part of it.
    """
    if model.wall is None:
        raise ValueError(NO_WALL)
    check_held(model)
    A = vertex_block(model, STATIC).tolil()
    everywhere = jnp.zeros_like(model.x).at[:, : model.n_vertices].set(1.0)
    support = _tissue_force(model.wall.support_stiffness * everywhere, model)
    A.setdiag(A.diagonal() + np.asarray(support).T.ravel())
    return wall_factor(sp.csr_matrix(A), model, STATIC, dtype=dtype)


def equilibrium(
    model: Model,
    loads: Loads,
    factor: WallFactor,
    *,
    n_load_steps: int = 1,
    tolerance: float = 1e-9,
    max_systems: int = 12,
    max_iterations: int = 100,
    reduction: float = REDUCTION,
    derivative: float = DERIVATIVE,
    start: Field | None = None,
    throw: bool = True,
) -> Equilibrium:
    """Displacement at which the wall is in equilibrium with its loads.

    Args:
        model: the model; its blood plays no part.
        loads: what acts on the wall.
        factor: see `static_factor`.
        n_load_steps: equal steps in which the load is raised.
        tolerance: forces out of balance over loads at which to stop.
        max_systems: linear systems in each load step at most.
        max_iterations: iterations of GMRES at most.
        reduction: to what part of its right-hand side a system of Newton's method is solved, or
            less far where the equilibrium asks for no more.
        derivative: to what part of its right-hand side a system of derivatives is solved.
        start: displacement from which the search sets out [cm]; None: that of the image, zero.
        throw: raise where no equilibrium is found; otherwise the result says so.

    Raises:
        ValueError: the model has no wall.
        RuntimeError: no equilibrium was found and `throw` is set.
    """
    if model.wall is None:
        raise ValueError(NO_WALL)
    options = (n_load_steps, tolerance, max_systems, max_iterations, reduction, derivative)
    start = jnp.zeros_like(model.x) if start is None else start
    wall = model.without_ports()
    end = _equilibrium(wall, loads, factor, jax.lax.stop_gradient(start), options)
    return _checked(end, throw)


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


def small_equilibrium(
    model: Model,
    force: Field,
    factor: WallFactor,
    *,
    tolerance: float = 1e-9,
    max_starts: int = 12,
    max_iterations: int = 100,
    throw: bool = True,
) -> Equilibrium:
    """Displacement of a wall of Hooke's law under dead forces: one linear system.

    Its derivatives are linear systems too, solved as far; not a number where that fails.

    Args:
        model: the model; its wall's material is `LinearElastic`, and it has no prestress. Sides
            that come close do not push each other apart.
        force: on the nodes [dyn].
        factor: see `static_factor`.
        tolerance: forces out of balance over loads at which to stop.
        max_starts: how often GMRES begins at most.
        max_iterations: its iterations at most.
        throw: raise where no equilibrium is found; otherwise the result says so.

    Raises:
        RuntimeError: no equilibrium was found and `throw` is set.
    """
    wall = model.without_ports()
    end = _small_equilibrium(wall, force, factor, (tolerance, max_starts, max_iterations))
    return _checked(end, throw)


@quick_jit
def _small_equilibrium(model, force, factor, options) -> Equilibrium:
    tolerance = options[0]
    factor = jax.lax.stop_gradient(factor)
    free = model.in_solid & ~model.prescribed
    shape = wall_geometry(model.x, model.element)
    alone = eqx.tree_at(lambda m: m.contact, model, None, is_leaf=lambda leaf: leaf is None)
    stiffness = _stiffness(jnp.zeros_like(model.x), alone, shape)
    b = jnp.where(free, force, 0.0).reshape(-1)
    size = jax.lax.stop_gradient(jnp.linalg.norm(b))

    def product(flat):
        v = jnp.where(free, flat.reshape(3, -1), 0.0)
        return jnp.where(free, stiffness(v), flat.reshape(3, -1)).reshape(-1)

    def solved(matvec, b):
        return _restarted(matvec, b, _inverse(wall_solve, factor, free), options)

    def solve(function, start):
        del function, start
        end, report = solved(product, b)
        return end.x, report

    def good(matvec, b):
        """Solution of a system of derivatives; not a number where it was not found."""
        end, _ = solved(matvec, b)
        found = end.residual <= 10.0 * tolerance * jnp.linalg.norm(b)
        return jnp.where(found, end.x, jnp.nan)

    def tangent_solve(matvec, b):
        return jax.lax.custom_linear_solve(matvec, b, good, symmetric=True)

    flat, report = jax.lax.custom_root(
        lambda flat: product(flat) - b, jnp.zeros_like(b), solve, tangent_solve, has_aux=True
    )
    n_starts, n_gmres, residual = jax.lax.stop_gradient(report)
    left = residual / jnp.where(size > 0.0, size, 1.0)
    return _ended(flat, tolerance, (n_starts.astype(int), n_gmres.astype(int)), left)


def _restarted(
    matvec: Callable[[Array], Array],
    b: Array,
    inverse: Callable[[Array], Array],
    options: tuple[float, int, int],
) -> tuple[KrylovSolution, Float[Array, " 3"]]:
    """GMRES begun anew from what it found, and numbers of starts, of iterations, the residual."""
    tolerance, max_starts, max_iterations = options
    goal = 0.9 * tolerance * jnp.linalg.norm(b)

    def proceed(s):
        _, k, _, last = s
        return (last > 0) & (k < max_starts)

    def correct(s):
        start, k, n, _ = s
        found = fgmres(
            matvec, b, inverse, tolerance=goal, max_iterations=max_iterations, along=start.x
        )
        return found, k + 1, n + found.n_iterations, found.n_iterations

    # A start evaluates what is left, and the last one finds that nothing is to be done; a part
    # of the tolerance is for the round-off between the two.
    none, one = jnp.zeros((), int), jnp.ones((), int)
    begun = KrylovSolution(jnp.zeros_like(b), none, jnp.linalg.norm(b))
    end, k, n, _ = jax.lax.while_loop(proceed, correct, (begun, none, none, one))
    return end, jnp.stack([k.astype(float), n.astype(float), end.residual])


def _inverse(solve: Callable, factor: WallFactor, free: Array) -> Callable[[Array], Array]:
    """Approximate inverse of a tangent that leaves held nodes as they are."""

    def inverse(r):
        r = r.reshape(3, -1)
        return jnp.where(free, solve(factor, jnp.where(free, r, 0.0)), r).reshape(-1)

    return inverse


def _ended(flat: Array, tolerance: float, counts: tuple[Array, Array], left: Array) -> Equilibrium:
    result = RESULTS.where(left <= tolerance, RESULTS.successful, RESULTS.not_converged)
    result = RESULTS.where(jnp.all(jnp.isfinite(flat)), result, RESULTS.not_finite)
    return Equilibrium(flat.reshape(3, -1), result, *counts, left)


def _checked(end: Equilibrium, throw: bool) -> Equilibrium:
    if throw and not is_traced(end.residual) and end.result != RESULTS.successful:
        raise RuntimeError(
            f"{RESULTS[end.result]} The forces are {float(end.residual):.1e} out of balance after"
            f" {int(end.n_newton)} linear systems."
        )
    return end


class _Search(NamedTuple):
    """State of Newton's method: displacement, load step, systems solved in it and in all."""

    d: Float[Array, " unknowns"]
    load: Int[Array, ""]
    k: Int[Array, ""]
    n_newton: Int[Array, ""]
    n_gmres: Int[Array, ""]
    left: Float[Array, ""]


@eqx.filter_jit
def _equilibrium(model, loads, factor, start, options) -> Equilibrium:
    n_load_steps, tolerance, max_systems, max_iterations, reduction, derivative = options
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
        return _inverse(solve, factor, free)

    def linear_solve(matvec, b, inverse, reduction):
        return fgmres(
            matvec,
            b,
            inverse,
            tolerance=reduction * jnp.linalg.norm(b),
            max_iterations=max_iterations,
        )

    def correction(d, r, scale, left):
        goal = jnp.maximum(0.3 * tolerance / left, reduction)
        return linear_solve(tangent(d, scale), r, approximate(wall_solve), goal)

    def solve(function, start):
        """Newton's method at one load after the other."""
        del function
        scales = jnp.arange(1, n_load_steps + 1) / n_load_steps

        def proceed(s):
            return s.load < n_load_steps

        def advance(s):
            scale = scales[s.load]
            r = out_of_balance(s.d, scale)
            left = jnp.linalg.norm(r) / size
            settled = ~(left > tolerance) | (s.k >= max_systems)
            none = KrylovSolution(jnp.zeros_like(r), jnp.zeros((), int), jnp.zeros(()))
            step = jax.lax.cond(settled, lambda: none, lambda: correction(s.d, r, scale, left))
            return _Search(
                s.d - step.x,
                s.load + jnp.where(settled, 1, 0),
                jnp.where(settled, 0, s.k + 1),
                s.n_newton + jnp.where(settled, 0, 1),
                s.n_gmres + step.n_iterations,
                left,
            )

        zero = jnp.zeros((), int)
        end = jax.lax.while_loop(
            proceed, advance, _Search(start, zero, zero, zero, zero, jnp.zeros(()))
        )
        counts = end.n_newton.astype(float), end.n_gmres.astype(float)
        return end.d, jnp.stack([*counts, end.left])  # derivatives need floats

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
        start.reshape(-1),
        solve,
        tangent_solve,
        has_aux=True,
    )
    n_newton, n_gmres, left = jax.lax.stop_gradient(report)
    return _ended(flat, tolerance, (n_newton.astype(int), n_gmres.astype(int)), left)
