import numpy as np
import pytest

from jaxfsi.mesh import Region, tet_volumes
from jaxfsi.mesh_checks import check_mesh
from jaxfsi.meshing import bent, check_topology, elliptic, mesh_quality, ring, strip, tube
from jaxfsi.meshing.structured.prisms import strip_between


def test_tube_volume_converges_with_second_order():
    errors = []
    for n_around in (8, 16, 32):
        mesh = tube(radius=0.5, length=1.0, thickness=0.1, n_around=n_around, n_axial=2)
        fluid = tet_volumes(mesh.points, mesh.tets_of(Region.FLUID)).sum()
        errors.append(abs(fluid - np.pi * 0.25))
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    # Polygon area: 1 - sin x / x = x^2/6 (1 - x^2/20), x = 2 pi / n; at n = 8 that is 0.034.
    np.testing.assert_allclose(orders, 2.0, atol=0.04)


@pytest.mark.parametrize("n_around", [3, 7, 16])
@pytest.mark.parametrize("n_layers", [0, 1, 3])
@pytest.mark.parametrize("n_rings", [None, 1, 4])
def test_any_counts_give_a_sound_mesh(n_around, n_layers, n_rings):
    mesh = tube(
        radius=0.2,
        length=0.5,
        thickness=0.05,
        n_around=n_around,
        n_axial=3,
        n_layers=n_layers,
        n_rings=n_rings,
    )
    check_mesh(mesh)
    assert check_topology(mesh).faults == ()
    assert len(mesh.labelled("interface")) == 2 * n_around * 3


def test_section_between_unequal_rings_closes():
    triangles = strip_between(np.arange(5), np.arange(5, 17))
    assert len(triangles) == 5 + 12
    directed = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    keys = {tuple(edge) for edge in directed}
    assert len(keys) == len(directed)
    inner = {(i, (i + 1) % 5) for i in range(5)}
    outer = {(5 + i, 5 + (i + 1) % 12) for i in range(12)}
    assert outer <= keys
    assert {(b, a) for a, b in inner} <= keys


def test_a_bend_keeps_the_axis_and_the_volume():
    straight = tube(radius=0.3, length=2.0, thickness=0.1, n_around=16, n_axial=40)
    curved = tube(
        radius=0.3,
        length=2.0,
        thickness=0.1,
        n_around=16,
        n_axial=40,
        mapping=bent(bend_radius=2.0),
    )
    ratio = (
        tet_volumes(curved.points, curved.tets).sum()
        / tet_volumes(straight.points, straight.tets).sum()
    )
    # Pappus; the chords of 40 steps of 0.025 rad fall short by angle^2 / 6 = 1e-4.
    assert ratio == pytest.approx(1.0, abs=2e-4)
    end = curved.points[curved.labelled("outlet")].mean(axis=(0, 1))
    # The mean of face corners weights the disc evenly but for its rings.
    np.testing.assert_allclose(end, [2.0 - 2.0 * np.cos(1.0), 0.0, 2.0 * np.sin(1.0)], atol=1e-3)


def test_an_ellipse_keeps_its_area():
    mesh = tube(
        radius=0.2,
        length=0.5,
        thickness=0.05,
        n_around=16,
        n_axial=3,
        mapping=elliptic(axis_ratio=2.5),
    )
    round_area = 0.5 * 16 * np.sin(2.0 * np.pi / 16) * 0.04
    # An affine map of determinant one: exact but for round-off.
    assert mesh_quality(mesh).area_cm2["inlet"] == pytest.approx(round_area, rel=1e-12)
    extent = np.ptp(mesh.points[mesh.labelled("interface")].reshape(-1, 3), axis=0)
    assert extent[0] / extent[1] == pytest.approx(2.5, rel=1e-12)


def test_a_strip_names_its_six_sides():
    mesh = strip(length=1.0, width=0.3, thickness=0.1, n_length=6, n_width=3, n_layers=2)
    check_mesh(mesh)
    assert mesh.label_names == ("x_min", "x_max", "y_min", "y_max", "z_min", "z_max")
    areas = mesh_quality(mesh).area_cm2
    expected = {"x": 0.03, "y": 0.1, "z": 0.3}
    for name, area in areas.items():
        assert area == pytest.approx(expected[name[0]], rel=1e-12)
    assert np.all(mesh.points[mesh.labelled("x_max")][:, :, 0] == 1.0)
    assert len(mesh.tets) == 6 * 3 * 2 * 6


def test_a_ring_is_the_wall_of_the_tube():
    mesh = ring(radius=0.5, length=0.2, thickness=0.25, n_around=20, n_axial=2, n_layers=3)
    check_mesh(mesh)
    assert mesh.label_names == ("interface", "outer_wall", "inlet_ring", "outlet_ring")
    assert np.all(mesh.region == Region.SOLID)
    assert len(mesh.points) == 20 * 4 * 3
    corners = mesh.points[mesh.labelled("interface")]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.all(np.sum(normal * corners.mean(axis=1) * [1.0, 1.0, 0.0], axis=1) < 0.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"radius": -0.5}, "radius = -0.5"),
        ({"thickness": 0.0}, "thickness = 0.0"),
        ({"length": np.inf}, "length = inf"),
        ({"n_around": 2}, "n_around = 2"),
        ({"n_axial": 0}, "n_axial = 0"),
        ({"n_layers": -1}, "n_layers = -1"),
        ({"n_rings": 0}, "n_rings = 0"),
        ({"mapping": bent(bend_radius=0.4)}, "inside out"),
    ],
)
def test_impossible_tubes_are_refused(change, message):
    sound = {"radius": 0.5, "length": 1.0, "thickness": 0.1, "n_around": 8, "n_axial": 4}
    with pytest.raises(ValueError, match=message):
        tube(**(sound | change))


def test_impossible_shapes_are_refused():
    with pytest.raises(ValueError, match="1 or more"):
        elliptic(axis_ratio=0.5)
    with pytest.raises(ValueError, match="positive lengths and counts"):
        strip(length=1.0, width=0.0, thickness=0.1, n_length=1, n_width=1, n_layers=1)
    with pytest.raises(ValueError, match="n_layers = 0"):
        ring(radius=0.5, length=0.2, thickness=0.1, n_around=8, n_axial=1, n_layers=0)
