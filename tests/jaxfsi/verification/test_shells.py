"""Wedges in the large-rotation problems of thin shells of Sze, Liu & Lo 2004."""

import numpy as np
import pytest

from jaxfsi.verification import shells


def _errors(problem: shells.ShellProblem) -> np.ndarray:
    """Errors at the full load over the largest deflection."""
    reference = np.array([d.reference for d in problem.deflections])
    return np.abs(shells.shell_path(problem).deflections[-1] - reference) / np.max(reference)


def test_cantilever_under_shear_bends_as_published():
    # Eight elements are 0.5 % from the published deflections and 0.6 % from finer meshes.
    problem = shells.cantilever_under_shear(8)
    assert np.all(_errors(problem) < 0.01)


def test_shell_that_is_not_held_has_no_equilibrium():
    problem = shells.cantilever_under_shear(2)
    loose = problem._replace(fixed=np.zeros_like(problem.fixed))
    with pytest.raises(RuntimeError, match="Raise the load in more steps"):
        shells.shell_path(loose)


def test_couples_have_the_derivative_that_is_assembled():
    problem = shells.cantilever_under_moment(4)
    rng = np.random.default_rng(0)
    x = problem.mesh.points + 0.02 * rng.standard_normal(problem.mesh.points.shape)
    along = rng.standard_normal(x.shape)
    h = 1e-6
    ahead, behind = (shells.load_forces(problem, x + s * h * along, 0.5)[0] for s in (1, -1))
    change = (shells.load_forces(problem, x, 0.5)[1] @ along.ravel()).reshape(x.shape)
    # Central differences: rounding 1e-16/1e-6 of the forces.
    np.testing.assert_allclose(change, (ahead - behind) / (2.0 * h), atol=1e-8 * abs(change).max())


@pytest.mark.slow
def test_moment_bends_a_cantilever_into_a_circle():
    # Chords in place of arcs shorten the circle: second order, 2.9 % at 16 elements.
    coarse, fine = (_errors(shells.cantilever_under_moment(n)) for n in (16, 32))
    assert np.all(fine < 0.01)
    assert np.all(coarse[0] > 3.0 * fine[0])


@pytest.mark.slow
def test_slit_annular_plate_lifts_as_published():
    assert np.all(_errors(shells.slit_annular_plate(16, 128)) < 0.03)


@pytest.mark.slow
def test_pinched_hemisphere_opens_as_published():
    assert np.all(_errors(shells.pinched_hemisphere(36)) < 0.03)
