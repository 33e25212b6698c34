"""Pressure and lumen along an artery: exact for fields that are linear in the tetrahedra."""

import types

import numpy as np
import pytest

from jaxfsi.anatomy.anatomy import Centerline
from jaxfsi.fields.artery_profile import artery_profile, section_values
from jaxfsi.fields.frame import Grid
from jaxfsi.fields.series import Entry
from jaxfsi.mesh import INTERFACE, Region
from jaxfsi.meshing import tube
from jaxfsi.opening import ANOMALOUS

LENGTH, RADIUS = 2.0, 0.2


@pytest.fixture(scope="module")
def vessel():
    mesh = tube(radius=RADIUS, length=LENGTH, thickness=0.05, n_around=24, n_axial=16, n_layers=1)
    z = np.linspace(0.0, LENGTH, 101)
    line = Centerline(np.stack([0.0 * z, 0.0 * z, z], axis=1), z)
    return mesh, types.SimpleNamespace(centerlines={ANOMALOUS: line})


def polygon_area(mesh) -> float:
    """Area of the section of the meshed tube, a polygon."""
    rim = mesh.points[np.unique(mesh.labelled(INTERFACE))]
    angle = np.unique(np.round(np.arctan2(rim[:, 1], rim[:, 0]), 9))
    n = len(np.unique(np.round(angle % (2.0 * np.pi), 6)))
    return 0.5 * n * np.sin(2.0 * np.pi / n) * RADIUS**2


@pytest.mark.parametrize("tilt", [0.0, 0.4])
def test_mean_of_a_linear_field_over_a_section_is_its_value_at_the_middle(vessel, tilt):
    mesh, _ = vessel
    fluid = mesh.tets[mesh.region == Region.FLUID]
    values = 3.0 + mesh.points @ np.array([2.0, -1.0, 5.0])
    centre, normal = np.array([0.02, 0.01, 0.93]), np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    mean, area, minor = section_values(
        mesh.points, mesh.labelled(INTERFACE), fluid, values, centre, normal
    )
    middle = np.array([0.0, 0.0, 0.93 + 0.02 * np.tan(tilt)])  # of the ellipse on the axis
    assert mean == pytest.approx(3.0 + middle @ [2.0, -1.0, 5.0], abs=1e-9)
    assert area == pytest.approx(polygon_area(mesh) / np.cos(tilt), rel=1e-9)
    assert minor == pytest.approx(2.0 * RADIUS, rel=0.01)


def test_profile_of_a_run_is_that_of_its_fields(vessel, tmp_path):
    mesh, anatomy = vessel
    grid = Grid(mesh.points, mesh.tets, {"region": mesh.region.astype(np.uint8)})
    fluid_nodes = np.zeros(len(mesh.points), bool)
    fluid_nodes[np.unique(mesh.tets[mesh.region == Region.FLUID])] = True
    period, t = 0.8, np.linspace(0.0, 1.6, 41)
    across = mesh.points * np.array([1.0, 1.0, 0.0])
    entries = []
    for k, now in enumerate(t):
        wave = np.sin(2.0 * np.pi * now / period)
        P = 90.0 + 20.0 * wave - (8.0 + 3.0 * wave) * mesh.points[:, 2]
        P = np.where(fluid_nodes, P, np.nan)
        fields = {"pressure_mmHg": P.astype(np.float32)}
        fields["displacement_cm"] = (0.1 * wave * across).astype(np.float32)
        entries.append(Entry(float(now), f"f_{k:07d}.vtu"))
        grid.write(tmp_path / entries[-1].file, float(now), fields)
    aorta = t, 90.0 + 20.0 * np.sin(2.0 * np.pi * t / period)
    found = artery_profile(tmp_path, entries, mesh, anatomy, period, aorta)
    assert found is not None
    np.testing.assert_allclose(found.P, 90.0 - 8.0 * found.s, atol=1e-4)
    assert found.P_aorta == pytest.approx(90.0, abs=1e-9)
    np.testing.assert_allclose(found.ratio[-1], (90.0 - 8.0 * 1.98) / 90.0, atol=1e-5)
    area = polygon_area(mesh)
    np.testing.assert_allclose(found.image_area, area, rtol=1e-6)
    # the mean of (1 + 0.1 sin)²; the least at the lowest radius
    np.testing.assert_allclose(found.area, area * 1.005, rtol=1e-5)
    np.testing.assert_allclose(found.least_area, area * 0.81, rtol=1e-5)
    np.testing.assert_allclose(found.least_minor, 0.9 * found.image_minor, rtol=1e-5)
    np.testing.assert_allclose(found.moved, 0.0, atol=1e-7)


def test_nothing_is_told_without_an_axis_or_a_frame(vessel, tmp_path):
    mesh, anatomy = vessel
    aorta = np.array([0.0, 1.0]), np.array([90.0, 90.0])
    assert artery_profile(tmp_path, [], mesh, anatomy, 0.8, aorta) is None
    bare = types.SimpleNamespace(centerlines={})
    assert artery_profile(tmp_path, [Entry(0.0, "x")], mesh, bare, 0.8, aorta) is None
