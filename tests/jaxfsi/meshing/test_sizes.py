import dataclasses

import numpy as np
import pytest

from jaxfsi.meshing.surface.isosurface import extract_surface
from jaxfsi.meshing.surface.sizes import (
    SurfaceSamples,
    choose_sizes,
    grown_field,
    predicted_tets,
    sample_surface,
    size_at,
    solid_depth,
)
from jaxfsi.meshing.volume.lattice import LatticeSettings, sample_lattice


@pytest.fixture(scope="module")
def tube(branched_tube):
    return branched_tube()


@pytest.fixture(scope="module")
def samples(tube) -> SurfaceSamples:
    lattice = sample_lattice(tube, LatticeSettings(smallest=0.03))
    surface = extract_surface(lattice.points, lattice.tets, lattice.lumen, tube.lumen)
    return sample_surface(tube, surface)


def test_field_grows_at_most_at_its_rate_and_from_the_smallest():
    random = np.random.default_rng(0)
    points = random.uniform(size=(300, 3))
    sizes = random.uniform(0.02, 0.4, size=300)
    field = grown_field(points, sizes, growth=0.3)
    x = random.uniform(-0.5, 1.5, size=(400, 3))
    h = size_at(field, x)
    distance = np.linalg.norm(x[:, None] - points[None], axis=2)
    exact = np.minimum((sizes + 0.3 * distance).min(axis=1), sizes.max())
    assert np.all(h >= exact - 1e-12)
    # The nearest point of a bin stands for the bin: its size may exceed the least by a bin, 28 %.
    assert np.all(h <= 1.29 * exact)


def test_solid_depth_is_the_wall_or_the_septum(tube):
    up, x = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    points = np.array([-x, -x + 0.4 * up, x + 0.05 * up])
    depth = solid_depth(tube, points, np.array([-x, -x, x]), limit=0.3)
    # The way ends within a hundredth of the limit of the surface, 3e-3.
    np.testing.assert_allclose(depth, [0.12, 0.12, 0.06], atol=3e-3)


@pytest.mark.parametrize("name", ["lumen", "wall", "local_radius", "thickness"])
def test_anatomy_that_is_no_number_somewhere_is_refused(branched_tube, name):
    tube = branched_tube()
    lattice = sample_lattice(tube, LatticeSettings(smallest=0.03))
    surface = extract_surface(lattice.points, lattice.tets, lattice.lumen, tube.lumen)
    whole = getattr(tube, name)

    def torn(x):
        return np.where(x[:, 2] > 0.2, np.nan, whole(x))

    broken = dataclasses.replace(tube, **{name: torn})
    with pytest.raises(ValueError, match=r"is not a number at .* places, first at"):
        sample_surface(broken, surface)


def test_solid_depth_stops_at_its_limit(tube):
    along = np.array([[0.0, 1.0, 0.0]])
    depth = solid_depth(tube, np.array([[-1.06, 0.0, 0.0]]), along, limit=0.1)
    np.testing.assert_allclose(depth, 0.1, atol=1e-9)  # the ray stays inside the wall


def test_samples_cover_the_lumen_between_the_openings(samples):
    # Aorta 2π R · 1.4 plus the branch less the ostium; a tenth of slack for the latter two.
    assert 2.0 * np.pi * 1.4 < samples.area.sum() < 1.2 * 2.0 * np.pi * 1.4
    assert np.all((samples.depth > 0.0) & (samples.depth <= 0.24 + 1e-12))


def test_more_tets_need_smaller_elements(samples):
    counts = [predicted_tets(choose_sizes(samples, target=n), samples) for n in (20_000, 100_000)]
    # Bisection in the scale ends within 0.05 %; a cube amplifies it to 0.2 %.
    np.testing.assert_allclose(counts, [2e4, 1e5], rtol=5e-3)


def test_elements_across_bound_the_size(samples):
    field = choose_sizes(samples, target=20_000, elements_across=8)
    assert np.all(size_at(field, samples.points) <= 1.0001 * 2.0 * samples.radius / 8)


def test_layers_bound_the_size_by_the_thickness(samples):
    field = choose_sizes(samples, target=20_000, wall_layers=4)
    assert np.all(size_at(field, samples.points) <= 1.3 * samples.depth / 4 * 1.3)
