import numpy as np
import pytest

from jaxfsi.anatomy import Opening
from jaxfsi.meshing.surface.clipping import clip, find_loops, flatten_loops, on_planes
from jaxfsi.meshing.surface.isosurface import Surface
from jaxfsi.meshing.surface.topology import surface_topology

UP = np.array([0.0, 0.0, 1.0])


def cylinder(radius: float, low: float, high: float, *, n: int = 40, levels: int = 31) -> Surface:
    """Open cylinder about z, normals outwards."""
    angle = 2.0 * np.pi * np.arange(n) / n
    z = np.linspace(low, high, levels)
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = np.concatenate([np.column_stack([ring, np.full(n, level)]) for level in z])
    i, j = np.meshgrid(np.arange(n), np.arange(levels - 1))
    a, b = (i + n * j).ravel(), ((i + 1) % n + n * j).ravel()
    return Surface(
        points, np.concatenate([np.stack([a, b, b + n], 1), np.stack([a, b + n, a + n], 1)])
    )


def ends(low: float = -1.03, high: float = 1.07, ball: float = 0.8) -> tuple[Opening, ...]:
    return (Opening("inlet", low * UP, -UP, ball), Opening("outlet", high * UP, UP, ball))


def test_clipped_tube_ends_in_flat_loops_of_its_radius():
    clipped = clip(cylinder(0.5, -2.0, 2.0), ends(), what="lumen")
    for loop, opening in zip(clipped.loops, ends(), strict=True):
        x = clipped.surface.points[loop] - opening.centre
        np.testing.assert_allclose(x @ opening.normal, 0.0, atol=1e-12)  # round-off of a shift
        # Flat facets of a 40-gon lie up to 0.5 (1 − cos 4.5°) = 1.5e-3 inside.
        np.testing.assert_allclose(np.linalg.norm(x, axis=1), 0.5, atol=1.6e-3)
    area = (
        np.linalg.norm(
            np.cross(
                *(
                    clipped.surface.points[clipped.surface.triangles[:, i]]
                    - clipped.surface.points[clipped.surface.triangles[:, 0]]
                    for i in (1, 2)
                )
            ),
            axis=1,
        ).sum()
        / 2.0
    )
    # The 40-gon's perimeter times the length; snapped vertices shift none of it off the facets.
    np.testing.assert_allclose(area, 40 * np.sin(np.pi / 40) * 2.1, rtol=1e-3)
    topology = surface_topology(*clipped.surface)
    assert (topology.euler, topology.n_components, topology.crowded_edges) == (0, 1, 0)


def test_rough_surfaces_are_cut_in_simple_loops():
    for seed in range(20):
        smooth = cylinder(0.5, -2.0, 2.0)
        noise = 0.025 * np.random.default_rng(seed).normal(size=smooth.points.shape)
        clipped = clip(Surface(smooth.points + noise, smooth.triangles), ends(), what="lumen")
        topology = surface_topology(*clipped.surface)
        assert (topology.euler, topology.n_components, topology.pinched_nodes) == (0, 1, 0)


def test_plane_acts_only_in_its_ball():
    one, other = cylinder(0.3, -2.0, 2.0), cylinder(0.3, -2.0, 0.6)
    both = Surface(
        np.concatenate([one.points, other.points + np.array([3.0, 0.0, 0.0])]),
        np.concatenate([one.triangles, other.triangles + len(one.points)]),
    )
    clipped = clip(both, ends(ball=0.6), what="lumen")
    assert clipped.surface.points[:, 0].max() < 0.31  # the larger component only
    assert np.ptp(clipped.surface.points[:, 2]) == pytest.approx(2.1, abs=1e-12)


def test_loops_are_flattened_and_held_in_their_planes():
    clipped = clip(cylinder(0.5, -2.0, 2.0), ends(), what="lumen")
    points = clipped.surface.points.copy()
    points[clipped.loops[1]] += 1e-4 * UP
    bent = Surface(points, clipped.surface.triangles)
    loops = find_loops(bent, ends(), what="lumen")
    flat = flatten_loops(clipped._replace(surface=bent, loops=loops), ends())
    np.testing.assert_allclose(flat.surface.points[loops[1], 2], 1.07, atol=1e-12)
    normals = on_planes(flat, ends())
    np.testing.assert_array_equal(normals[loops[0]], np.tile(-UP, (len(loops[0]), 1)))
    assert np.count_nonzero(normals) == sum(map(len, loops))


@pytest.mark.parametrize(
    ("openings", "message"),
    [
        (ends(high=5.0), "misses"),
        ((*ends(), Opening("side", np.array([0.6, 0.0, 0.0]), np.eye(3)[0], 0.05)), "misses"),
        (ends()[:1], "borders but 1 openings"),
        (ends(ball=0.45), "outlet|inlet"),
    ],
)
def test_openings_that_do_not_cut_the_vessel_are_refused(openings, message):
    with pytest.raises(ValueError, match=message):
        clip(cylinder(0.5, -2.0, 2.0), openings, what="lumen")


def test_vessels_that_do_not_touch_are_refused():
    one = cylinder(0.5, -2.0, 2.0)
    apart = np.array([3.0, 0.0, 0.0])
    two = cylinder(0.2, -1.0, 1.0)
    both = Surface(
        np.concatenate([one.points, two.points + apart]),
        np.concatenate([one.triangles, two.triangles + len(one.points)]),
    )
    branch = Opening("branch", apart + 0.5 * UP, UP, 0.4)
    with pytest.raises(ValueError, match="'branch' is not joined"):
        clip(both, (*ends(), branch), what="lumen")
