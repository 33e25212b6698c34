"""A wall with fibres: closed forms, energy, derivatives, objectivity, slack in compression."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.core.elements.wedge import WedgeElement, wedge_geometry
from jaxfsi.core.laws.fibres import HolzapfelGasserOgden
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.laws.wedge_solid import wedge_stress
from jaxfsi.core.statics.equilibrium import equilibrium, static_factor
from jaxfsi.core.statics.loads import Loads, pressure_load
from jaxfsi.core.step.model import build_model
from jaxfsi.fields import wall_frame
from jaxfsi.mesh import INTERFACE
from jaxfsi.meshing import ring, strip
from jaxfsi.verification import ENERGIES

G, K1, K2, ANGLE = 3e4, 2.3632e4, 0.8393, np.radians(29.0)
"""Media of a rabbit's carotid, Holzapfel et al. 2000 [dyn/cm²]."""


def _law(n: int, *, dispersion: float = 0.0, nu: float = 0.45, turn=None) -> HolzapfelGasserOgden:
    turn = np.eye(3) if turn is None else turn
    c, z = (np.tile(v[:, None], n) for v in (turn[:, 0], turn[:, 1]))
    return HolzapfelGasserOgden(2.0 * (1.0 + nu) * G, nu, K1, K2, ANGLE, c, z, dispersion)


def _deformations(n: int = 6) -> jnp.ndarray:
    rng = np.random.default_rng(0)
    return jnp.asarray(np.eye(3)[:, :, None] + 0.15 * rng.standard_normal((3, 3, n)))


def _array(tensor) -> jnp.ndarray:
    return jnp.stack([jnp.stack(list(row)) for row in tensor])


def _rotation() -> np.ndarray:
    q, r = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)


@pytest.mark.parametrize(
    "stretches",
    [(1.2, 1.2**-0.5, 1.2**-0.5), (1.15, 1.15, 1.15**-2)],
    ids=["uniaxial", "equibiaxial"],
)
def test_stretch_without_change_of_volume(stretches):
    # σ_i − σ_3 = G (λ_i² − λ_3²) + 4 k₁ E exp(k₂ E²) λ_i² (cos² θ, sin² θ).
    squares = np.square(stretches)
    share = np.array([np.cos(ANGLE) ** 2, np.sin(ANGLE) ** 2, 0.0])
    e = share @ squares - 1.0
    assert e > 0.0
    expected = G * squares + 4.0 * K1 * e * np.exp(K2 * e**2) * squares * share
    F = jnp.asarray(np.diag(stretches))[:, :, None]
    sigma = np.diag(_array(_law(1).stress(F))[:, :, 0]) * np.array(stretches)
    np.testing.assert_allclose(sigma - sigma[2], expected - expected[2], atol=1e-9 * G)


@pytest.mark.parametrize("dispersion", [0.0, 0.2, 1.0 / 3.0])
def test_stress_is_the_derivative_of_the_stored_energy(dispersion):
    F, law = _deformations(), _law(6, dispersion=dispersion)

    def energy(f):
        C, total = f.T @ f, ENERGIES[type(law.matrix)](law.matrix, f)
        for a in (fibre[:, 0] for fibre in law.fibres):
            e = dispersion * (jnp.trace(C) - 3.0) + (1.0 - 3.0 * dispersion) * (a @ C @ a - 1.0)
            total += jnp.where(e > 0.0, K1 / (2.0 * K2) * (jnp.exp(K2 * e**2) - 1.0), 0.0)
        return total

    expected = jax.vmap(jax.grad(energy), 2, 2)(F)
    np.testing.assert_allclose(_array(law.stress(F)), expected, atol=1e-10 * K1)


def test_tangent_matches_central_differences():
    F, law, h = _deformations(), _law(6, dispersion=0.1), 1e-6
    along = jnp.asarray(np.random.default_rng(3).standard_normal(F.shape))
    change = jax.jvp(lambda f: _array(law.stress(f)), (F,), (along,))[1]
    ahead, behind = (_array(law.stress(F + s * h * along)) for s in (1.0, -1.0))
    # Truncation h² and rounding 1e-16/h of moduli of 1e5 dyn/cm².
    np.testing.assert_allclose(change, (ahead - behind) / (2.0 * h), atol=1e-4 * h * 1e6)


def test_stress_turns_with_the_body_and_with_its_fibres():
    F, Q = _deformations(), _rotation()
    P = _array(_law(6).stress(F))
    turned = _array(_law(6).stress(jnp.einsum("ij,jkn->ikn", Q, F)))
    np.testing.assert_allclose(turned, jnp.einsum("ij,jkn->ikn", Q, P), atol=1e-9 * G)
    before = _array(_law(6, turn=Q).stress(jnp.einsum("ijn,kj->ikn", F, Q)))
    np.testing.assert_allclose(before, jnp.einsum("ijn,kj->ikn", P, Q), atol=1e-9 * G)


