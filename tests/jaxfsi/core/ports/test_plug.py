"""A plug sweeps its area times its velocity, and takes the mesh with it."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi import core, meshing
from jaxfsi.core.elements.linear import area_vectors
from jaxfsi.core.step.step import RESULTS
from jaxfsi.mesh import INTERFACE
from jaxfsi.verification.volume_balance import keep_books
from lumped import Constant, Sinusoid

MEAN, AMPLITUDE, PERIOD, DT, N_STEPS = 3.0, 2.0, 0.02, 1e-3, 12


def _mesh(thickness_layers):
    return meshing.tube(
        radius=0.5, length=1.0, thickness=0.1, n_around=8, n_axial=4, n_layers=thickness_layers
    )


def _model(mesh, **options):
    ports = {
        "inlet": core.PlugPort(Sinusoid(MEAN, AMPLITUDE, PERIOD, -np.pi / 2.0)),
        "outlet": core.PressurePort(Constant(0.0)),
    }
    return core.build_model(mesh, ports, **options)


def _area(model):
    return float(jnp.linalg.norm(jnp.sum(area_vectors(model.x, model.port_faces[0]), axis=1)))


def _books(model, mesh):
    stepper = core.prepare(DT, model, tolerance=1e-6, max_iterations=100)
    wall = jnp.asarray(mesh.labelled(INTERFACE).T)
    books = keep_books(model, core.initial_state(model), stepper, wall, N_STEPS)
    assert np.all(books.report.result == RESULTS.successful)
    return books


@pytest.fixture(scope="module", params=["rim held", "rim free"])
def case(request):
    if request.param == "rim held":
        mesh = _mesh(0)
        return mesh, _model(mesh)
    mesh = _mesh(1)
    wall = core.Wall(core.LinearElastic(3e6, 0.3))
    return mesh, _model(mesh, wall=wall, clamped=["outlet_ring"])


def test_flow_and_volume_are_those_of_the_plug(case):
    mesh, model = case
    books = _books(model, mesh)
    t = DT * N_STEPS
    omega = 2.0 * np.pi / PERIOD
    area = _area(model)
    V = MEAN + AMPLITUDE * np.sin(omega * t)
    assert float(books.state.Q_port[0]) == pytest.approx(-V * area, rel=1e-6)
    # The trapezoidal rule of the position: (ω Δt)²/12 of the oscillating part.
    travel = MEAN * t + AMPLITUDE / omega * (1.0 - np.cos(omega * t))
    assert float(books.state.blocks[0][0]) == pytest.approx(travel, rel=5e-3)
    if model.is_rigid:
        # The lumen loses what the plug sweeps, exactly: the mesh moves by linear fields.
        swept = area * float(books.state.blocks[0][0])
        assert float(books.volume) == pytest.approx(-swept, rel=1e-9)


def test_velocity_is_uniform_where_the_rim_is_free(case):
    _, model = case
    u = core.PlugPort.add_velocity(
        model.ports[0],
        jnp.asarray(PERIOD / 4.0),
        jnp.zeros_like(model.x),
        model.x,
        model.surfaces[0],
    )
    nodes = np.unique(np.asarray(model.port_faces[0]))
    speed = np.asarray(u)[2, nodes]
    rim = np.hypot(*np.asarray(model.x)[:2, nodes]) > 0.499
    if model.is_rigid:
        np.testing.assert_array_equal(speed[rim], 0.0)
        np.testing.assert_allclose(speed[~rim], speed[~rim][0])
        assert speed[~rim][0] > MEAN + AMPLITUDE
    else:
        np.testing.assert_allclose(speed, MEAN + AMPLITUDE, rtol=1e-12)


def test_plug_that_the_wall_holds_everywhere_is_refused():
    mesh = _mesh(0)
    with pytest.raises(ValueError, match="no node that a plug could move"):
        core.PlugPort(Constant(1.0)).setup(mesh, "inlet", np.ones(len(mesh.points), bool))
