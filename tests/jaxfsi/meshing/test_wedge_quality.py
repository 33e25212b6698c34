import numpy as np
import pytest

from jaxfsi.meshing.check.wedge_quality import wedge_quality

_TRIANGLE = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.75**0.5, 0.0]])
_WEDGE = np.arange(6)[None]


def wedge(above: np.ndarray) -> np.ndarray:
    return np.concatenate([_TRIANGLE, above])


def test_upright_wedge_is_ideal_at_any_height():
    for height in (0.1, 1.0, 10.0):
        shape = wedge_quality(wedge(_TRIANGLE + np.array([0.0, 0.0, height])), _WEDGE)
        assert shape.scaled_jacobian[0] == pytest.approx(1.0)
        assert shape.min_dihedral_deg[0] == pytest.approx(60.0)


def test_leaning_wedge_has_the_angle_of_its_lean():
    # Leaning by 45 degrees across the edge from 0 to 1.
    shape = wedge_quality(wedge(_TRIANGLE + np.array([0.0, 1.0, 1.0])), _WEDGE)
    assert shape.scaled_jacobian[0] == pytest.approx(np.sqrt(0.5))
    assert shape.min_dihedral_deg[0] == pytest.approx(45.0)


def test_turned_top_and_crossed_column_are_seen():
    turned = wedge_quality(wedge(_TRIANGLE[[1, 0, 2]] + np.array([0.0, 0.0, 0.3])), _WEDGE)
    assert turned.scaled_jacobian[0] < 0.0
    above = _TRIANGLE + np.array([0.0, 0.0, 0.5])
    above[0] = [0.0, 0.0, -0.5]
    assert wedge_quality(wedge(above), _WEDGE).scaled_jacobian[0] < 0.0