def test_both_measures_of_stress_agree():
    F, law = _deformations(), _law(6, dispersion=0.2)
    E = (jnp.einsum("kin,kjn->ijn", F, F) - jnp.eye(3)[:, :, None]) / 2.0
    P = jnp.einsum("ikn,kjn->ijn", F, _array(law.second_stress(E)))
    np.testing.assert_allclose(P, _array(law.stress(F)), atol=1e-9 * G)


def test_shortened_fibres_are_slack():
    law = _law(1)
    F = jnp.asarray(np.diag([0.9, 1.1, 1.0]))[:, :, None]  # along both families: −0.09
    along = jnp.asarray(np.random.default_rng(3).standard_normal(F.shape))
    for of in (lambda f: law.stress(f), lambda f: law.matrix.stress(f)):
        of(F)
    found = jax.jvp(lambda f: _array(law.stress(f)), (F,), (along,))
    expected = jax.jvp(lambda f: _array(law.matrix.stress(f)), (F,), (along,))
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a, b)


def test_split_law_keeps_the_fibres():
    law = _law(6, nu=0.49)
    F, (kept, moduli) = _deformations(), _law(6, nu=0.49).split()
    volumes = zip(moduli, law.responses, law.volumes(F), strict=True)
    parts = [k * U(q.value) * _array(q.slope) for k, U, q in volumes]
    np.testing.assert_allclose(
        _array(kept.stress(F)) + sum(parts), _array(law.stress(F)), atol=1e-8 * G
    )


def test_wedges_have_the_stress_of_a_uniform_strain():
    mesh = strip(length=1.0, width=1.0, thickness=0.2, n_length=2, n_width=2, n_layers=1)
    x = jnp.asarray(mesh.points.T)
    wedges = WedgeElement(jnp.asarray(mesh.wedges.T, jnp.int32))
    H = jnp.asarray([[0.15, 0.05, 0.02], [0.08, 0.1, 0.04], [0.0, 0.03, -0.1]])
    law = _law(wedges.n, dispersion=0.1, turn=_rotation())
    found = wedge_stress(H @ x, law, wedges, wedge_geometry(x, wedges))
    F = jnp.broadcast_to((jnp.eye(3) + H)[:, :, None], (3, 3, wedges.n))
    S = jnp.einsum(
        "ikn,kjn->ijn", jnp.linalg.inv(jnp.eye(3) + H)[:, :, None], _array(law.stress(F))
    )
    # What tetrahedra have: they take the stress at F.
    np.testing.assert_allclose(found, jnp.stack([S, S], axis=2), atol=1e-8 * G)


def test_wrong_numbers_are_refused():
    law = _law(2)
    for change, said in (
        ({"dispersion": 0.4}, "dispersion = 0.4 must lie between 0"),
        ({"k1": -1.0}, "k1 = -1.0 must be finite and zero or positive"),
        ({"axis": np.ones(3)}, "give both"),
    ):
        with pytest.raises(ValueError, match=said):
            dataclasses.replace(law, **change)


@pytest.mark.slow  # compiles an equilibrium
@pytest.mark.parametrize("element", ["bending", "linear"])
def test_tube_with_fibres_under_pressure_follows_laplace(element):
    radius, thickness, length = 0.15, 0.02, 0.6
    mesh = ring(
        radius=radius,
        length=length,
        thickness=thickness,
        n_around=24,
        n_axial=12,
        n_layers=1,
        columns=element == "bending",
    )
    frame, nu = wall_frame(mesh), 0.45
    law = HolzapfelGasserOgden(
        2.0 * (1.0 + nu) * G, nu, K1, K2, ANGLE, frame.circumference, frame.axis
    )
    model = build_model(mesh, {}, wall=Wall(law), wall_element=element)
    P = 1200.0
    load = Loads((pressure_load(mesh, INTERFACE, P, model),))
    end = equilibrium(
        model,
        load,
        static_factor(model),
        n_load_steps=3,
        tolerance=1e-5,
        max_systems=20,
        max_iterations=100,
    )
    X, x = np.asarray(model.x), np.asarray(model.x + end.d)
    inner = np.isclose(np.hypot(X[0], X[1]), radius)
    near = np.abs(X[2] - length / 2.0) < 0.06  # five lengths in which the ends' hold dies away
    middle = np.isclose(X[2], length / 2.0)
    r = np.hypot(x[0], x[1])
    inside, outside = r[inner & middle].mean(), r[~inner & middle].mean()
    stretches = (
        (inside + outside) / (2.0 * radius + thickness),
        np.polyfit(X[2, near], x[2, near], 1)[0],
        (outside - inside) / thickness,
    )
    turn = jnp.eye(3)
    one = HolzapfelGasserOgden(law.E, nu, K1, K2, ANGLE, turn[:, :1], turn[:, 1:2])
    along = jnp.asarray(np.diag(stretches))[:, :, None]
    hoop, _, radial = np.diag(_array(one.stress(along))[:, :, 0])
    assert stretches[0] > 1.03  # the fibres are taut
    # Laplace, per unstretched length. A thick wall and its facets leave 5 %.
    assert hoop * thickness == pytest.approx(P * inside * stretches[1], rel=0.05)
    assert abs(radial) < P
    assert int(end.n_gmres) / int(end.n_newton) < 20.0  # 8: the factor knows the matrix alone
