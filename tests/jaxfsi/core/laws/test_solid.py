"""Forces of the wall with both elements: patch test, energy, rigid motion, prestress, damping."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.core.elements.linear import geometry
from jaxfsi.core.elements.quadratic import FAR, NEAR, QuadraticElement, numbered_edges
from jaxfsi.core.elements.wall import LinearElement, Weights
from jaxfsi.core.laws.materials import LinearElastic, NeoHookean, stacked
from jaxfsi.core.laws.solid import (
    Wall,
    cauchy_stress,
    deformation_gradients,
    solid_residual,
)
from jaxfsi.core.solve.wall_tangent import apply_wall, wall_tangent
from jaxfsi.meshing import strip
from jaxfsi.verification import ENERGIES, MATERIALS, VOLUME_ENERGIES

AGAIN = ("st_venant_kirchhoff", "neo_hookean")
"""Laws that `MATERIALS` has again with a penalty or another Poisson's ratio."""

materials = pytest.mark.parametrize(
    "material",
    [
        # the slow ones are fast twins with a penalty and another Poisson's ratio
        pytest.param(law, marks=[pytest.mark.slow] if name in AGAIN else [], id=name)
        for name, law in MATERIALS.items()
    ],
)


@pytest.fixture(scope="module", params=["linear", "quadratic"])
def block(request):
    """Positions, element, its shape, inner unknowns, and ends of the edges with an unknown."""
    mesh = strip(length=1.0, width=0.5, thickness=0.4, n_length=4, n_width=3, n_layers=3)
    rng = np.random.default_rng(0)
    inner = np.setdiff1d(mesh.tets, mesh.faces)
    points = mesh.points.copy()
    points[inner] += 0.02 * rng.standard_normal((len(inner), 3))
    n, tets = len(points), jnp.asarray(mesh.tets.T)
    shape = geometry(jnp.asarray(points.T), tets)
    if request.param == "linear":
        return jnp.asarray(points.T), LinearElement(tets), shape, inner
    ends, index = numbered_edges(mesh.tets)
    outer, _ = numbered_edges(np.column_stack([mesh.faces, mesh.faces[:, 0]]))
    outer = {tuple(e) for e in outer}
    inside = [n + k for k, e in enumerate(ends) if tuple(e) not in outer]
    x = np.concatenate([points, np.zeros((len(ends), 3))])
    element = QuadraticElement(tets, jnp.asarray(n + index.T))
    return jnp.asarray(x.T), element, shape, np.concatenate([inner, inside])


def _zero(x):
    return jnp.zeros_like(x)


@materials
def test_uniform_deformation_leaves_inner_nodes_in_balance(block, material):
    x, element, shape, inner = block
    H = jnp.asarray([[0.1, -0.05, 0.02], [0.08, -0.1, 0.04], [0.0, 0.03, 0.06]])
    r = solid_residual(_zero(x), _zero(x), H @ x, Wall(material), element, shape)
    # The patch test: uniform stress has no divergence. Forces elsewhere are about 1e4 dyn.
    np.testing.assert_allclose(r[:, inner], 0.0, atol=1e-8)
    np.testing.assert_allclose(jnp.sum(r, axis=1), 0.0, atol=1e-7)


@materials
def test_forces_are_the_derivative_of_the_stored_energy(block, material):
    x, element, shape, _ = block
    d = 0.004 * jnp.asarray(np.random.default_rng(1).standard_normal(x.shape))
    density = ENERGIES[type(material)]

    def energy(d):
        whole = stacked(deformation_gradients(d, element, shape))
        F = [whole[:, :, g] for g in range(whole.shape[2])]
        if isinstance(element, LinearElement):
            return jnp.sum(shape.volume * jax.vmap(lambda f: density(material, f), 2)(F[0]))
        law, moduli = material.split()
        quarter = shape.volume / 4.0
        stored = sum(jnp.sum(quarter * jax.vmap(lambda f: density(law, f), 2)(f)) for f in F)
        share = jnp.zeros(x.shape[1]).at[element.tets].add(jnp.stack([quarter] * 4))
        used = np.unique(element.tets)
        near = np.full((4, 4), FAR) + (NEAR - FAR) * np.eye(4)
        for m, (k, U) in enumerate(zip(moduli, VOLUME_ENERGIES[type(material)], strict=True)):
            q = jnp.stack([material.volumes(f)[m].value for f in F])
            sums = jnp.zeros(x.shape[1]).at[element.tets].add(quarter * (near @ q))
            stored += jnp.sum(k * share[used] * U(sums[used] / share[used]))
        return stored

    r = solid_residual(_zero(x), _zero(x), d, Wall(material), element, shape)
    expected = jax.grad(energy)(d)
    np.testing.assert_allclose(r, expected, atol=1e-10 * float(jnp.max(jnp.abs(expected))))


