"""Flat and barred tetrahedra are mended by few more nodes."""

import numpy as np
import pytest

from jaxfsi.faces import boundary_of, find_rows
from jaxfsi.mesh import tet_volumes
from jaxfsi.meshing.check.tet_quality import tet_quality
from jaxfsi.meshing.volume.relief import relieved

NONE = np.zeros((0, 4), dtype=np.int64)


def prism() -> tuple[np.ndarray, np.ndarray]:
    """A double pyramid about a nearly plane square, whose halves are filled by a flat one too."""
    square = [[1, 0, 0.02], [0, 1, -0.02], [-1, 0, 0.02], [0, -1, -0.02]]
    points = np.array([*square, [0, 0, 1.0], [0, 0, -1.0]])
    tets = np.array([[0, 1, 2, 3], [0, 2, 1, 4], [0, 3, 2, 4], [0, 1, 3, 5], [1, 2, 3, 5]])
    wrong = tet_volumes(points, tets) < 0.0
    tets[wrong] = tets[wrong][:, [1, 0, 2, 3]]
    return points, tets


def mended(barred: np.ndarray, points: np.ndarray, tets: np.ndarray):
    surface = boundary_of(tets)
    label = np.zeros(len(surface), dtype=np.int64)
    return surface, *relieved(points, tets, surface, label, barred=barred)


def test_flat_tetrahedron_is_mended_and_the_surface_stays():
    points, tets = prism()
    assert tet_quality(points, tets).min_dihedral_deg.min() < 5.0
    surface, x, new = mended(NONE, points, tets)
    assert tet_quality(x, new).min_dihedral_deg.min() > 8.0
    np.testing.assert_allclose(x[: len(points)], points, atol=1e-12)
    assert np.all(find_rows(boundary_of(new), surface) >= 0)
    volume = tet_volumes(points, tets).sum()
    assert tet_volumes(x, new).sum() == pytest.approx(volume, rel=1e-12)


def test_barred_tetrahedron_goes_though_it_is_no_flat_one():
    points, tets = prism()
    points[[0, 2], 2], points[[1, 3], 2] = 0.4, -0.4
    assert tet_quality(points, tets).min_dihedral_deg.min() > 8.0
    barred = np.array([[0, 1, 2, 3]])
    _, same, _ = mended(NONE, points, tets)
    assert len(same) == len(points)
    _, x, new = mended(barred, points, tets)
    assert len(x) > len(points)
    assert np.all(find_rows(new, barred) < 0)
