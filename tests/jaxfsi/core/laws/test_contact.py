"""Opposite sides of a lumen keep their least gap."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.core.laws.contact import (
    LeastGap,
    contact_force,
    contact_pairs,
    contact_product,
    contact_slope,
    gaps,
)
from jaxfsi.core.laws.materials import NeoHookean
from jaxfsi.core.laws.mesh_motion import mesh_motion
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.solve.tangent import apply_elements, step_tangent
from jaxfsi.core.statics.equilibrium import equilibrium, static_factor
from jaxfsi.core.statics.loads import Loads, pressure_load
from jaxfsi.core.step.equations import Unknowns, begin_step, midpoint, residual
from jaxfsi.core.step.generalized_alpha import generalized_alpha
from jaxfsi.core.step.model import build_model
from jaxfsi.core.step.state import initial_state
from jaxfsi.mesh import INTERFACE, OUTER_WALL, Region
from jaxfsi.mesh_parts import submesh
from jaxfsi.verification import slit_mesh, slit_model
from jaxfsi.verification.closing_slit import HEIGHT, LENGTH, WIDTH

LAW = LeastGap(gap=0.02, stiffness=1e6)


@pytest.fixture(scope="module")
def mesh():
    return slit_mesh(n_around=16, n_axial=4)


@pytest.fixture(scope="module")
def contact(mesh):
    return contact_pairs(LAW, mesh.points, mesh.labelled(INTERFACE))


def _flat(x, share):
    """Displacement that presses the slit to a share of its height."""
    return jnp.stack([0.0 * x[0], -(1.0 - share) * x[1], 0.0 * x[2]])


def _energy(d, x, contact):
    """Written out from the docstring, pair by pair."""
    closest = jnp.minimum(contact.law.gap, gaps(x, contact) / 2.0)
    s = jnp.maximum(1.0 - gaps(x + d, contact) / closest, 0.0)
    sides = x[:, contact.faces]
    cross = jnp.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0], axis=0)
    third = jnp.linalg.norm(cross, axis=0) / 6.0
    area = jnp.zeros(x.shape[1]).at[contact.faces].add(third)
    return jnp.sum(area[contact.node] / 2.0 * contact.law.stiffness * closest * s**3 / 3.0)


def test_pairs_are_opposite_points_of_the_slit(mesh, contact):
    x = jnp.asarray(mesh.points.T)
    weight = np.asarray(contact.weight)
    np.testing.assert_allclose(weight.sum(axis=0), 1.0, atol=1e-12)
    assert np.min(weight) > -1e-8
    partner = np.einsum("kp,ikp->ip", weight, np.asarray(x)[:, np.asarray(contact.opposite)])
    from_node = partner - np.asarray(x)[:, np.asarray(contact.node)]
    across = np.asarray(contact.normal) * np.asarray(gaps(x, contact))
    np.testing.assert_allclose(from_node, across, atol=1e-12)
    middle = np.abs(np.asarray(x)[0, np.asarray(contact.node)]) < 1e-9
    # At the ends the triangles round a vertex lean, and so does its normal.
    np.testing.assert_allclose(np.asarray(gaps(x, contact))[middle], HEIGHT, rtol=1e-3)


@pytest.mark.parametrize("share", [1.0, 0.25])
def test_sides_that_are_far_enough_apart_feel_nothing(mesh, contact, share):
    x = jnp.asarray(mesh.points.T)
    middle = jnp.abs(x[0]) < 0.1  # the edges of the slit have gaps of their own
    force = contact_force(_flat(x, share), x, contact)
    np.testing.assert_array_equal(jnp.where(middle, force, 0.0), 0.0)
    if share == 1.0:
        np.testing.assert_array_equal(force, 0.0)


def test_pressure_is_that_of_the_law(mesh, contact):
    """At half the least gap a pair pushes with a quarter of κ on half the area of its vertex."""
    x = jnp.asarray(mesh.points.T)
    at = int(np.argmin(np.linalg.norm(mesh.points - [0.0, HEIGHT / 2.0, LENGTH / 2.0], axis=1)))
    k = int(np.flatnonzero(np.asarray(contact.node) == at)[0])
    one = dataclasses.replace(
        contact,
        node=contact.node[k : k + 1],
        **{n: getattr(contact, n)[:, k : k + 1] for n in ("opposite", "weight", "normal")},
    )
    faces = mesh.labelled(INTERFACE)
    sides = mesh.points[faces[np.any(faces == at, axis=1)]]
    area = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])
    area = np.linalg.norm(area, axis=1).sum() / 6.0
    force = np.asarray(contact_force(_flat(x, 0.1), x, one))
    # Force of the law on the vertex is minus the derivative of the energy.
    np.testing.assert_allclose(-force[:, at], [0.0, area / 2.0 * 2.5e5, 0.0], atol=1e-6)
    np.testing.assert_allclose(force.sum(axis=1), 0.0, atol=1e-6)


def test_force_is_conservative_and_has_no_resultant(mesh, contact):
    x = jnp.asarray(mesh.points.T)
    rng = np.random.default_rng(0)
    d = _flat(x, 0.12) + 1e-3 * jnp.asarray(rng.standard_normal(x.shape))
    force = contact_force(d, x, contact)
    np.testing.assert_allclose(force, jax.grad(_energy)(d, x, contact), atol=1e-9)
    scale = float(jnp.max(jnp.abs(force)))
    np.testing.assert_allclose(jnp.sum(force, axis=1), 0.0, atol=1e-10 * scale)


def test_product_is_the_derivative_of_the_force(mesh, contact):
    x = jnp.asarray(mesh.points.T)
    d, v = _flat(x, 0.12), jnp.asarray(np.random.default_rng(1).standard_normal(x.shape))
    _, exact = jax.jvp(lambda d: contact_force(d, x, contact), (d,), (v,))
    found = contact_product(contact_slope(d, x, contact), v, contact)
    np.testing.assert_allclose(found, exact, rtol=1e-12, atol=1e-6)


def test_equations_of_a_step_and_their_tangent_have_the_contact(mesh):
    model = slit_model(mesh, least_gap=LeastGap(gap=0.06))
    method, dt = generalized_alpha(), jnp.asarray(1e-3)
    x, rng = model.x, np.random.default_rng(2)
    taper = jnp.sin(jnp.pi * x[2] / LENGTH)
    lumen = HEIGHT / 2.0 * jnp.sqrt(jnp.clip(1.0 - (2.0 * x[0] / WIDTH) ** 2, 0.0))
    down = -0.65 * taper * jnp.clip(x[1], -lumen, lumen)  # the wall keeps its thickness
    d = jnp.where(model.in_solid, jnp.stack([0.0 * down, down, 0.0 * down]), 0.0)
    state = initial_state(model)._replace(d=d, d_before=d)
    v = Unknowns(jnp.asarray(rng.standard_normal(x.shape)), 0.0 * x[0])

    @eqx.filter_jit
    def evaluated(stiffness, motion):
        changed = eqx.tree_at(lambda m: m.contact.law.stiffness, model, stiffness)
        step = begin_step(dt, changed, state, method, motion)
        y = Unknowns(state.u, state.p)
        tangent = step_tangent(y, changed, step, method)
        d = midpoint(y, step, method)[2]
        r = residual(y, changed, step, method)
        return r.u, apply_elements(tangent, v, changed, step, method).u, d

    motion = mesh_motion(model)
    (r, product, at), (r_free, free, _) = (evaluated(jnp.asarray(k), motion) for k in (1e6, 0.0))
    w_d = method.weights(dt)[2]

    def force(d):
        return jnp.where(model.prescribed, 0.0, contact_force(d, x, model.contact))

    expected, change = jax.jvp(force, (at,), (w_d * v.u,))
    size = float(jnp.max(jnp.abs(expected)))
    assert size > 0.0
    # round-off of the sums of all other forces
    np.testing.assert_allclose(r - r_free, expected, atol=1e-9 * float(jnp.max(jnp.abs(r))))
    scale = float(jnp.max(jnp.abs(product)))
    assert float(jnp.max(jnp.abs(change))) > 1e-3 * scale
    np.testing.assert_allclose(product - free, change, atol=1e-9 * scale)


@pytest.fixture(scope="module")
def pressed(mesh):
    """Gap half-way along the wall of the slit under a pressure outside that would close it."""
    part = submesh(mesh, Region.SOLID).mesh
    wall = Wall(NeoHookean(1e6, 0.3))
    model = build_model(part, {}, wall=wall, least_gap=LAW)
    loads = Loads((pressure_load(part, OUTER_WALL, 2e4, model),))
    factor = static_factor(model)

    def gap(stiffness, least):
        law = LeastGap(gap=least, stiffness=stiffness)
        changed = eqx.tree_at(lambda m: m.contact.law, model, law)
        end = equilibrium(changed, loads, factor, n_load_steps=8, max_systems=30, tolerance=1e-8)
        return jnp.min(gaps(model.x + end.d, model.contact))

    return gap


def test_wall_stands_at_the_gap(pressed):
    assert 0.0 < float(jax.jit(pressed)(1e6, 0.02)) < 0.02


@pytest.mark.slow  # its parts are quick: contact above, an equilibrium in test_equilibrium.py
def test_derivative_of_the_gap_is_exact(pressed):
    both = jax.jit(jax.value_and_grad(pressed, argnums=(0, 1)))
    _, slopes = both(1e6, 0.02)
    for k, step in enumerate((1e3, 2e-5)):
        change = [0.0, 0.0]
        change[k] = step
        up, down = (both(1e6 + q * change[0], 0.02 + q * change[1])[0] for q in (1.0, -1.0))
        # central differences of a law with a bounded second derivative
        assert float(slopes[k]) == pytest.approx(float(up - down) / (2.0 * step), rel=1e-3)


def test_numbers_out_of_range_are_refused():
    for numbers in ({"gap": 0.0}, {"gap": -0.01}, {"gap": 0.01, "stiffness": 0.0}):
        with pytest.raises(ValueError, match="must be"):
            LeastGap(**numbers)
