import numpy as np
import pytest

from jaxfsi.anatomy import sample_near_zero

BOX = np.array([[-1.3, -1.2, -1.1], [1.2, 1.3, 1.2]])


def _sphere(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points, axis=1) - 0.9


def test_values_near_zero_are_those_of_the_function() -> None:
    band = 0.1
    grid = sample_near_zero(_sphere, BOX, 0.05, band=band)
    index = np.stack(np.meshgrid(*map(np.arange, grid.values.shape), indexing="ij"), axis=-1)
    exact = _sphere(grid.position(index.reshape(-1, 3).astype(float)))
    values = grid.values.ravel()
    near = np.abs(exact) <= band
    np.testing.assert_array_equal(values[near], exact[near])
    assert np.all(np.sign(values) == np.sign(exact))
    assert np.all(np.abs(values[~near]) > band)


def test_few_points_are_evaluated() -> None:
    counted = []

    def counting(points: np.ndarray) -> np.ndarray:
        counted.append(len(points))
        return _sphere(points)

    grid = sample_near_zero(counting, BOX, 0.02, band=0.02)
    assert sum(counted) < 0.2 * grid.values.size


def test_an_empty_box_is_refused() -> None:
    with pytest.raises(ValueError, match="lower < upper"):
        sample_near_zero(_sphere, BOX[::-1].copy(), 0.05, band=0.1)
