"""A slit whose area halves keeps its mesh valid; one that closes tells when and where."""

import numpy as np
import pytest

from jaxfsi.core.laws.contact import LeastGap
from jaxfsi.core.step.state import initial_state
from jaxfsi.simulation import AbstractObserver, SimulationError, simulate
from jaxfsi.verification import slit_mesh, slit_model, slit_shape
from jaxfsi.verification.closing_slit import HEIGHT, LENGTH, STEP, WIDTH


class _Shapes(AbstractObserver):
    """The slit's shape after every second step."""

    name, every = "shapes", 2

    def __init__(self, mesh):
        self.mesh, self.found = mesh, []

    def observe(self, step, model, state):
        self.found.append(slit_shape(self.mesh, state))

    def saved_state(self):
        return {}

    def restore(self, step, saved_state):
        pass


def _closed(mesh, n_steps, least_gap=None):
    """Shapes of a slit on its way, and the error that ended it, if any."""
    model = slit_model(mesh, least_gap=least_gap)
    shapes = _Shapes(mesh)
    try:
        simulate(model, initial_state(model), dt=STEP, n_steps=n_steps, chunk=2, observers=[shapes])
    except SimulationError as error:
        return shapes.found, error
    return shapes.found, None


def test_slit_has_its_size_and_an_even_wall():
    mesh = slit_mesh()
    ring = mesh.points[np.unique(mesh.labelled("interface"))]
    np.testing.assert_allclose(np.ptp(ring, axis=0), [WIDTH, HEIGHT, LENGTH], rtol=1e-12)
    foot, top = mesh.points[mesh.wedges[:, :3]], mesh.points[mesh.wedges[:, 3:]]
    np.testing.assert_allclose(np.linalg.norm(top - foot, axis=2), 0.05, rtol=1e-12)


@pytest.mark.slow
def test_slit_narrows_by_half_and_by_70_percent_with_valid_elements_then_collapses():
    shapes, error = _closed(slit_mesh(), 100)
    area = np.array([shape.area for shape in shapes])
    quality = np.array([shape.quality for shape in shapes])
    assert np.all(np.diff(area[1:]) < 0.0)
    assert np.min(area) < 0.3
    # Uniformly pressed elements keep about the share of the gap: no sooner than the gap goes, the
    # quality does.
    gap = np.array([shape.gap for shape in shapes]) / HEIGHT
    assert np.all(quality > 0.0)
    assert np.all((quality / quality[0] > 0.7 * gap)[area > 0.5])
    assert error is not None
    found = error.collapse
    assert found is not None
    assert "The lumen collapsed at t = 0.03" in str(error)
    # Half-way along, where the flat sides are furthest from the clamps.
    assert found.place[2] == pytest.approx(LENGTH / 2.0, abs=0.1)
    assert error.simulation.record.t[-1] == pytest.approx(found.t)


@pytest.mark.slow
def test_least_gap_keeps_the_slit_open_where_it_would_collapse():
    least = 0.02
    shapes, error = _closed(slit_mesh(), 60, LeastGap(gap=least))
    assert error is None
    assert shapes[-1].area < 0.22
    assert all(shape.quality > 0.0 for shape in shapes)
    # The wall falls in with 5 cm/s and is stopped within a few steps; then κ (1 − g/g_m)² is of
    # the size of the pressure outside, 24 mmHg: g = 0.8 g_m.
    gap = np.array([shape.gap for shape in shapes])
    assert np.min(gap) > 0.5 * least
    assert gap[-1] == pytest.approx(0.8 * least, rel=0.1)
