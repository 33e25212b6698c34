"""The equations of the blood on exact states: conservation, consistency, momentum balance."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.linear import Geometry, area_vectors, face_load, geometry
from jaxfsi.core.laws.fluid import (
    Blood,
    fluid_residual,
    lagged_coefficients,
    shear_rate,
    velocity_gradient,
)
from jaxfsi.core.laws.viscosity import CarreauYasuda, Newtonian
from jaxfsi.meshing import tube

DT = 1e-3
BLOOD = Blood(rho_f=1.06, viscosity=Newtonian(0.04))


class Box(NamedTuple):
    x: Float[Array, "3 nodes"]
    tets: Int[Array, "4 tets"]
    faces: Int[Array, "3 faces"]
    inner: np.ndarray
    shape: Geometry


@pytest.fixture(scope="module")
def box() -> Box:
    """A crooked piece of blood with interior nodes."""

    def bend(points):
        x, y, z = points.T
        return np.stack([x + 0.2 * z**2, y + 0.1 * np.sin(2.0 * z), z + 0.15 * x * y], axis=1)

    mesh = tube(
        radius=0.5, length=0.8, thickness=0.1, n_around=8, n_axial=4, n_layers=0, mapping=bend
    )
    x, tets = jnp.asarray(mesh.points.T), jnp.asarray(mesh.tets.T)
    inner = np.setdiff1d(mesh.tets, mesh.faces)
    return Box(x, tets, jnp.asarray(mesh.faces.T), inner, geometry(x, tets))


@jax.jit
def _residual(u, a, p, u_mesh, x, tets):
    shape = geometry(x, tets)
    coefficients = lagged_coefficients(jnp.asarray(DT), u, a, p, u_mesh, BLOOD, tets, shape)
    return fluid_residual(u, a, p, BLOOD, coefficients, tets, shape)


def _random(seed: int, *shape: int) -> jnp.ndarray:
    return jnp.asarray(np.random.default_rng(seed).standard_normal(shape))


def test_uniform_flow_on_a_moving_mesh_is_conserved(box):
    n = box.x.shape[1]
    u = jnp.broadcast_to(jnp.asarray([[3.0], [-2.0], [15.0]]), (3, n))
    u_mesh = 8.0 * _random(0, 3, n)
    r_u, r_p = _residual(u, 0.0 * u, jnp.zeros(n), u_mesh, box.x, box.tets)
    # Differences of equal numbers: ρ U² h² times round-off.
    np.testing.assert_allclose(r_u, 0.0, atol=1e-12)
    np.testing.assert_allclose(r_p, 0.0, atol=1e-13)


def test_uniform_pressure_is_balanced_inside_and_pushes_the_boundary(box):
    n = box.x.shape[1]
    zero, P = jnp.zeros((3, n)), 1e5
    r_u, r_p = _residual(zero, zero, jnp.full(n, P), zero, box.x, box.tets)
    np.testing.assert_allclose(r_u[:, box.inner], 0.0, atol=1e-9)
    expected = face_load(-P * area_vectors(box.x, box.faces), box.faces, n)
    np.testing.assert_allclose(r_u, expected, atol=1e-9)
    np.testing.assert_allclose(r_p, 0.0, atol=1e-10)


def test_hydrostatic_pressure_balances_an_acceleration(box):
    # a = −∇p/ρ: the strong residual vanishes, and with it all stabilisation.
    n = box.x.shape[1]
    slope = jnp.asarray([120.0, -300.0, 70.0])
    a = jnp.broadcast_to(-slope[:, None] / BLOOD.rho_f, (3, n))
    r_u, r_p = _residual(jnp.zeros((3, n)), a, slope @ box.x, jnp.zeros((3, n)), box.x, box.tets)
    np.testing.assert_allclose(r_u[:, box.inner], 0.0, atol=1e-11)
    np.testing.assert_allclose(r_p, 0.0, atol=1e-12)


@pytest.mark.parametrize("mesh_speed", [0.0, 20.0], ids=["fixed", "moving"])
def test_linear_velocity_fields_are_exact(box, mesh_speed):
    """u = M x with tr M = 0, M² symmetric: p = −ρ xᵀM²x/2 if steady; here M² = 0 and p is uniform.

    On a moving mesh the time derivative at a node is a = u_mesh·∇u.
    """
    n = box.x.shape[1]
    M = jnp.asarray([[0.0, 5.0, -3.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    u_mesh = mesh_speed * jnp.broadcast_to(jnp.asarray([[0.3], [1.0], [-0.6]]), (3, n))
    u, a = M @ box.x, M @ u_mesh
    r_u, r_p = _residual(u, a, jnp.full(n, 50.0), u_mesh, box.x, box.tets)
    # The Galerkin terms cancel inside exactly: ∫ v ρ(a + c·∇u) = 0 and ∫ ∇v : σ = 0 for uniform σ.
    np.testing.assert_allclose(r_u[:, box.inner], 0.0, atol=1e-10)
    np.testing.assert_allclose(r_p, 0.0, atol=1e-10)


def test_forces_sum_to_the_change_of_momentum(box):
    """Σ r_u = ∫ ρ (a + c*·∇u): stresses and stabilisation cancel, for any state."""
    n = box.x.shape[1]
    u, a, p = 10.0 * _random(1, 3, n), 1e3 * _random(2, 3, n), 1e4 * _random(3, n)
    u_mesh = 5.0 * _random(4, 3, n)
    coefficients = lagged_coefficients(jnp.asarray(DT), u, a, p, u_mesh, BLOOD, box.tets, box.shape)
    r_u, r_p = fluid_residual(u, a, p, BLOOD, coefficients, box.tets, box.shape)
    V = box.shape.volume
    slope = jnp.einsum("iat,jat->ijt", u[:, box.tets], jnp.asarray(box.shape.grad))
    carrier = jnp.mean((u - u_mesh)[:, box.tets], axis=1) + jnp.asarray(coefficients.subscale)
    rate = jnp.mean(a[:, box.tets], axis=1) + jnp.einsum("jt,ijt->it", carrier, slope)
    expected = BLOOD.rho_f * jnp.sum(V * rate, axis=1)
    np.testing.assert_allclose(jnp.sum(r_u, axis=1), expected, rtol=1e-10)
    divergence = jnp.einsum("iit->t", slope)
    assert float(jnp.sum(r_p)) == pytest.approx(float(jnp.sum(V * divergence)), rel=1e-10)


def test_residual_is_linear_in_velocity_acceleration_and_pressure(box):
    n = box.x.shape[1]
    states = [(_random(k, 3, n), _random(k + 1, 3, n), _random(k + 2, n)) for k in (10, 20)]
    coefficients = lagged_coefficients(
        jnp.asarray(DT), *states[0], 0.0 * states[0][0], BLOOD, box.tets, box.shape
    )

    def r(state):
        return jnp.concatenate(
            [
                q.reshape(-1)
                for q in fluid_residual(*state, BLOOD, coefficients, box.tets, box.shape)
            ]
        )

    both = tuple(2.0 * f - 3.0 * g for f, g in zip(*states, strict=True))
    expected = 2.0 * r(states[0]) - 3.0 * r(states[1])
    scale = float(jnp.max(jnp.abs(expected)))
    np.testing.assert_allclose(r(both), expected, atol=1e-12 * scale)


def test_stabilisation_of_the_divergence_is_free_of_the_step_unless_asked_for(box):
    u, zero = 20.0 * _random(5, *box.x.shape), jnp.zeros_like(box.x)

    def coefficients(dt, blood):
        return lagged_coefficients(
            jnp.asarray(dt), u, zero, zero[0], zero, blood, box.tets, box.shape
        )

    long, short = coefficients(1e-3, BLOOD), coefficients(1e-6, BLOOD)
    np.testing.assert_allclose(long.tau_continuity, short.tau_continuity, rtol=1e-12)
    # Where the step is long, 1/(τ_M tr G) is its limit.
    other = Blood(BLOOD.rho_f, BLOOD.viscosity, transient_continuity=True)
    trace = jnp.sum(jnp.asarray(box.shape.grad)[:, 1:] ** 2, axis=(0, 1))
    for dt in (1e-6, 1e-3, 1e3):
        k = coefficients(dt, other)
        np.testing.assert_allclose(k.tau_continuity, 1.0 / (k.tau_momentum * trace), rtol=1e-12)
    np.testing.assert_allclose(
        coefficients(1e3, other).tau_continuity, long.tau_continuity, rtol=1e-6
    )


def test_viscous_power_is_the_dissipation(box):
    # Without inertia, u·r_u = ∫ 2μ ε:ε + τ_C (∇·u)²; a divergence-free field leaves the first.
    M = jnp.asarray([[1.0, 4.0, 0.5], [-2.0, 2.0, 1.0], [0.0, 3.0, -3.0]])
    u = M @ box.x
    zero = jnp.zeros_like(u)
    light = Blood(rho_f=1e-12, viscosity=Newtonian(0.04))
    rest = lagged_coefficients(
        jnp.asarray(DT), zero, zero, zero[0], zero, light, box.tets, box.shape
    )
    r_u, _ = fluid_residual(u, zero, zero[0], light, rest, box.tets, box.shape)
    strain = (M + M.T) / 2.0
    expected = 2.0 * 0.04 * jnp.sum(strain**2) * jnp.sum(box.shape.volume)
    assert float(jnp.sum(u * r_u)) == pytest.approx(float(expected), rel=1e-9)


def test_shear_rate_of_a_simple_shear_is_its_slope(box):
    u = jnp.zeros_like(box.x).at[0].set(35.0 * box.x[1])
    np.testing.assert_allclose(
        shear_rate(velocity_gradient(u, box.tets, box.shape)), 35.0, rtol=1e-10
    )


def test_shear_rate_has_a_finite_derivative_at_rest(box):
    zero = jnp.zeros_like(box.x)
    slope = jax.grad(lambda u: jnp.sum(shear_rate(velocity_gradient(u, box.tets, box.shape))))(zero)
    assert np.all(np.isfinite(slope))


def test_carreau_yasuda_has_its_limits_and_the_published_values():
    law = CarreauYasuda()
    rates = jnp.asarray([0.0, 1e-9, 1e8])
    np.testing.assert_allclose(law(rates), [0.56, 0.56, 0.0345], rtol=1e-4)
    # μ∞ + (μ₀ − μ∞)(1 + (λγ)^a)^((n−1)/a) at γ = 100/s by hand: 0.0345 + 0.5255·0.016627.
    expected = 0.0345 + 0.5255 * (1.0 + 190.2**1.25) ** (-0.78 / 1.25)
    assert float(law(jnp.asarray([100.0]))[0]) == pytest.approx(expected, rel=1e-12)
    slope = jax.vmap(jax.grad(lambda rate: law(rate[None])[0]))(jnp.asarray([0.0, 1.0, 1e3]))
    assert np.all(np.isfinite(slope))
    assert np.all(np.asarray(slope) <= 0.0)


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda v: Blood(rho_f=v), r"Blood\.rho_f"),
        (lambda v: Newtonian(v), r"Newtonian\.mu"),
        (lambda v: CarreauYasuda(mu_zero=v), r"CarreauYasuda\.mu_zero"),
        (lambda v: CarreauYasuda(mu_infinite=v), r"CarreauYasuda\.mu_infinite"),
        (lambda v: CarreauYasuda(relaxation_time=v), r"CarreauYasuda\.relaxation_time"),
        (lambda v: CarreauYasuda(transition=v), r"CarreauYasuda\.transition"),
    ],
)
def test_blood_out_of_its_range_is_refused(made, words):
    for value in (-0.04, np.nan, np.inf):
        with pytest.raises(ValueError, match=f"{words} = .* must be finite and"):
            made(value)
    jax.jit(made)(-0.04)  # traced numbers pass, as those of the wall


def test_blood_without_density_or_viscosity_at_rest_is_refused():
    with pytest.raises(ValueError, match="must be finite and positive"):
        Blood(rho_f=0.0)
    with pytest.raises(ValueError, match="must be finite and positive"):
        CarreauYasuda(mu_zero=0.0)
    with pytest.raises(ValueError, match=r"exponent = .* must be finite"):
        CarreauYasuda(exponent=np.nan)
    assert Newtonian(0.0).mu == 0.0  # blood without friction
    assert CarreauYasuda(exponent=-0.1).exponent == -0.1


def test_thinning_blood_uses_its_viscosity_in_the_stress(box):
    law = CarreauYasuda()
    blood = Blood(rho_f=1e-12, viscosity=law)
    u = jnp.zeros_like(box.x).at[0].set(35.0 * box.x[1])
    zero = jnp.zeros_like(u)
    state = lagged_coefficients(jnp.asarray(DT), u, zero, zero[0], zero, blood, box.tets, box.shape)
    r_u, _ = fluid_residual(u, zero, zero[0], blood, state, box.tets, box.shape)
    mu = float(law(jnp.asarray([35.0]))[0])
    expected = mu * 35.0**2 * float(jnp.sum(box.shape.volume))
    assert float(jnp.sum(u * r_u)) == pytest.approx(expected, rel=1e-9)
