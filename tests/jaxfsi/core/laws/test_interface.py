"""Pressure on edges that bow, and the volume that they open."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.core.elements.linear import area_vectors
from jaxfsi.core.laws.interface import mid_edge_flux, mid_edge_load
from jaxfsi.core.laws.materials import LinearElastic
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.ports.pressure import PressurePort
from jaxfsi.core.statics.loads import Loads, load_forces, pressure_load
from jaxfsi.core.step.equations import Unknowns, begin_step, residual
from jaxfsi.core.step.generalized_alpha import generalized_alpha
from jaxfsi.core.step.model import build_model
from jaxfsi.core.step.state import initial_state
from jaxfsi.mesh import OUTER_WALL
from jaxfsi.meshing import tube
from lumped.waveforms import Constant


@pytest.fixture(scope="module")
def model():
    mesh = tube(radius=0.5, length=1.0, thickness=0.1, n_around=8, n_axial=4, n_layers=1)
    ports = {name: PressurePort(Constant(0.0)) for name in mesh.openings}
    wall = Wall(LinearElastic(1e6, 0.3))
    return build_model(mesh, ports, wall=wall, wall_element="quadratic")


def test_flux_is_the_transpose_of_the_load(model):
    rng = np.random.default_rng(0)
    x = model.x + 0.01 * jnp.asarray(rng.standard_normal(model.x.shape))
    u, p = jnp.asarray(rng.standard_normal(x.shape)), jnp.asarray(rng.standard_normal(x.shape[1]))
    power = float(jnp.sum(u * mid_edge_load(p, x, model.mid_edge)))
    assert float(jnp.sum(p * mid_edge_flux(u, x, model.mid_edge))) == pytest.approx(
        power, rel=1e-12
    )


def test_linear_pressure_on_a_face_is_integrated_exactly(model):
    rng = np.random.default_rng(1)
    p = jnp.asarray(rng.standard_normal(model.n_nodes))
    faces, edges = (np.asarray(a) for a in (model.mid_edge.faces, model.mid_edge.edges))
    one = jnp.zeros_like(model.x).at[2, edges[0, 0]].set(1.0)
    # a product rule of order 4 on each of the faces beside the edge, ∫ p 4 N_a N_b n_z dA
    area = np.asarray(area_vectors(model.x, model.mid_edge.faces))[2]
    point, weight = np.polynomial.legendre.leggauss(4)
    s, w = (point + 1.0) / 2.0, weight / 2.0
    total = 0.0
    for k, face in np.argwhere(edges == edges[0, 0]):
        a, b, c = faces[(k + 1) % 3, face], faces[(k + 2) % 3, face], faces[k, face]
        for i in range(4):
            for j in range(4):
                n_a, n_b = s[i], (1.0 - s[i]) * s[j]
                value = n_a * p[a] + n_b * p[b] + (1.0 - n_a - n_b) * p[c]
                factor = 2.0 * w[i] * w[j] * (1.0 - s[i]) * 4.0 * n_a * n_b
                total += float(value) * factor * area[face]
    found = jnp.sum(one * mid_edge_load(p, model.x, model.mid_edge))
    assert float(found) == pytest.approx(total, rel=1e-12, abs=1e-18)


def test_port_on_the_outside_pushes_like_a_pressure_of_statics():
    mesh = tube(radius=0.5, length=1.0, thickness=0.1, n_around=8, n_axial=4, n_layers=1)
    ports = {name: PressurePort(Constant(0.0)) for name in mesh.openings}
    method, dt, p = generalized_alpha(0.5), jnp.asarray(1e-3), 1e4
    forces = []
    for P in (0.0, p):
        ports[OUTER_WALL] = PressurePort(Constant(P))
        wall = Wall(LinearElastic(1e6, 0.3))
        outside = build_model(mesh, ports, wall=wall, wall_element="quadratic")
        state = initial_state(outside)
        step = begin_step(dt, outside, state, method, None)
        forces.append(residual(Unknowns(state.u, state.p), outside, step, method).u)
    load = pressure_load(mesh, OUTER_WALL, p, outside)
    expected = load_forces(Loads((load,)), jnp.zeros_like(outside.x), outside)
    found = np.where(outside.prescribed, 0.0, forces[0] - forces[1])
    expected = np.where(outside.prescribed, 0.0, expected)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.max(np.abs(expected)))
    assert np.max(np.abs(found[:, outside.n_vertices :])) > 0.0


def test_interface_without_bows_has_none(model):
    mesh = tube(radius=0.5, length=1.0, thickness=0.1, n_around=8, n_axial=4, n_layers=1)
    ports = {name: PressurePort(Constant(0.0)) for name in mesh.openings}
    linear = build_model(mesh, ports, wall=Wall(LinearElastic(1e6, 0.3)), wall_element="linear")
    assert linear.mid_edge is None
    # Each face has three edges, shared by two faces but for those of both rims.
    assert 2 * len(np.unique(model.mid_edge.edges)) == 3 * model.mid_edge.faces.shape[1] + 2 * 8
