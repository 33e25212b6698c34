"""Where the aortic pressure of a ratio is read, and how it shifts the means."""

import dataclasses

import numpy as np
import pytest

from jaxfsi.anatomy import Anatomy, Centerline
from jaxfsi.fields.aortic_site import aortic_site, cycle_offsets
from jaxfsi.mesh import Region
from jaxfsi.meshing import tube


def _anatomy(ostium):
    z = np.linspace(0.0, 3.0, 31)
    axis = np.stack([0.0 * z, 0.0 * z, z], axis=1)
    artery = np.array(ostium)[None, :] + np.linspace(0.0, 1.0, 5)[:, None] * np.array([[1.0, 0, 0]])
    lines = {
        "aorta": Centerline(axis, z),
        "anomalous": Centerline(artery, np.linspace(0.0, 1.0, 5)),
    }

    def nothing(x):
        return np.zeros(len(x))

    bounds = np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 3.0]])
    return Anatomy("test", nothing, nothing, nothing, nothing, (), bounds, lines)


def test_site_lies_midway_between_ostium_and_axis_at_its_level():
    mesh = tube(radius=1.0, length=3.0, thickness=0.2, n_around=16, n_axial=24, n_layers=1)
    nodes = aortic_site(mesh, _anatomy([1.0, 0.0, 1.5]))
    assert nodes is not None
    assert set(nodes) <= set(np.unique(mesh.tets_of(Region.FLUID)))
    np.testing.assert_allclose(mesh.points[nodes].mean(axis=0), [0.5, 0.0, 1.5], atol=0.12)


def test_no_site_without_centre_lines():
    mesh = tube(radius=1.0, length=3.0, thickness=0.2, n_around=10, n_axial=5, n_layers=1)
    assert aortic_site(mesh, None) is None
    anatomy = _anatomy([1.0, 0.0, 1.5])
    assert aortic_site(mesh, dataclasses.replace(anatomy, centerlines={})) is None


def test_offset_of_each_cycle_is_its_own_mean():
    """Two cycles of 0.8 s with ten frames each; the frame at 0.8 s closes the first."""
    t = 0.08 * np.arange(1, 21)
    difference = np.where(t <= 0.8 + 1e-9, 1.5, -0.5)
    assert cycle_offsets(t, difference, 0.8, 2) == pytest.approx([1.5, -0.5])
    wave = np.cos(2.0 * np.pi * t / 0.8) + 2.0
    assert cycle_offsets(t, wave, 0.8, 2) == pytest.approx([2.0, 2.0], abs=1e-12)