def test_turning_the_wall_costs_no_force_unless_it_is_linear(block):
    x, element, shape, _ = block
    angle = 0.7
    turn = jnp.asarray(
        [[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0, 0, 1.0]]
    )
    d = turn @ x - x
    for material in MATERIALS.values():
        r = solid_residual(_zero(x), _zero(x), d, Wall(material), element, shape)
        largest = float(jnp.max(jnp.abs(r)))
        if isinstance(material, LinearElastic):
            assert largest > 1e4
        else:
            assert largest < 1e-7


def test_inertia_sums_to_mass_times_acceleration_and_is_exact_for_linear_fields(block):
    x, element, shape, _ = block
    wall = Wall(MATERIALS["linear"], rho_s=1.3)
    a = jnp.asarray([[1.0], [-2.0], [0.5]]) * x[0] ** 1
    r = solid_residual(_zero(x), a, _zero(x), wall, element, shape)
    mean = jnp.mean(a[:, element.tets], axis=1)
    vertices = np.unique(element.tets)
    np.testing.assert_allclose(
        jnp.sum(r[:, vertices], axis=1), 1.3 * jnp.sum(shape.volume * mean, axis=1), rtol=1e-12
    )
    # x·M a with the consistent mass matrix is ∫ ρ x a, here on a box of length 1: 1/3 of ρ V.
    volume = float(jnp.sum(shape.volume))
    assert float(jnp.sum(x[0] * r[0])) == pytest.approx(1.3 * volume / 3.0, rel=0.02)


def test_damping_dissipates_twice_eta_times_the_square_of_the_strain_rate(block):
    x, element, shape, _ = block
    eta = 2e3
    slope = jnp.asarray([[2.0, 1.0, 0.0], [-3.0, 0.5, 1.0], [0.0, 0.0, -1.0]])
    rigid = jnp.asarray([[0.0, -4.0, 1.0], [4.0, 0.0, 2.0], [-1.0, -2.0, 0.0]])
    wall = Wall(NeoHookean(1e6, 0.3), damping=eta)
    for gradient in (slope, slope + rigid):
        u = gradient @ x
        r = solid_residual(u, _zero(x), _zero(x), wall, element, shape)
        strain = (slope + slope.T) / 2.0
        expected = 2.0 * eta * jnp.sum(strain**2) * jnp.sum(shape.volume)
        assert float(jnp.sum(u * r)) == pytest.approx(float(expected), rel=1e-10)


