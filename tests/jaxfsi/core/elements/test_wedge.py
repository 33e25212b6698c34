"""Solid-shell wedges: patch test, zero modes, rigid motion, energy, derivatives, mass."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.core.elements.wall import Weights
from jaxfsi.core.elements.wedge import (
    WedgeElement,
    compatible_gradient,
    wedge_corners,
    wedge_geometry,
)
from jaxfsi.core.laws.materials import LinearElastic, SaintVenantKirchhoff, stacked
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.laws.wedge_solid import (
    apply_wedges,
    element_matrices,
    wedge_prestress,
    wedge_residual,
    wedge_stress,
    wedge_stress_and_strain,
    wedge_tangent,
)
from jaxfsi.meshing import strip
from jaxfsi.verification import MATERIALS

materials = pytest.mark.parametrize("material", MATERIALS.values(), ids=MATERIALS)
WITHIN_OTHERS = ("st_venant_kirchhoff", "neo_hookean")
"""Laws that `MATERIALS` has again with a penalty or another Poisson's ratio."""
STATIC = Weights(jnp.zeros(()), jnp.zeros(()), jnp.ones(()))
H = jnp.asarray([[0.1, -0.05, 0.02], [0.08, -0.1, 0.04], [0.0, 0.03, 0.06]])


@pytest.fixture(scope="module")
def plate():
    """Positions, wedges, their shape, and nodes inside a plate of distorted wedges."""
    mesh = strip(length=1.0, width=1.0, thickness=0.2, n_length=4, n_width=4, n_layers=1)
    rng = np.random.default_rng(1)
    points = mesh.points.copy()
    inner = np.flatnonzero(np.all((points[:, :2] > 0.01) & (points[:, :2] < 0.99), axis=1))
    low = inner[: len(inner) // 2]
    shift = 0.04 * rng.standard_normal((len(low), 2))
    points[low, :2] += shift
    points[low + len(points) // 2, :2] += shift  # columns stay upright
    x = jnp.asarray(points.T)
    wedges = WedgeElement(jnp.asarray(mesh.wedges.T, jnp.int32))
    return x, wedges, wedge_geometry(x, wedges), inner


def _forces(d, wall, wedges, shape, prestress=None):
    zero = jnp.zeros_like(d)
    return wedge_residual(zero, zero, d, wall, wedges, shape, prestress)


def _membrane(x):
    """Uniform strain whose stress leaves the faces of the plate free, of a small size."""
    small = 1e-6
    nu = 0.3
    e_x, e_y, g = small, -0.4 * small, 0.3 * small
    e_z = -nu / (1.0 - nu) * (e_x + e_y)
    return jnp.stack([e_x * x[0] + g * x[1], g * x[0] + e_y * x[1], e_z * x[2]])


def test_uniform_strain_leaves_inner_nodes_in_balance(plate):
    x, wedges, shape, inner = plate
    for material in (LinearElastic(3e6, 0.3), SaintVenantKirchhoff(3e6, 0.3)):
        r = _forces(_membrane(x), Wall(material), wedges, shape)
        at_the_rim = float(jnp.max(jnp.abs(r)))
        # Quadratic terms of a strain of 1e-6 are 1e-6 of the forces.
        assert float(jnp.max(jnp.abs(r[:, inner]))) < 3e-6 * at_the_rim


@materials
def test_stress_of_uniform_deformation_is_that_of_the_law(plate, material):
    x, wedges, shape, _ = plate
    F = jnp.eye(3) + 0.3 * H
    S = wedge_stress(F @ x - x, material, wedges, shape)
    one = jnp.ones(wedges.n)
    rows = [[F[i, j] * one for j in range(3)] for i in range(3)]
    P = jnp.asarray([[v[0] for v in row] for row in material.stress(rows)])
    expected = P if material.is_small_strain else jnp.linalg.solve(F, P)
    np.testing.assert_allclose(
        S, jnp.broadcast_to(expected[:, :, None, None], S.shape), atol=1e-6 * float(jnp.max(abs(P)))
    )


@pytest.mark.parametrize(
    "material",
    [
        # the slow ones are fast twins with a penalty and another Poisson's ratio
        pytest.param(law, marks=[pytest.mark.slow] if name in WITHIN_OTHERS else [], id=name)
        for name, law in MATERIALS.items()
    ],
)
def test_forces_are_the_gradient_of_an_energy(plate, material):
    x, wedges, shape, _ = plate
    wall = Wall(material)
    key = jax.random.key(0)
    d = 0.004 * jax.random.normal(key, x.shape)
    v, w = (jax.random.normal(k, x.shape) for k in jax.random.split(key))

    @jax.jit
    def product(v):
        return jax.jvp(lambda d: _forces(d, wall, wedges, shape), (d,), (v,))[1]

    K_v, K_w = product(v), product(w)
    np.testing.assert_allclose(jnp.sum(w * K_v), jnp.sum(v * K_w), rtol=1e-6)
    tangent = wedge_tangent(jnp.zeros_like(x), d, STATIC, wall, wedges, shape)
    applied = apply_wedges(tangent, v, wedges, shape)
    np.testing.assert_allclose(applied, K_v, atol=1e-6 * float(jnp.max(abs(K_v))))


@pytest.mark.parametrize("law", ["linear", "neo_hookean"])
def test_tangent_has_the_prestress_also_along_the_columns(plate, law):
    x, wedges, shape, _ = plate
    wall = Wall(MATERIALS[law])
    hooke = LinearElastic.of_moduli(*wall.material.moduli)
    d, e, v = (
        0.004 * jax.random.normal(k, x.shape) for k in jax.random.split(jax.random.key(6), 3)
    )
    prestress = wedge_prestress(e, hooke, wedges, shape)
    assert float(jnp.max(jnp.abs(prestress.columns))) > 0.0
    _, change = jax.jvp(lambda d: _forces(d, wall, wedges, shape, prestress), (d,), (v,))
    tangent = wedge_tangent(jnp.zeros_like(x), d, STATIC, wall, wedges, shape, prestress)
    found = apply_wedges(tangent, v, wedges, shape)
    np.testing.assert_allclose(found, change, atol=1e-6 * float(jnp.max(abs(change))))


def test_prestress_of_a_small_displacement_pushes_as_the_displacement_does(plate):
    x, wedges, shape, _ = plate
    wall = Wall(MATERIALS["linear"])
    e = 0.004 * jax.random.normal(jax.random.key(7), x.shape)
    prestress = wedge_prestress(e, wall.material, wedges, shape)
    due = _forces(e, wall, wedges, shape)
    pushed = _forces(jnp.zeros_like(x), wall, wedges, shape, prestress)
    np.testing.assert_allclose(pushed, due, atol=1e-9 * float(jnp.max(abs(due))))


@pytest.mark.parametrize(
    "law", ["linear", "st_venant_kirchhoff", "neo_hookean_nearly_incompressible"]
)
def test_wedge_has_the_six_rigid_modes_and_no_more(law):
    """On the mesh whose triangles have three colours, where one point in plane leaves two more."""
    mesh = strip(length=1.0, width=1.0, thickness=0.2, n_length=4, n_width=4, n_layers=1)
    x, wedges = jnp.asarray(mesh.points.T), WedgeElement(jnp.asarray(mesh.wedges.T, jnp.int32))
    shape, wall = wedge_geometry(x, wedges), Wall(MATERIALS[law])
    zero = jnp.zeros_like(x)
    tangent = wedge_tangent(zero, zero, STATIC, wall, wedges, shape)
    values = np.asarray(element_matrices(tangent))
    unknowns = (3 * mesh.wedges[:, :, None] + np.arange(3)).reshape(-1, 18)
    K = np.zeros((3 * len(mesh.points),) * 2)
    for dofs, block in zip(unknowns, values, strict=True):
        K[np.ix_(dofs, dofs)] += block
    np.testing.assert_allclose(K, K.T, atol=1e-9 * np.max(np.abs(K)))
    modes = np.linalg.eigvalsh(K)
    assert modes[5] < 1e-10 * modes[-1]
    assert modes[6] > 1e-6 * modes[-1]


def test_finite_rotation_costs_no_energy_and_turns_the_stress(plate):
    x, wedges, shape, _ = plate
    angle = 1.1
    c, s = np.cos(angle), np.sin(angle)
    R = jnp.asarray([[c, -s, 0.0], [0.6 * s, 0.6 * c, -0.8], [0.8 * s, 0.8 * c, 0.6]])
    wall = Wall(MATERIALS["neo_hookean"])
    r = _forces(R @ x - x, wall, wedges, shape)
    stiff = _forces(1.01 * x - x, wall, wedges, shape)
    assert float(jnp.max(jnp.abs(r))) < 1e-12 * float(jnp.max(jnp.abs(stiff))) * 100.0
    F = jnp.eye(3) + 0.3 * H
    zero = jnp.zeros_like(x)
    plain = wedge_stress_and_strain(zero, F @ x - x, wall, wedges, shape)
    turned = wedge_stress_and_strain(zero, R @ F @ x - x, wall, wedges, shape)
    size = float(jnp.max(jnp.abs(plain.sigma)))
    np.testing.assert_allclose(
        turned.sigma, jnp.einsum("ij,jkpe,lk->ilpe", R, plain.sigma, R), atol=1e-8 * size
    )
    np.testing.assert_allclose(turned.strain, plain.strain, atol=1e-10)


def test_compatible_gradient_of_uniform_deformation(plate):
    x, wedges, shape, _ = plate
    F = jnp.eye(3) + H
    found = stacked(compatible_gradient(wedge_corners(F @ x, wedges), shape))
    for point in (0, 1):
        np.testing.assert_allclose(found[:, :, point, 0], F, atol=1e-12)


def test_mass_is_that_of_the_volume(plate):
    x, wedges, shape, _ = plate
    wall = Wall(MATERIALS["linear"], rho_s=1.1)
    zero = jnp.zeros_like(x)
    push = wedge_residual(zero, jnp.ones_like(x), zero, wall, wedges, shape)
    np.testing.assert_allclose(jnp.sum(push, axis=1), 1.1 * 0.2, rtol=1e-12)


def test_damping_works_against_the_motion(plate):
    x, wedges, shape, _ = plate
    wall = Wall(MATERIALS["neo_hookean"], damping=10.0)
    d = 0.01 * (H @ x)
    u = jax.random.normal(jax.random.key(2), x.shape)
    zero = jnp.zeros_like(x)
    damped = wedge_residual(u, zero, d, wall, wedges, shape)
    still = wedge_residual(zero, zero, d, wall, wedges, shape)
    assert float(jnp.sum(u * (damped - still))) > 0.0
    rigid = jnp.ones_like(x)
    np.testing.assert_allclose(
        wedge_residual(rigid, zero, d, wall, wedges, shape), still, atol=1e-9
    )


@pytest.mark.parametrize(
    "law",
    [
        # its twin is the finite law, whose derivatives have these and more
        pytest.param("linear", marks=pytest.mark.slow),
        "neo_hookean",
    ],
)
def test_derivatives_by_position_and_moduli_agree_with_differences(plate, law):
    x, wedges, _, _ = plate
    material = MATERIALS[law]
    key = jax.random.key(3)
    d = 0.004 * jax.random.normal(key, x.shape)
    weight = jax.random.normal(jax.random.key(4), x.shape)
    along = jax.random.normal(jax.random.key(5), x.shape)

    @jax.jit
    @partial(jax.value_and_grad, argnums=(0, 1))  # one program for all
    def both(x, E):
        own = eqx.tree_at(lambda m: m.E, material, E)
        return jnp.sum(weight * _forces(d, Wall(own), wedges, wedge_geometry(x, wedges)))

    def value(x, E):
        return both(x, E)[0]

    _, (by_x, by_E) = both(x, 3e6)
    h = 1e-6
    slope = (value(x + h * along, 3e6) - value(x - h * along, 3e6)) / (2.0 * h)
    np.testing.assert_allclose(jnp.sum(by_x * along), slope, rtol=1e-6)
    slope = (value(x, 3e6 + 10.0) - value(x, 3e6 - 10.0)) / 20.0
    np.testing.assert_allclose(by_E, slope, rtol=1e-6)
