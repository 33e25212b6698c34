import itertools
import pathlib

import numpy as np
import pytest
import skimage.measure
import trimesh

from jaxfsi.anatomy import Cut, SurfaceOptions, Triangles, read_triangles, surface_anatomy
from jaxfsi.anatomy.surfaces.crossings import crossing_faces
from jaxfsi.anatomy.surfaces.distance import nearest, surface_distance
from jaxfsi.anatomy.surfaces.edits import (
    extended_and_closed,
    refined,
    taubin_smoothed,
)
from jaxfsi.anatomy.surfaces.end_names import inlet_of, named_ends
from jaxfsi.anatomy.surfaces.flat_ends import boundary_loops, ends_of, outwards, without_caps
from jaxfsi.anatomy.surfaces.medial import medial_radius
from jaxfsi.anatomy.surfaces.triangles import cleaned, edges_of
from jaxfsi.measures import edge_lengths, enclosed_volume

R_AORTA, R_BRANCH, HALF, LENGTH = 1.0, 0.2, 2.0, 2.2
STEP = 0.08


def lengths(surface):
    return edge_lengths(surface.points, edges_of(surface.faces).ends)


def aorta_and_branch(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances to a tube along z and to a thin one along x that starts inside it [cm]."""
    branch = np.hypot(x[..., 1], x[..., 2]) - R_BRANCH
    return np.hypot(x[..., 0], x[..., 1]) - R_AORTA, np.maximum(branch, -x[..., 0])


def sliced(points: np.ndarray, faces: np.ndarray, normal: list[float], origin: list[float]):
    return trimesh.intersections.slice_faces_plane(
        points, faces, np.array(normal), np.array(origin)
    )[:2]


@pytest.fixture(scope="module")
def branching() -> Triangles:
    """A tube with a branch, cut open at three planes."""
    low, high = np.array([-1.3, -1.3, -HALF - 0.3]), np.array([LENGTH + 0.3, 1.3, HALF + 0.3])
    axes = [np.arange(a, b, STEP) for a, b in zip(low, high, strict=True)]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    points, faces, _, _ = skimage.measure.marching_cubes(
        np.minimum(*aorta_and_branch(x)), 0.0, spacing=(STEP,) * 3
    )
    points, faces = points + low, faces[:, ::-1].astype(np.int64)
    for normal, origin in (
        ([0.0, 0.0, 1.0], [0.0, 0.0, -HALF]),
        ([0.0, 0.0, -1.0], [0.0, 0.0, HALF]),
        ([-1.0, 0.0, 0.0], [LENGTH, 0.0, 0.0]),
    ):
        points, faces = sliced(points, faces, normal, origin)
    # Slicing leaves points a hair apart; slivers go with them.
    return outwards(cleaned(Triangles(points, faces)))


@pytest.fixture(scope="module")
def capped(branching: Triangles) -> Triangles:
    return extended_and_closed(branching, ends_of(branching), 0.0)


def tube(radius: float = 1.0, length: float = 4.0, n: int = 32, layers: int = 20) -> Triangles:
    """An open tube along z."""
    theta = 2.0 * np.pi * np.arange(n) / n
    ring = radius * np.stack([np.cos(theta), np.sin(theta)], axis=1)
    z = np.linspace(0.0, length, layers + 1)
    points = np.concatenate([np.column_stack([ring, np.full(n, h)]) for h in z])
    i = np.arange(n)
    low = (n * np.arange(layers)[:, None] + i).ravel()
    right = (n * np.arange(layers)[:, None] + (i + 1) % n).ravel()
    faces = np.concatenate(
        [np.stack([low, right, right + n], axis=1), np.stack([low, right + n, low + n], axis=1)]
    )
    return Triangles(points, faces)


def closed(surface: Triangles) -> Triangles:
    return extended_and_closed(surface, ends_of(surface), 0.0)


def soup(surface: Triangles, rng: np.random.Generator, noise: float = 0.0) -> trimesh.Trimesh:
    """Triangles with corners of their own, half of them turned over, with noise off the caps."""
    at_caps = np.unique(
        np.concatenate([loop for loop in boundary_loops(surface)] or [np.zeros(0, int)])
    )
    # Slicing has left slivers; noise larger than a triangle would be no measurement of it.
    ends = edges_of(surface.faces).ends
    shortest = np.full(len(surface.points), np.inf)
    for i in (0, 1):
        np.minimum.at(shortest, ends[:, i], lengths(surface))
    amplitude = np.minimum(noise, shortest / 6.0)
    shift = amplitude[:, None] * rng.normal(size=surface.points.shape)
    shift[at_caps] = 0.0
    mesh = extended_and_closed(
        Triangles(surface.points + shift, surface.faces), ends_of(surface), 0.0
    )
    turned = rng.random(len(mesh.faces)) < 0.5
    faces = np.where(turned[:, None], mesh.faces[:, ::-1], mesh.faces)
    return trimesh.Trimesh(
        mesh.points[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3), process=False
    )


def test_noisy_stl_with_broken_winding_becomes_an_anatomy(tmp_path, branching):
    path = tmp_path / "lumen.stl"
    rng = np.random.default_rng(1)
    mesh = soup(branching, rng, noise=0.006)
    mesh.apply_scale(10.0)
    mesh.export(path)
    anatomy = surface_anatomy(path, unit="mm")
    names = {opening.name: opening for opening in anatomy.openings}
    assert set(names) == {"aorta_inlet", "aorta_outlet", "anomalous_outlet"}
    np.testing.assert_allclose(names["anomalous_outlet"].centre, [LENGTH, 0.0, 0.0], atol=0.01)
    np.testing.assert_allclose(names["anomalous_outlet"].normal, [1.0, 0.0, 0.0], atol=1e-3)
    # The noise moves 2/3 of the surface less than 0.006; filtering removes most of it again.
    z = rng.uniform(-1.8, 1.8, 500)
    theta = rng.uniform(0.5, 2.0 * np.pi - 0.5, 500)
    on_aorta = np.stack([np.cos(theta), np.sin(theta), z], axis=1)
    assert np.sqrt(np.mean(anatomy.lumen(on_aorta) ** 2)) < 0.006
    x = rng.uniform(1.5, 2.1, 300)
    on_branch = np.stack([x, 0.2 * np.sin(theta[:300]), 0.2 * np.cos(theta[:300])], axis=1)
    assert np.sqrt(np.mean(anatomy.lumen(on_branch) ** 2)) < 0.008
    # No shrinking: the volume stays within 0.5 % while the noise goes.
    assert abs(anatomy.meta["smoothed_volume"] / anatomy.meta["volume"] - 1.0) < 5e-3


def test_radius_thickness_and_wall_of_a_branching_vessel(branching):
    options = SurfaceOptions(
        smoothing_steps=0, thickness_minimum=0.04, thickness_maximum=0.12, thickness_per_radius=0.12
    )
    anatomy = surface_anatomy(closed(branching), unit="cm", options=options)
    on_aorta, on_branch = np.array([[-1.0, 0.0, 0.7]]), np.array([[1.9, 0.0, 0.2]])
    # Facets of 0.1 cm turn the normals of a branch of 0.2 cm by up to 0.1/2/0.2 = 0.25, and the
    # ball between two of its points shrinks with 1 - 0.25²/2 and a sagitta of 0.1²/8/0.2.
    assert anatomy.local_radius(on_aorta)[0] == pytest.approx(R_AORTA, rel=0.03)
    assert anatomy.local_radius(on_branch)[0] == pytest.approx(R_BRANCH, rel=0.1)
    assert anatomy.thickness(on_aorta)[0] == pytest.approx(0.12, rel=0.05)
    assert anatomy.thickness(on_branch)[0] == pytest.approx(0.04, rel=0.15)
    rng = np.random.default_rng(2)
    x = rng.uniform([-1.3, -1.3, -1.7], [2.0, 1.3, 1.7], (4000, 3))
    aorta, branch = aorta_and_branch(x)
    # The wall is the union of both vessels' walls: thick beside the thin one, no notch. Within
    # 0.4 cm of the ostium the thickness passes from one to the other.
    away = np.linalg.norm(x - np.array([1.0, 0.0, 0.0]), axis=1) > 0.45
    exact = np.minimum(aorta - 0.12, branch - 0.04)
    near = away & (np.abs(exact) < 0.1) & (aorta > -0.05) & (branch > -0.05)
    # The facets lie up to 0.13²/8/0.2 = 0.01 cm inside, the radius and so the thickness up to 0.01.
    assert np.max(np.abs(anatomy.wall(x[near]) - exact[near])) < 0.025


def test_wall_beside_a_thin_branch_keeps_its_thickness(branching):
    anatomy = surface_anatomy(closed(branching), unit="cm")
    # Straight above the branch, where it leaves, the aortic outside is at R + t whatever the
    # branch does 0.45 cm below.
    x = np.array([[np.sqrt(1.0 - 0.0), 0.0, 0.7]])
    wall = anatomy.wall(x + np.array([[0.1, 0.0, 0.0]]))
    assert wall[0] < -0.5 * anatomy.thickness(x)[0] + 0.07


def test_open_and_capped_surfaces_give_the_same_ends(branching, capped):
    body, ends = without_caps(capped)
    given = ends_of(branching)
    assert len(ends) == 3
    assert enclosed_volume(*closed(body)) == pytest.approx(enclosed_volume(*capped), rel=1e-12)
    for end, other in zip(ends, given, strict=True):
        np.testing.assert_allclose(end.centre, other.centre, atol=2e-2)
        assert end.radius == pytest.approx(other.radius, rel=1e-6)
    # Polygons inscribed in a circle with 0.08 cm edges: 0.3 % (aorta), 3 % (branch).
    assert [end.radius for end in ends] == pytest.approx([1.0, 1.0, 0.2], rel=0.03)


def test_order_of_names_changes_nothing(branching):
    """Half of the orders name the ends of the aorta after the branch, or its outlet first."""
    given = {
        "aorta_inlet": [0.0, 0.0, -HALF],
        "aorta_outlet": [0.0, 0.0, HALF],
        "anomalous_outlet": [LENGTH, 0.0, 0.0],
    }
    end = {end.centre[2].round(): end for end in ends_of(branching)}
    ends = [end[-HALF], end[HALF], end[0.0]]
    named = dict(zip(given, ends, strict=True))
    for order in itertools.permutations(given):
        assert inlet_of({name: named[name] for name in order}) == "aorta_inlet"
        found = named_ends(ends, {name: given[name] for name in order}, 1.0)
        assert list(found) == list(given)
        assert all(found[name] is named[name] for name in given)
    usual = surface_anatomy(branching, unit="cm", names=given)
    turned = surface_anatomy(branching, unit="cm", names=dict(reversed(given.items())))
    assert [opening.name for opening in turned.openings] == list(given)
    assert list(turned.centerlines) == list(usual.centerlines) == ["aorta", "anomalous"]
    for name, line in usual.centerlines.items():
        np.testing.assert_array_equal(turned.centerlines[name].points, line.points)


def test_ends_are_named_by_the_user_and_cuts_are_added(branching):
    names = {"inlet": [0.0, 0.0, -HALF], "arch": [0.0, 0.0, HALF], "rca": [LENGTH, 0.0, 0.0]}
    anatomy = surface_anatomy(branching, unit="cm", names=names)
    assert [opening.name for opening in anatomy.openings] == ["inlet", "arch", "rca"]
    assert set(anatomy.centerlines) == {"arch", "rca"}
    assert np.max(np.abs(anatomy.centerlines["arch"].points[5:-5, :2])) < 0.3
    with pytest.raises(ValueError, match=r"2 names for 3 ends.*\[.*\] and \[.*Name every end"):
        surface_anatomy(branching, unit="cm", names=dict(list(names.items())[:2]))
    with pytest.raises(ValueError, match=r"no end of the surface lies near.*'rca'; they lie at"):
        surface_anatomy(branching, unit="cm", names=names | {"rca": [0.0, 2.0, 0.0]})
    cut = {"aside": Cut([1.8, 0.0, 0.0], [2.0, 0.0, 0.0], 0.2)}
    assert surface_anatomy(branching, unit="cm", cuts=cut).openings[-1].name == "aside"
    with pytest.raises(ValueError, match=r"cut 'side'.*outside the lumen"):
        surface_anatomy(branching, unit="cm", cuts={"side": Cut([3.0, 0, 0], [1.0, 0, 0], 0.2)})


def test_a_surface_without_flat_ends_is_opened_by_its_cuts():
    ball = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    points = np.asarray(ball.vertices) * [1.0, 1.0, 2.0]
    cuts = {
        "aorta_inlet": Cut([0.0, 0.0, -1.2], [0.0, 0.0, -1.0], 0.8),
        "aorta_outlet": Cut([0.0, 0.0, 1.2], [0.0, 0.0, 1.0], 0.8),
    }
    rounded = Triangles(points, np.asarray(ball.faces, dtype=np.int64))
    anatomy = surface_anatomy(rounded, unit="cm", cuts=cuts)
    assert [opening.name for opening in anatomy.openings] == list(cuts)
    assert anatomy.centerlines == {}


@pytest.mark.parametrize(
    "name",
    [
        "pipe3d_rcr/mesh-complete/mesh-complete.exterior.vtp",
        "pipe3d_rcr/mesh-complete/mesh-surfaces/lumen_wall.vtp",
        "pipe_prestress/lumen_mesh-complete/mesh-complete.exterior.vtp",
    ],
)
def test_pipes_of_another_project(shared_data: pathlib.Path, name: str):
    anatomy = surface_anatomy(shared_data / "svfsi-tests" / name, unit="cm")
    assert [opening.centre[2] for opening in anatomy.openings] == pytest.approx([0.0, 30.0])
    rng = np.random.default_rng(3)
    theta, z = rng.uniform(0.0, 2.0 * np.pi, 2000), rng.uniform(0.5, 29.5, 2000)
    radius = rng.uniform(1.8, 2.3, 2000)
    x = np.stack([radius * np.cos(theta), radius * np.sin(theta), z], axis=1)
    # Facets of up to 1 cm on a radius of 2 cm lie up to 1²/8/2 = 0.06 cm inside.
    np.testing.assert_allclose(anatomy.lumen(x), radius - 2.0, atol=0.07)
    np.testing.assert_allclose(anatomy.wall(x), radius - 2.15, atol=0.07)
    assert anatomy.centerlines["aorta"].s[-1] == pytest.approx(30.0, rel=1e-2)


def test_distance_is_that_to_the_nearest_of_all_triangles(capped):
    fine = refined(capped, 1.5 * float(np.median(lengths(capped))))
    rng = np.random.default_rng(4)
    x = rng.uniform(fine.points.min(axis=0) - 0.5, fine.points.max(axis=0) + 0.5, (1500, 3))
    found = nearest(surface_distance(fine), x)
    mesh = trimesh.Trimesh(fine.points, fine.faces, process=False)
    exact = np.full(len(x), np.inf)
    for corners in np.array_split(mesh.triangles, 40):
        for i, point in enumerate(x[::10]):
            near = trimesh.triangles.closest_point(corners, np.tile(point, (len(corners), 1)))
            exact[10 * i] = min(exact[10 * i], np.min(np.linalg.norm(near - point, axis=1)))
    np.testing.assert_allclose(np.abs(found.distance[::10]), exact[::10], atol=1e-9)
    inside = (np.minimum(*aorta_and_branch(x)) < 0.0) & (np.abs(x[:, 2]) < HALF)
    inside &= x[:, 0] < LENGTH
    sure = np.abs(found.distance) > 0.01
    np.testing.assert_array_equal(found.distance[sure] < 0.0, inside[sure])


def test_distance_to_a_sphere_converges_at_second_order():
    errors = []
    for level in (2, 3, 4):
        sphere = trimesh.creation.icosphere(subdivisions=level)
        ready = surface_distance(Triangles(np.array(sphere.vertices), np.array(sphere.faces)))
        x = np.random.default_rng(5).normal(size=(2000, 3))
        errors.append(np.max(np.abs(nearest(ready, x).distance - np.linalg.norm(x, axis=1) + 1.0)))
    # Facets of size h lie h²/8 inside: a factor of four a level.
    rates = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(rates > 1.8)


def test_medial_radius_of_a_slit_is_half_its_minor_axis():
    slit = tube(1.0, 3.0, 120, 60)
    points = slit.points * np.array([0.28, 0.06, 1.0])
    body = closed(Triangles(points, slit.faces))
    flat = (np.abs(body.points[:, 0]) < 0.05) & (np.abs(body.points[:, 2] - 1.5) < 0.7)
    # Points 0.05 cm apart along the slit: the ball of 0.06 cm is found too large by at most
    # √(0.06² + 0.025²)/0.06 = 8 %.
    np.testing.assert_allclose(medial_radius(body)[flat], 0.06, rtol=0.08)


def test_smoothing_removes_noise_without_shrinking():
    pipe = tube(1.0, 4.0, 48, 40)
    loops = np.concatenate(boundary_loops(pipe))
    rng = np.random.default_rng(6)
    noisy = pipe.points + 0.01 * rng.normal(size=pipe.points.shape)
    noisy[loops] = pipe.points[loops]
    smooth = taubin_smoothed(Triangles(noisy, pipe.faces), 20, fixed=loops)
    np.testing.assert_array_equal(smooth.points[loops], pipe.points[loops])

    def spread(points: np.ndarray) -> float:
        return float(np.std(np.hypot(points[:, 0], points[:, 1])))

    assert spread(smooth.points) < 0.4 * spread(noisy)
    radius = np.mean(np.hypot(smooth.points[:, 0], smooth.points[:, 1]))
    assert radius == pytest.approx(1.0, abs=2e-3)


def test_splitting_keeps_the_surface_closed_and_its_volume(capped):
    fine = refined(capped, 0.1)
    assert np.max(lengths(fine)) <= 0.1
    assert np.all(edges_of(fine.faces).shared_by == 2)
    # Points are added on the flat triangles only.
    assert enclosed_volume(*fine) == pytest.approx(enclosed_volume(*capped), rel=1e-12)


def test_lower_case_suffixes_and_formats_agree(tmp_path, branching):
    mesh = trimesh.Trimesh(branching.points, branching.faces, process=False)
    for suffix in ("stl", "STL", "ply", "obj"):
        path = tmp_path / f"lumen.{suffix}"
        mesh.export(path, file_type=suffix.lower())
        surface = cleaned(read_triangles(path))
        assert len(surface.faces) == len(branching.faces)
        np.testing.assert_allclose(
            np.ptp(surface.points, axis=0), np.ptp(branching.points, axis=0), rtol=1e-6
        )


def refused(surface: Triangles | pathlib.Path, match: str, **changes: object) -> None:
    with pytest.raises(ValueError, match=match):
        surface_anatomy(surface, **({"unit": "cm"} | changes))


def test_open_surface_is_refused():
    pipe = tube(n=64, layers=40)
    middle = pipe.points[pipe.faces].mean(axis=1)
    hole = np.linalg.norm(middle - np.array([1.0, 0.0, 2.0]), axis=1) < 0.5
    refused(Triangles(pipe.points, pipe.faces[~hole]), r"open.*hole in the wall.*Fill the holes")
    ragged = (middle[:, 2] > 3.0) & (middle[:, 0] > 0.0)
    refused(Triangles(pipe.points, pipe.faces[~ragged]), r"open.*ragged edge.*cut the vessel ends")


def test_small_holes_are_closed():
    pipe = tube(n=64, layers=40)
    keep = np.ones(len(pipe.faces), dtype=bool)
    keep[700] = False
    anatomy = surface_anatomy(Triangles(pipe.points, pipe.faces[keep]), unit="cm")
    assert len(anatomy.openings) == 2


def test_self_intersection_is_refused():
    pipe = tube(n=64, layers=40)
    points = pipe.points.copy()
    dent = np.exp(-((points[:, 2] - 2.0) ** 2 + points[:, 1] ** 2) / 0.05) * (points[:, 0] > 0.0)
    points[:, 0] -= 2.4 * dent
    refused(Triangles(points, pipe.faces), r"intersects itself.*Remesh or smooth")
    one, other = tube(n=12, layers=2), tube(n=12, layers=2)
    crossing = Triangles(
        np.concatenate([one.points, other.points[:, [2, 0, 1]] + np.array([-2.0, 0.0, 2.0])]),
        np.concatenate([one.faces, other.faces + len(one.points)]),
    )
    assert len(crossing_faces(*crossing, tolerance=1e-9)) > 0
    assert len(crossing_faces(*one)) == 0


def test_coronary_that_does_not_touch_the_aorta_is_refused():
    aorta, coronary = closed(tube()), closed(tube(0.2, 2.0))
    apart = Triangles(
        np.concatenate([aorta.points, coronary.points + np.array([1.5, 0.0, 1.0])]),
        np.concatenate([aorta.faces, coronary.faces + len(aorta.points)]),
    )
    refused(apart, r"2 pieces.*does not touch.*Join or remove")


def test_small_island_is_dropped():
    aorta, island = closed(tube()), closed(tube(0.02, 0.1))
    both = Triangles(
        np.concatenate([aorta.points, island.points + np.array([1.5, 0.0, 1.0])]),
        np.concatenate([aorta.faces, island.faces + len(aorta.points)]),
    )
    assert len(surface_anatomy(both, unit="cm").openings) == 2


def test_non_manifold_and_one_sided_surfaces_are_refused():
    pipe = tube()
    extra = Triangles(
        np.concatenate([pipe.points, [[0.0, 0.0, 2.0]]]),
        np.concatenate([pipe.faces, [[330, 331, len(pipe.points)]]]),
    )
    refused(extra, r"edges have more than two triangles.*Remesh")
    n, theta = 40, np.pi * np.arange(40) / 40
    strip = [
        np.stack(
            [
                (1.0 + w * np.cos(theta)) * np.cos(2.0 * theta),
                (1.0 + w * np.cos(theta)) * np.sin(2.0 * theta),
                w * np.sin(theta),
            ],
            axis=1,
        )
        for w in (-0.3, 0.3)
    ]
    i = np.arange(n - 1)
    faces = np.concatenate(
        [
            np.stack([i, i + 1, i + n], axis=1),
            np.stack([i + 1, i + 1 + n, i + n], axis=1),
            [[n - 1, n, 2 * n - 1], [n, 0, 2 * n - 1]],
        ]
    )
    refused(Triangles(np.concatenate(strip), faces), r"one side only.*Remesh")


def test_thickness_larger_than_the_radius_is_refused():
    options = SurfaceOptions(thickness_minimum=0.6, thickness_maximum=0.8)
    refused(tube(0.5, 3.0), r"wall of .* is thicker than the vessel's radius", options=options)


def test_missing_caps_are_refused():
    ball = trimesh.creation.icosphere(subdivisions=3)
    refused(Triangles(np.array(ball.vertices), np.array(ball.faces)), r"0 caps.*Cut the vessel")
    box = trimesh.creation.box(extents=(1.0, 1.0, 3.0))
    refused(Triangles(np.array(box.vertices), np.array(box.faces)), r"0 caps")


@pytest.mark.parametrize(("radius", "unit"), [(14.0, "cm"), (1.4, "mm"), (0.014, "m")])
def test_unit_wrong_by_a_factor_of_ten_is_judged_by_the_largest_opening(radius, unit):
    pipe = tube(radius, 4.0 * radius)
    if unit == "m":
        assert len(surface_anatomy(pipe, unit="m").openings) == 2
    else:
        refused(pipe, rf"largest opening.*unit \({unit}\) is probably wrong", unit=unit)


def test_end_beside_another_vessel_is_refused():
    """A U-turn: both ends lie side by side, so a plane through one would cut the other's wall."""
    phi = np.linspace(0.0, np.pi, 40)[:, None]
    theta = 2.0 * np.pi * np.arange(24) / 24
    across = 1.1 + 0.5 * np.cos(theta)
    points = np.stack(
        [across * np.cos(phi), across * np.sin(phi), 0.5 * np.sin(theta) + 0.0 * phi], axis=2
    ).reshape(-1, 3)
    faces = tube(n=24, layers=39).faces
    surface_anatomy(Triangles(points, faces), unit="cm")
    near = points * np.array([0.5, 1.5, 1.6])
    refused(Triangles(near, faces), r"another part of the anatomy lies within.*Cut the vessel")


def test_empty_truncated_and_unknown_files_are_refused(tmp_path):
    mesh = trimesh.Trimesh(*tube(), process=False)
    for name, text in (("a.stl", b""), ("a.vtp", b""), ("a.ply", b"")):
        (tmp_path / name).write_bytes(text)
        refused(tmp_path / name, r"empty")
    for suffix, kind in (("stl", "stl"), ("stl", "stl_ascii"), ("ply", "ply"), ("obj", "obj")):
        path = tmp_path / f"b.{suffix}"
        data = mesh.export(file_type=kind)
        data = data.encode() if isinstance(data, str) else data
        path.write_bytes(data[: 2 * len(data) // 3])
        refused(path, r"truncated|open")
    refused(tmp_path / "missing.stl", r"no such file")
    refused(tmp_path / "a.docx", r"not a known surface format.*Save it")
    refused(Triangles(np.zeros((3, 3)), np.zeros((0, 3), dtype=np.int64)), r"no triangles")
    refused(Triangles(np.zeros((3, 3)), np.array([[0, 1, 2]])), r"shrinks to a point")
