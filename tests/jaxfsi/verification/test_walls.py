"""What the problems of walls alone measure, on displacements that are known."""

import numpy as np
import pytest

from jaxfsi.mesh import INTERFACE
from jaxfsi.verification import pressurised_slit, slit_widening, squeezed_ring, work


def test_slit_is_the_ellipse_that_it_should_be():
    problem = pressurised_slit(0.45, "bending", n_around=96, n_axial=2)
    inside = problem.mesh.points[np.unique(problem.mesh.labelled(INTERFACE))]
    np.testing.assert_allclose((inside[:, 0] / 0.2) ** 2 + (inside[:, 1] / 0.05) ** 2, 1.0)
    foot = inside[inside[:, 2] == 0.0]
    foot = foot[np.argsort(np.arctan2(foot[:, 1] / 0.05, foot[:, 0] / 0.2))]
    side = np.linalg.norm(foot - np.roll(foot, 1, axis=0), axis=1)
    # Even arcs; a chord is shorter where the ellipse bends, by 2 % at its ends with a radius of
    # curvature of 0.0125 cm.
    assert side.max() < 1.03 * side.min()


def test_widening_of_a_stretched_slit():
    problem = pressurised_slit(0.45, "linear", n_around=16, n_axial=2)
    stretch = 1e-5 * np.array([[2.0], [3.0], [1.0]]) * problem.mesh.points.T
    # A thousandth of the pressure acts: area grows by the trace of the stretch in the section.
    assert slit_widening(problem, stretch) == pytest.approx(1e3 * 5e-5)


def test_thin_ring_has_the_load_of_a_thick_one():
    thick, thin = (squeezed_ring(0.3, "linear", thickness=t) for t in (0.1, 0.02))
    radial = thick.mesh.points.T
    assert work(thin, radial) == pytest.approx(work(thick, radial))
    assert float(thin.model.wall.support_stiffness) == pytest.approx(
        float(thick.model.wall.support_stiffness) / 125.0
    )
