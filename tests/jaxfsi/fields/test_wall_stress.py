"""Stress of the wall for known deformations."""

import dataclasses

import jax.numpy as jnp
import numpy as np

from jaxfsi.core.elements.linear import geometry
from jaxfsi.core.elements.wall import LinearElement
from jaxfsi.core.laws.materials import NeoHookean
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.laws.wall_balance import wall_geometry
from jaxfsi.core.step.model import build_model
from jaxfsi.fields import wall_stress
from jaxfsi.meshing import ring, strip

E, NU = 1e6, 0.45


def _ring():
    mesh = ring(radius=0.5, length=0.5, thickness=0.1, n_around=6, n_axial=2)
    x, tets = jnp.asarray(mesh.points.T), jnp.asarray(mesh.tets.T)
    return x, LinearElement(tets), geometry(x, tets)


def test_stretch_of_a_neo_hookean_wall():
    x, element, shape = _ring()
    d = jnp.asarray(np.diag([0.2, -0.05, 0.1])) @ x
    found = wall_stress(jnp.zeros_like(x), d, Wall(NeoHookean(E, NU)), element, shape)
    stretch = np.array([1.2, 0.95, 1.1])
    J, G = np.prod(stretch), E / (2.0 * (1.0 + NU))
    kappa = E / (3.0 * (1.0 - 2.0 * NU))
    # σ = G J^(−5/3) dev(b) + κ/2 (J² − 1)/J I, Simo & Taylor 1991
    b = stretch**2
    sigma = G * J ** (-5.0 / 3.0) * (b - b.mean()) + kappa / 2.0 * (J**2 - 1.0) / J
    for i in range(3):
        np.testing.assert_allclose(found.sigma[i, i], sigma[i], rtol=1e-10)  # round-off
        np.testing.assert_allclose(found.strain[i, i], (stretch[i] ** 2 - 1.0) / 2.0, atol=1e-12)
    s = sigma - sigma.mean()
    np.testing.assert_allclose(found.von_mises, np.sqrt(1.5 * np.sum(s**2)), rtol=1e-9)


def test_prestress_is_part_of_the_stress_and_turns_with_the_wall():
    x, element, shape = _ring()
    angle = 0.7
    turn = jnp.asarray(
        [[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]]
    )
    S0 = jnp.asarray([[3.0, 1.0, 0.0], [1.0, -2.0, 0.5], [0.0, 0.5, 1.0]]) * 1e4
    everywhere = jnp.broadcast_to(S0[:, :, None, None], (3, 3, 1, shape.volume.size))
    d = turn @ x - x
    wall = Wall(NeoHookean(E, NU))
    found = wall_stress(jnp.zeros_like(x), d, wall, element, shape, everywhere)
    expected = jnp.broadcast_to((turn @ S0 @ turn.T)[:, :, None], found.sigma.shape)
    # round-off of stresses of size κ
    np.testing.assert_allclose(found.sigma, expected, atol=1e-7 * E)


def test_damping_is_part_of_the_stress():
    x, element, shape = _ring()
    u = jnp.zeros_like(x).at[0].set(2.0 * x[1])
    wall = Wall(NeoHookean(E, NU), damping=50.0)
    found = wall_stress(u, jnp.zeros_like(x), wall, element, shape)
    # 2η ε̇ with ε̇_xy = 1
    np.testing.assert_allclose(found.sigma[0, 1], 100.0, rtol=1e-10)
    np.testing.assert_allclose(found.sigma[0, 0], 0.0, atol=1e-6)


def test_ambient_pressure_is_part_of_the_stress_but_no_load_on_the_wall():
    x, element, shape = _ring()
    d = 0.1 * jnp.stack([x[1], x[0] ** 2, jnp.zeros_like(x[0])])
    wall = Wall(NeoHookean(E, NU))
    plain, ambient = (
        wall_stress(jnp.zeros_like(x), d, wall, element, shape, P_ambient=P) for P in (0.0, 1e5)
    )
    lift = 1e5 * np.eye(3)[:, :, None]
    np.testing.assert_allclose(ambient.sigma, plain.sigma - lift, atol=1e-9 * E)
    np.testing.assert_allclose(ambient.von_mises, plain.von_mises, rtol=1e-9)
    np.testing.assert_array_equal(ambient.strain, plain.strain)


def test_uniform_stress_is_the_same_in_wedges_and_tetrahedra():
    mesh = strip(length=1.0, width=0.5, thickness=0.1, n_length=4, n_width=2, n_layers=1)
    half = dataclasses.replace(mesh, wedges=mesh.wedges[::2])
    wall = Wall(NeoHookean(E, NU), damping=50.0)
    model = build_model(half, {}, wall=wall, clamped=[], wall_element="bending")
    n = model.n_vertices
    H = jnp.asarray([[0.1, 0.02, 0.0], [-0.03, 0.05, 0.04], [0.0, 0.01, -0.06]])
    d, u = H @ model.x, H.T @ model.x
    shape = wall_geometry(model.x, model.element)
    found = wall_stress(u, d, wall, model.element, shape)
    tets = jnp.asarray(mesh.tets.T)
    x = model.x[:, :n]
    expected = wall_stress(u[:, :n], d[:, :n], wall, LinearElement(tets), geometry(x, tets))
    np.testing.assert_allclose(found.sigma, expected.sigma, atol=1e-6 * E)  # of α by Newton
    np.testing.assert_allclose(found.strain, expected.strain, atol=1e-9)
