"""Slivers are cut along their other diagonal, and nothing else is touched."""

import numpy as np

from jaxfsi.measures import triangle_areas
from jaxfsi.meshing.surface.flips import flipped
from jaxfsi.meshing.surface.isosurface import Surface
from jaxfsi.meshing.surface.projection import triangle_qualities

# A flat square whose lower triangle is a sliver: its apex lies close above the lower edge.
POINTS = np.array(
    [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.05, 0.0], [0.5, 0.8, 0.0], [0.5, -0.8, 0.0]]
)
ALONG_THE_LOWER_EDGE = np.array([[0, 2, 3], [2, 1, 3], [0, 1, 2], [1, 0, 4]])
PAIR = ALONG_THE_LOWER_EDGE[2:]


def test_sliver_gives_way_to_the_other_diagonal():
    found = flipped(Surface(POINTS, ALONG_THE_LOWER_EDGE), first=0, least_quality=0.3)
    assert triangle_qualities(*found).min() > 0.6
    assert {frozenset(t) for t in found.triangles.tolist()} == {
        frozenset(t) for t in ([0, 2, 3], [2, 1, 3], [0, 4, 2], [4, 1, 2])
    }
    area = triangle_areas(POINTS, ALONG_THE_LOWER_EDGE).sum()
    assert np.isclose(triangle_areas(*found).sum(), area, rtol=1e-14)


def test_first_triangles_stay():
    held = ALONG_THE_LOWER_EDGE[[3, 0, 1, 2]]
    found = flipped(Surface(POINTS, held), first=1, least_quality=0.3)
    assert np.array_equal(found.triangles, held)


def test_good_triangles_stay():
    found = flipped(Surface(POINTS, ALONG_THE_LOWER_EDGE), first=0, least_quality=0.05)
    assert np.array_equal(found.triangles, ALONG_THE_LOWER_EDGE)


def test_sliver_at_the_border_stays():
    alone = ALONG_THE_LOWER_EDGE[:3]
    found = flipped(Surface(POINTS, alone), first=0, least_quality=0.3)
    assert np.array_equal(found.triangles, alone)


def test_fold_stays():
    # Seen from the neighbour's apex, the sliver's lies beside the edge between them.
    points = POINTS.copy()
    points[2], points[4] = [0.9, 0.1, 0.0], [1.6, -0.1, 0.0]
    folded = np.array([[0, 4, 2], [4, 1, 2]])
    assert triangle_qualities(points, folded).min() > triangle_qualities(points, PAIR).min()
    found = flipped(Surface(points, PAIR), first=0, least_quality=0.3)
    assert np.array_equal(found.triangles, PAIR)


def test_edge_is_not_made_twice():
    # the diagonal of the pair is an edge already, of a triangle on the other side
    points = np.concatenate([POINTS, [[0.5, 0.0, 0.6]]])
    triangles = np.concatenate([ALONG_THE_LOWER_EDGE, [[2, 4, 5]]])
    found = flipped(Surface(points, triangles), first=0, least_quality=0.3)
    assert np.array_equal(found.triangles, triangles)