def test_prestress_is_the_stress_of_the_undeformed_wall_and_turns_with_it(block):
    x, element, shape, _ = block
    S0 = jnp.asarray([[4.0, 1.0, 0.0], [1.0, -2.0, 0.5], [0.0, 0.5, 3.0]]) * 1e4
    n_points = 1 if isinstance(element, LinearElement) else 4
    prestress = jnp.broadcast_to(S0[:, :, None, None], (3, 3, n_points, element.tets.shape[1]))
    wall = Wall(NeoHookean(1e6, 0.3))
    r = solid_residual(_zero(x), _zero(x), _zero(x), wall, element, shape, prestress)
    # Virtual work of a linear displacement H x is ∫ S₀ : H.
    H = jnp.asarray([[1.0, 2.0, 0.0], [0.0, -1.0, 1.0], [0.3, 0.0, 0.7]])
    work = float(jnp.sum((H @ x) * r))
    assert work == pytest.approx(float(jnp.sum(S0 * H) * jnp.sum(shape.volume)), rel=1e-10)
    q = jnp.asarray([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turned = solid_residual(_zero(x), _zero(x), q @ x - x, wall, element, shape, prestress)
    np.testing.assert_allclose(turned, q @ r, atol=1e-7)
    sigma = cauchy_stress(q @ x - x, wall, element, shape, prestress)
    # Round-off on a stress of 4e4 dyn/cm² and moduli of 1e6.
    np.testing.assert_allclose(sigma[:, :, 0, 0], q @ S0 @ q.T, atol=1e-7)


@materials
def test_tangent_at_the_reference_is_the_derivative(block, material):
    x, element, shape, _ = block
    rng = np.random.default_rng(5)
    wall = Wall(material, damping=40.0)
    v = jnp.asarray(rng.standard_normal(x.shape))
    weights = Weights(3.0, 0.6, 2e-3)
    S0 = jnp.asarray(rng.standard_normal((3, 3, 1, 1))) * 1e4
    n_points = 1 if isinstance(element, LinearElement) else 4
    prestress = jnp.broadcast_to(S0 + S0.swapaxes(0, 1), (3, 3, n_points, element.tets.shape[1]))

    def force(s):
        d, u, a = weights.d * s * v, weights.u * s * v, weights.a * s * v
        return solid_residual(u, a, d, wall, element, shape, prestress)

    _, exact = jax.jvp(force, (0.0,), (1.0,))
    rest = _zero(x)
    tangent = wall_tangent(rest, rest, weights, wall, element, shape, prestress)
    found = apply_wall(tangent, v, element, shape)
    # λ goes through E and ν, which loses 1/(1 − 2ν) in round-off.
    np.testing.assert_allclose(found, exact, atol=1e-11 * float(jnp.max(jnp.abs(exact))))


def test_tangent_is_symmetric_with_six_rigid_modes(block):
    x, element, shape, _ = block
    wall = Wall(NeoHookean(1e6, 0.45))

    weights = Weights(0.0, 0.0, 1.0)
    tangent = wall_tangent(_zero(x), _zero(x), weights, wall, element, shape)

    def force(flat):
        return apply_wall(tangent, flat.reshape(x.shape), element, shape).reshape(-1)

    K = jax.jit(lambda: jax.lax.map(force, jnp.eye(x.size)))()
    np.testing.assert_allclose(K, K.T, atol=1e-9 * float(jnp.max(K)))
    values = np.linalg.eigvalsh(np.asarray(K))
    assert np.sum(np.abs(values) < 1e-9 * values[-1]) == 6
    assert values[6] > 1e-5 * values[-1]


def test_a_wall_without_mass_or_with_a_negative_damper_is_refused():
    for numbers in ({"rho_s": 0.0}, {"damping": -1.0}, {"support_stiffness": -1.0}):
        with pytest.raises(ValueError, match=rf"{next(iter(numbers))} = .* must be finite and"):
            Wall(MATERIALS["linear"], **numbers)
    assert jax.jit(lambda rho: Wall(MATERIALS["linear"], rho_s=rho).rho_s)(0.0) == 0.0


def test_kinetic_energy_of_quadratic_velocities_is_exact(block):
    x, element, shape, _ = block
    if isinstance(element, LinearElement):
        pytest.skip("the linear element has no quadratic fields")
    # x y at the vertices is interpolated linearly; half the second difference bows the edges.
    v = np.zeros(x.shape)
    v[0] = x[0] * x[1]
    for k, (a, b) in enumerate([(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]):
        i, j = element.tets[a], element.tets[b]
        v[0, element.edges[k]] = -(x[0, i] - x[0, j]) * (x[1, i] - x[1, j]) / 4.0
    v = jnp.asarray(v)
    wall = Wall(MATERIALS["linear"], rho_s=1.3)
    power = float(jnp.sum(v * solid_residual(_zero(x), v, _zero(x), wall, element, shape)))
    # ∫ (x y)² over [0, 1] × [0, 0.5] × [0, 0.4]
    assert power == pytest.approx(1.3 * (1.0 / 3.0) * (0.5**3 / 3.0) * 0.4, rel=1e-12)
