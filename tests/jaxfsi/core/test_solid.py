"""Forces of the wall: patch test, energy, rigid motion, prestress, damping."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.core.elements import geometry
from jaxfsi.core.materials import LinearElastic, NeoHookean
from jaxfsi.core.solid import Wall, deformation_gradient, solid_residual
from jaxfsi.meshing import strip
from jaxfsi.verification import ENERGIES, MATERIALS

materials = pytest.mark.parametrize("material", MATERIALS.values(), ids=MATERIALS)


@pytest.fixture(scope="module")
def block():
    mesh = strip(length=1.0, width=0.5, thickness=0.4, n_length=4, n_width=3, n_layers=3)
    rng = np.random.default_rng(0)
    inner = np.setdiff1d(mesh.tets, mesh.faces)
    points = mesh.points.copy()
    points[inner] += 0.02 * rng.standard_normal((len(inner), 3))
    x, tets = jnp.asarray(points.T), jnp.asarray(mesh.tets.T)
    return x, tets, geometry(x, tets), inner


def _zero(x):
    return jnp.zeros_like(x)


@materials
def test_uniform_deformation_leaves_inner_nodes_in_balance(block, material):
    x, tets, shape, inner = block
    H = jnp.asarray([[0.1, -0.05, 0.02], [0.08, -0.1, 0.04], [0.0, 0.03, 0.06]])
    r = solid_residual(_zero(x), _zero(x), H @ x, Wall(material), tets, shape)
    # The patch test: uniform stress has no divergence. Forces elsewhere are about 1e4 dyn.
    np.testing.assert_allclose(r[:, inner], 0.0, atol=1e-8)
    np.testing.assert_allclose(jnp.sum(r, axis=1), 0.0, atol=1e-7)


@materials
def test_forces_are_the_derivative_of_the_stored_energy(block, material):
    x, tets, shape, _ = block
    d = 0.02 * jnp.asarray(np.random.default_rng(1).standard_normal(x.shape))
    density = ENERGIES[type(material)]

    def energy(d):
        F = deformation_gradient(d, tets, shape)
        return jnp.sum(shape.volume * jax.vmap(lambda f: density(material, f), 2)(F))

    r = solid_residual(_zero(x), _zero(x), d, Wall(material), tets, shape)
    expected = jax.grad(energy)(d)
    np.testing.assert_allclose(r, expected, atol=1e-10 * float(jnp.max(jnp.abs(expected))))


def test_turning_the_wall_costs_no_force_unless_it_is_linear(block):
    x, tets, shape, _ = block
    angle = 0.7
    turn = jnp.asarray(
        [[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0, 0, 1.0]]
    )
    d = turn @ x - x
    for material in MATERIALS.values():
        r = solid_residual(_zero(x), _zero(x), d, Wall(material), tets, shape)
        largest = float(jnp.max(jnp.abs(r)))
        if isinstance(material, LinearElastic):
            assert largest > 1e4
        else:
            assert largest < 1e-7


def test_inertia_sums_to_mass_times_acceleration_and_is_exact_for_linear_fields(block):
    x, tets, shape, _ = block
    wall = Wall(MATERIALS["linear"], rho_s=1.3)
    a = jnp.asarray([[1.0], [-2.0], [0.5]]) * x[0] ** 1
    r = solid_residual(_zero(x), a, _zero(x), wall, tets, shape)
    mean = jnp.mean(a[:, tets], axis=1)
    np.testing.assert_allclose(
        jnp.sum(r, axis=1), 1.3 * jnp.sum(shape.volume * mean, axis=1), rtol=1e-12
    )
    # x·M a with the consistent mass matrix is ∫ ρ x a, here on a box of length 1: 1/3 of ρ V.
    volume = float(jnp.sum(shape.volume))
    assert float(jnp.sum(x[0] * r[0])) == pytest.approx(1.3 * volume / 3.0, rel=0.02)


def test_damping_dissipates_twice_eta_times_the_square_of_the_strain_rate(block):
    x, tets, shape, _ = block
    eta = 2e3
    slope = jnp.asarray([[2.0, 1.0, 0.0], [-3.0, 0.5, 1.0], [0.0, 0.0, -1.0]])
    rigid = jnp.asarray([[0.0, -4.0, 1.0], [4.0, 0.0, 2.0], [-1.0, -2.0, 0.0]])
    wall = Wall(NeoHookean(1e6, 0.3), damping=eta)
    for gradient in (slope, slope + rigid):
        u = gradient @ x
        r = solid_residual(u, _zero(x), _zero(x), wall, tets, shape)
        strain = (slope + slope.T) / 2.0
        expected = 2.0 * eta * jnp.sum(strain**2) * jnp.sum(shape.volume)
        assert float(jnp.sum(u * r)) == pytest.approx(float(expected), rel=1e-10)


def test_prestress_is_the_stress_of_the_undeformed_wall_and_turns_with_it(block):
    x, tets, shape, _ = block
    S0 = jnp.asarray([[4.0, 1.0, 0.0], [1.0, -2.0, 0.5], [0.0, 0.5, 3.0]]) * 1e4
    prestress = jnp.broadcast_to(S0[:, :, None], (3, 3, tets.shape[1]))
    wall = Wall(NeoHookean(1e6, 0.3))
    r = solid_residual(_zero(x), _zero(x), _zero(x), wall, tets, shape, prestress)
    # Virtual work of a linear displacement H x is ∫ S₀ : H.
    H = jnp.asarray([[1.0, 2.0, 0.0], [0.0, -1.0, 1.0], [0.3, 0.0, 0.7]])
    work = float(jnp.sum((H @ x) * r))
    assert work == pytest.approx(float(jnp.sum(S0 * H) * jnp.sum(shape.volume)), rel=1e-10)
    q = jnp.asarray([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turned = solid_residual(_zero(x), _zero(x), q @ x - x, wall, tets, shape, prestress)
    np.testing.assert_allclose(turned, q @ r, atol=1e-7)


def test_tangent_at_the_reference_is_symmetric_with_six_rigid_modes(block):
    x, tets, shape, _ = block

    def force(flat):
        d = flat.reshape(x.shape)
        return solid_residual(
            _zero(x), _zero(x), d, Wall(NeoHookean(1e6, 0.3)), tets, shape
        ).reshape(-1)

    K = jax.jit(jax.jacfwd(force))(jnp.zeros(x.size))
    np.testing.assert_allclose(K, K.T, atol=1e-9 * float(jnp.max(K)))
    values = np.linalg.eigvalsh(np.asarray(K))
    assert np.sum(np.abs(values) < 1e-9 * values[-1]) == 6
    assert values[6] > 1e-4 * values[-1]
