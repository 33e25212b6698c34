"""Elastic laws: small strains, energy, objectivity, closed forms."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.core.laws.materials import (
    LOCAL_LAME_RATIO,
    AbstractMaterial,
    LinearElastic,
    NeoHookean,
    SaintVenantKirchhoff,
    stacked,
)
from jaxfsi.verification import ENERGIES, MATERIALS

materials = pytest.mark.parametrize("material", MATERIALS.values(), ids=MATERIALS)
FINITE = {name: m for name, m in MATERIALS.items() if not isinstance(m, LinearElastic)}


def _deformations(n: int = 6) -> jnp.ndarray:
    """Deformation gradients with strains of about 20 %, shape (3, 3, n)."""
    rng = np.random.default_rng(0)
    return jnp.asarray(np.eye(3)[:, :, None] + 0.15 * rng.standard_normal((3, 3, n)))


@pytest.mark.parametrize("law", dict.fromkeys(map(type, MATERIALS.values())))
def test_constants_without_a_finite_positive_stiffness_are_refused(law):
    for E in (-1e6, 0.0, np.nan, np.array([1e6, -1e6])):
        with pytest.raises(ValueError, match=r"E = .* must be finite and positive"):
            law(E, 0.3)
    for nu in (-1.0, 0.5, 0.6, np.nan, np.array([0.3, 0.5])):
        with pytest.raises(ValueError, match=r"nu = .* must lie between -1 and 0\.5"):
            law(1e6, nu)
    # a traced number cannot be looked at
    lam, _ = jax.jit(lambda nu: law(1e6, nu).moduli)(0.6)
    assert lam < 0.0


def _rotation() -> jnp.ndarray:
    q, r = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    return jnp.asarray(q * np.linalg.det(q))


def _stress(material, F: jnp.ndarray) -> jnp.ndarray:
    """First Piola-Kirchhoff stress as one array."""
    return stacked(material.stress(F))


def _single(F: list[list[float]] | np.ndarray) -> jnp.ndarray:
    return jnp.asarray(F, float)[:, :, None]


@materials
def test_small_strains_obey_hooke(material):
    rng = np.random.default_rng(2)
    slope = rng.standard_normal((3, 3))
    small = 1e-7
    stress = np.asarray(_stress(material, _single(np.eye(3) + small * slope))[:, :, 0])
    lam, G = (float(m) for m in material.moduli)
    strain = small * (slope + slope.T) / 2.0
    hooke = lam * np.trace(strain) * np.eye(3) + 2.0 * G * strain
    # Terms of second order are 1e-7 of the first; the round-off of F − I is as large.
    np.testing.assert_allclose(stress, hooke, atol=1e-6 * np.max(np.abs(hooke)))


@materials
def test_stress_is_the_derivative_of_the_stored_energy(material):
    F = _deformations()
    energy = ENERGIES[type(material)]
    expected = jax.vmap(jax.grad(lambda f: energy(material, f)), 2, 2)(F)
    # Round-off on moduli of 1e6 to 5e7 dyn/cm².
    np.testing.assert_allclose(
        _stress(material, F), expected, rtol=1e-10, atol=1e-9 * float(material.moduli[0])
    )


@materials
def test_split_law_and_what_acts_on_volumes_are_the_whole_law(material):
    stiff = eqx.tree_at(lambda m: m.nu, material, jnp.asarray(0.49))
    F = _deformations()
    law, moduli = stiff.split()
    lam, G = law.moduli
    assert float(lam) <= LOCAL_LAME_RATIO * float(G) * (1.0 + 1e-12)
    assert max(map(float, moduli)) > 0.0
    volumes = stiff.volumes(F)
    parts = [
        k * U(q.value) * jnp.stack([jnp.stack(list(row)) for row in q.slope])
        for k, U, q in zip(moduli, stiff.responses, volumes, strict=True)
    ]
    # Round-off on moduli of 5e7 dyn/cm².
    np.testing.assert_allclose(
        _stress(law, F) + sum(parts), _stress(stiff, F), atol=1e-12 * float(stiff.moduli[0])
    )


@materials
def test_tangent_is_symmetric(material):
    F = _deformations(1)[:, :, 0]
    tangent = jax.jacfwd(lambda f: _stress(material, f[:, :, None])[:, :, 0])(F).reshape(9, 9)
    scale = float(jnp.max(jnp.abs(tangent)))
    # A law with an energy has a symmetric Hessian; round-off remains.
    np.testing.assert_allclose(tangent, tangent.T, atol=1e-12 * scale)


@pytest.mark.parametrize("material", FINITE.values(), ids=FINITE)
def test_stress_turns_with_the_body(material):
    F, Q = _deformations(), _rotation()
    turned = _stress(material, jnp.einsum("ij,jkn->ikn", Q, F))
    expected = jnp.einsum("ij,jkn->ikn", Q, _stress(material, F))
    np.testing.assert_allclose(turned, expected, atol=1e-9 * float(material.moduli[0]))


@pytest.mark.parametrize("material", FINITE.values(), ids=FINITE)
def test_stress_does_not_depend_on_the_body_being_turned_before(material):
    # Isotropy: P(F Q) = P(F) Q.
    F, Q = _deformations(), _rotation()
    turned = _stress(material, jnp.einsum("ijn,jk->ikn", F, Q))
    expected = jnp.einsum("ijn,jk->ikn", _stress(material, F), Q)
    np.testing.assert_allclose(turned, expected, atol=1e-9 * float(material.moduli[0]))


@pytest.mark.parametrize("material", FINITE.values(), ids=FINITE)
def test_stress_at_greens_strain_is_that_at_its_deformation(material):
    F, moduli = _deformations(), float(material.moduli[0])
    strain = (jnp.einsum("kin,kjn->ijn", F, F) - jnp.eye(3)[:, :, None]) / 2.0
    P = jnp.einsum("ikn,kjn->ijn", F, stacked(material.second_stress(strain)))
    np.testing.assert_allclose(P, _stress(material, F), atol=1e-12 * moduli)
    # the law of the base class, by the triangular factor of C
    S = stacked(AbstractMaterial.second_stress(material, strain))
    np.testing.assert_allclose(material.second_stress(strain), S, atol=1e-12 * moduli)


@pytest.mark.parametrize("material", FINITE.values(), ids=FINITE)
def test_cauchy_stress_is_symmetric(material):
    F = _deformations()
    kirchhoff = jnp.einsum("ikn,jkn->ijn", _stress(material, F), F)
    np.testing.assert_allclose(
        kirchhoff, jnp.swapaxes(kirchhoff, 0, 1), atol=1e-9 * float(material.moduli[0])
    )


@pytest.mark.parametrize("stretch", [0.8, 1.0, 1.3])
def test_st_venant_kirchhoff_in_uniaxial_tension(stretch):
    # S = E·E_axial and E_lateral = −ν E_axial, so P = E λ (λ² − 1)/2.
    E, nu = 3e6, 0.3
    green = (stretch**2 - 1.0) / 2.0
    lateral = np.sqrt(1.0 - 2.0 * nu * green)
    stress = _stress(SaintVenantKirchhoff(E, nu), _single(np.diag([stretch, lateral, lateral])))
    expected = np.diag([E * stretch * green, 0.0, 0.0])
    np.testing.assert_allclose(stress[:, :, 0], expected, atol=1e-9 * E)


@pytest.mark.parametrize("stretch", [0.7, 1.0, 1.6])
def test_neo_hookean_in_isochoric_stretch(stretch):
    # With J = 1 the volumetric part vanishes, and σ₁ − σ₂ = G (λ² − 1/λ).
    E, nu = 3e6, 0.49
    lateral = stretch**-0.5
    P = _stress(NeoHookean(E, nu), _single(np.diag([stretch, lateral, lateral])))[:, :, 0]
    difference = P[0, 0] * stretch - P[1, 1] * lateral
    G = E / (2.0 * (1.0 + nu))
    assert float(difference) == pytest.approx(G * (stretch**2 - 1.0 / stretch), abs=1e-9 * E)
    assert float(P[0, 0] * stretch + 2.0 * P[1, 1] * lateral) == pytest.approx(0.0, abs=1e-8 * E)


@pytest.mark.parametrize("c", [0.9, 1.1])
def test_neo_hookean_under_uniform_pressure(c):
    E, nu = 3e6, 0.4
    P = _stress(NeoHookean(E, nu), _single(c * np.eye(3)))[:, :, 0]
    kappa, J = E / (3.0 * (1.0 - 2.0 * nu)), c**3
    # Cauchy stress P Fᵀ/J = κ (J − 1/J)/2.
    np.testing.assert_allclose(P * c / J, kappa * (J - 1.0 / J) / 2.0 * np.eye(3), atol=1e-9 * E)


def test_moduli_may_differ_from_element_to_element():
    F = _deformations(3)
    E = jnp.asarray([1e6, 2e6, 5e6])
    together = _stress(NeoHookean(E, 0.3), F)
    alone = [_stress(NeoHookean(float(e), 0.3), F[:, :, i : i + 1]) for i, e in enumerate(E)]
    np.testing.assert_allclose(together, jnp.concatenate(alone, axis=2), rtol=1e-12)
