"""Tissue outside the wall: its energy, and a ring that it holds."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi import INTERFACE, OUTER_WALL
from jaxfsi.core.laws.materials import SaintVenantKirchhoff
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.laws.tissue import tissue_force
from jaxfsi.core.statics.equilibrium import equilibrium, static_factor
from jaxfsi.core.statics.loads import Loads, pressure_load
from jaxfsi.core.step.model import build_model
from jaxfsi.meshing import ring

P = 1e3


def _ring(wall_element, n_around=6, stiffness=0.0, n_layers=1):
    mesh = ring(
        radius=1.0, length=1.0, thickness=0.1, n_around=n_around, n_axial=6, n_layers=n_layers
    )
    wall = Wall(SaintVenantKirchhoff(1e6, 0.3), support_stiffness=stiffness)
    return mesh, build_model(mesh, {}, wall=wall, wall_element=wall_element, clamped=())


@pytest.mark.parametrize("wall_element", ["linear", "quadratic"])
def test_tissue_stores_the_square_of_the_traction(wall_element):
    _, model = _ring(wall_element)
    t = jax.random.normal(jax.random.key(0), model.x.shape)
    # Gauss' rule with five points, folded onto the triangle (Duffy), is exact for degree eight.
    at, weight = np.polynomial.legendre.leggauss(5)
    at, weight = (at + 1.0) / 2.0, weight / 2.0
    stored = 0.0
    x, field, faces = (np.asarray(a) for a in (model.x, t, model.outer_faces))
    area = np.linalg.norm(
        np.cross(x[:, faces[1]] - x[:, faces[0]], x[:, faces[2]] - x[:, faces[0]], axis=0), axis=0
    )
    for a, w_a in zip(at, weight, strict=True):
        for b, w_b in zip(at, weight, strict=True):
            N = (1.0 - a, a * (1.0 - b), a * b)
            value = sum(N[k] * field[:, faces[k]] for k in range(3))
            if model.outer_edges is not None:
                edges = np.asarray(model.outer_edges)
                value = value + sum(
                    4.0 * N[(k + 1) % 3] * N[(k + 2) % 3] * field[:, edges[k]] for k in range(3)
                )
            stored += w_a * w_b * a * np.sum(area * value**2)
    assert float(jnp.vdot(t, tissue_force(t, model))) == pytest.approx(stored, rel=1e-12)


@pytest.mark.slow  # compiles the quadratic kernels
@pytest.mark.parametrize(("wall_element", "scatter"), [("linear", 0.01), ("quadratic", 1e-3)])
def test_a_ring_in_tissue_widens_as_lame_says(wall_element, scatter):
    k = 3e5
    mesh, model = _ring(wall_element, n_around=32, stiffness=k, n_layers=2)
    loads = Loads((pressure_load(mesh, INTERFACE, P, model),))
    d = equilibrium(model, loads, static_factor(model), tolerance=1e-7, max_iterations=200).d
    a, b, E, nu = 1.0, 1.1, 1e6, 0.3

    def outside(p, q):
        """Lamé's widening of the free outer surface."""
        A, B = (p * a**2 - q * b**2) / (b**2 - a**2), (p - q) * (a * b) ** 2 / (b**2 - a**2)
        return ((1.0 - nu) * A * b + (1.0 + nu) * B / b) / E

    # the tissue presses back with k times the widening
    exact = outside(P, 0.0) / (1.0 - k * outside(0.0, 1.0))
    nodes = np.unique(mesh.labelled(OUTER_WALL))
    x, u = np.asarray(model.x)[:, nodes], np.asarray(d)[:, nodes]
    midway = np.abs(x[2] - 0.5) < 1e-6
    w = (np.sum(x[:2] * u[:2], axis=0) / np.hypot(x[0], x[1]))[midway]
    assert np.mean(w) == pytest.approx(exact, rel=0.005)
    assert np.std(w) < scatter * exact
