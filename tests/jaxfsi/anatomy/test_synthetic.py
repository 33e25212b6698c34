import dataclasses
import math
import pickle

import numpy as np
import pytest

from jaxfsi.anatomy import (
    Anatomy,
    PointFunction,
    SyntheticParameters,
    adult_anatomy,
    paediatric_anatomy,
    parameter_faults,
    scaled_anatomy,
    surface_points,
    synthetic_anatomy,
    synthetic_vessels,
    tube_foot,
)
from jaxfsi.anatomy.sources.parameters import approach, shortest_intramural_length
from tests.jaxfsi.anatomy.sampling import grid_values

# take-off [deg], length [cm], ellipticity, hypoplasia, septum [cm], reference radius [cm]
CORNERS = [
    (18.0, 0.67, 1.0, 0.45, 0.035, 0.20),
    (18.0, 0.65, 2.8, 1.0, 0.09, 0.12),
    (18.0, 1.6, 1.0, 1.0, 0.035, 0.20),
    (18.0, 1.6, 4.0, 0.45, 0.09, 0.20),
    (18.0, 0.4, 2.8, 0.45, 0.035, 0.12),
    (75.0, 0.4, 4.0, 1.0, 0.035, 0.12),
    (75.0, 0.54, 1.0, 1.0, 0.035, 0.20),
    (75.0, 1.6, 2.8, 0.45, 0.09, 0.12),
]


def _corner(values: tuple[float, ...], side: str) -> SyntheticParameters:
    take_off, length, ellipticity, hypoplasia, septum, radius = values
    p = dataclasses.replace(
        adult_anatomy("left" if side == "left" else "right"),
        take_off_angle=math.radians(take_off),
        intramural_length=length,
        ellipticity=ellipticity,
        hypoplasia=hypoplasia,
        septum=septum,
        reference_radius=radius,
    )
    major, minor = p.intramural_half_axes
    return dataclasses.replace(p, ostium_major=2.1 * major, ostium_minor=2.0 * minor)


def _euler_number(function: PointFunction, box: np.ndarray, spacing: float) -> int:
    measure = pytest.importorskip("skimage.measure")
    closed = np.pad(grid_values(function, box, spacing), 1, constant_values=1.0)
    _, faces, _, _ = measure.marching_cubes(closed, 0.0)
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return len(np.unique(faces)) - len(np.unique(edges, axis=0)) + len(faces)


def _box(anatomy: Anatomy, length: float) -> np.ndarray:
    line = anatomy.centerlines["anomalous"]
    near = line.points[line.s < length]
    return np.stack([near.min(axis=0) - 0.35, near.max(axis=0) + 0.35])


@pytest.mark.parametrize("number", range(len(CORNERS)))
def test_lumen_and_wall_of_corner_anatomies_have_no_handles(number: int) -> None:
    p = _corner(CORNERS[number], "left" if number % 2 else "right")
    anatomy = synthetic_anatomy(p)
    box = _box(anatomy, p.intramural_length + 0.6)
    # The part of a ball-like lumen in a box is again a ball; steps of half its thinnest parts.
    spacing = 0.49 * min(p.septum, p.intramural_half_axes[1])
    assert _euler_number(anatomy.lumen, box, spacing) == 2
    assert _euler_number(anatomy.wall, box, 0.03) == 2


@pytest.mark.parametrize(
    "side",
    # left and right are mirror images: a test of their own says so
    ["left", pytest.param("right", marks=pytest.mark.slow)],
)
def test_whole_lumen_and_wall_are_balls(side: str) -> None:
    anatomy = synthetic_anatomy(paediatric_anatomy("left" if side == "left" else "right"))
    assert _euler_number(anatomy.lumen, anatomy.bounds, 0.03) == 2
    assert _euler_number(anatomy.wall, anatomy.bounds, 0.04) == 2


@pytest.mark.parametrize("number", range(len(CORNERS)))
def test_least_septum_is_the_one_asked_for(number: int) -> None:
    p = _corner(CORNERS[number], "right")
    lumen = synthetic_anatomy(p).lumen
    aorta, anomalous, _ = synthetic_vessels(p)[0]
    # From where the axis runs parallel to the wall, clear of the rounded tip of the septum.
    first = approach(p).s_parallel + 0.5 * p.septum
    theta, s = np.meshgrid(
        2.0 * np.pi * np.arange(60) / 60, np.linspace(first, p.intramural_length, 30)
    )
    points, _ = surface_points(anomalous.tube, s.ravel(), theta.ravel())
    foot = tube_foot(aorta.tube, points)
    facing = foot.distance < 1.5 * p.septum
    _, outward = surface_points(aorta.tube, foot.s[facing], foot.angle[facing])
    # Length of solid on the line from inside the artery to inside the aorta, by the lumen alone.
    step = 0.02 * p.septum
    depth = np.arange(-0.3 * p.septum, 2.0 * p.septum, step)
    lines = points[facing][:, None] - depth[:, None] * outward[:, None]
    inside = lumen(lines.reshape(-1, 3)).reshape(len(outward), -1) < 0.0
    septum = step * np.sum(~inside, axis=1).min()
    # The contour is sampled every 6 degrees and the line every 2 %.
    assert septum == pytest.approx(p.septum, rel=0.1)


def _thickness(anatomy: Anatomy, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Distance along the normals from the lumen to the outer surface of the wall."""
    low, high = np.zeros(len(points)), np.full(len(points), 0.4)
    for _ in range(30):
        middle = (low + high) / 2.0
        inside = anatomy.wall(points + middle[:, None] * normals) < 0.0
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return low


@pytest.mark.parametrize("p", [adult_anatomy("left"), paediatric_anatomy("right", 0.9)])
def test_wall_is_as_thick_as_asked_away_from_junctions(p: SyntheticParameters) -> None:
    anatomy = synthetic_anatomy(p)
    aorta, anomalous, normal = synthetic_vessels(p)[0]
    theta = 2.0 * np.pi * np.arange(24) / 24
    lengths = {
        "aorta": (aorta, np.linspace(0.6, 0.95, 8) * p.aorta_length, theta),
        "distal": (anomalous, p.intramural_length + np.linspace(0.9, 1.1, 5), theta),
        "normal": (normal, np.linspace(0.6, 0.9, 5) * p.normal_length, theta),
        # On the outer side of the intramural lumen (the binormal points outwards or inwards).
        "slit": (anomalous, np.linspace(0.6, 0.9, 8) * p.intramural_length, theta[[6, 18]]),
    }
    for name, (vessel, s, angles) in lengths.items():
        place, angle = (x.ravel() for x in np.meshgrid(s, angles, indexing="ij"))
        points, normals = surface_points(vessel.tube, place, angle)
        if name == "slit":
            outer = anatomy.lumen(points + 0.9 * p.septum * normals) > 0.6 * p.septum
            points, normals = points[outer], normals[outer]
        if name == "aorta":  # keep clear of the two arteries
            clear = (
                np.min([v.tube.tree.query(points)[0] for v in (anomalous, normal)], axis=0) > 0.4
            )
            points, normals = points[clear], normals[clear]
        assert len(points) > 7
        ratio = _thickness(anatomy, points, normals) / anatomy.thickness(points)
        np.testing.assert_allclose(ratio, 1.0, atol=0.1, err_msg=name)


@pytest.mark.parametrize("p", [adult_anatomy("left"), paediatric_anatomy("right", 0.8)])
def test_openings_lie_inside_the_lumen_and_cut_one_vessel_each(p: SyntheticParameters) -> None:
    anatomy = synthetic_anatomy(p)
    vessels = synthetic_vessels(p)[0]
    owners = {"aorta_inlet": 0, "aorta_outlet": 0, "anomalous_outlet": 1, "normal_outlet": 2}
    assert [opening.name for opening in anatomy.openings] == list(owners)
    for opening in anatomy.openings:
        beyond = opening.centre + 0.02 * opening.normal  # the vessel runs on
        assert np.all(anatomy.lumen(np.stack([opening.centre, beyond])) < 0.0)
        assert np.linalg.norm(opening.normal) == pytest.approx(1.0)
        for number, vessel in enumerate(vessels):
            offset = np.asarray(vessel.tube.tree.data) - opening.centre
            distance, height = np.linalg.norm(offset, axis=1), offset @ opening.normal
            reach = distance - vessel.thickness.max()
            if number == owners[opening.name]:  # the ball holds all that the plane cuts off
                assert distance[height > 0.0].max() < opening.radius
                assert np.all(distance[np.abs(height) < 0.05] < opening.radius)
            else:
                assert reach.min() > opening.radius


def test_bounds_hold_the_wall() -> None:
    anatomy = synthetic_anatomy(paediatric_anatomy("right"))
    for axis in range(3):
        for end in (0, 1):
            face = anatomy.bounds.copy()
            face[:, axis] = anatomy.bounds[end, axis]
            assert np.all(grid_values(anatomy.wall, face, 0.05) > 0.0)


def test_local_radius_is_half_the_width_of_the_nearest_lumen() -> None:
    p = adult_anatomy("right")
    anatomy = synthetic_anatomy(p)
    line = anatomy.centerlines["anomalous"]
    slit = line.points[np.searchsorted(line.s, 0.8 * p.intramural_length)]
    assert anatomy.local_radius(slit[None])[0] == pytest.approx(p.intramural_half_axes[1], rel=0.05)
    assert anatomy.local_radius(line.points[-1:])[0] == pytest.approx(p.reference_radius, rel=0.01)
    assert anatomy.local_radius(np.array([[0.0, 0.0, 0.5]]))[0] > 1.0


def test_left_and_right_are_mirror_images() -> None:
    right, left = (synthetic_anatomy(adult_anatomy(side)) for side in ("right", "left"))
    points = np.random.default_rng(0).uniform(*right.bounds, (2000, 3))
    mirrored = points * np.array([1.0, -1.0, 1.0])
    # Equal but for the order in which the contours are tabulated and rounded.
    np.testing.assert_allclose(right.lumen(points), left.lumen(mirrored), atol=1e-5)


def test_anatomies_can_be_sent_to_another_process() -> None:
    anatomy = synthetic_anatomy(adult_anatomy())
    copy = pickle.loads(pickle.dumps(anatomy))
    points = np.random.default_rng(0).uniform(*anatomy.bounds, (50, 3))
    np.testing.assert_array_equal(copy.wall(points), anatomy.wall(points))


def test_children_are_smaller() -> None:
    adult, child = adult_anatomy(), paediatric_anatomy(body_surface_area_m2=0.8)
    assert child.tube_radius == pytest.approx(adult.tube_radius * math.sqrt(0.8 / 1.9))
    assert child.reference_radius < 0.7 * adult.reference_radius
    assert child.thickness_minimum / child.reference_radius > 0.05 / 0.19
    same = dataclasses.asdict(scaled_anatomy(adult, 1.9))
    assert same == pytest.approx(dataclasses.asdict(adult))
    with pytest.raises(ValueError, match="Give it in m²"):
        scaled_anatomy(adult, 19.0)


@pytest.mark.parametrize(
    ("changes", "named", "cure"),
    [
        ({"septum": 0.005}, "septum", "0.025"),
        ({"thickness_minimum": 0.09, "normal_radius": 0.08}, "thickness_minimum", "thin the wall"),
        ({"thickness_maximum": 0.045}, "thickness_minimum", "exchange"),
        ({"ostium_height": 4.4}, "ostium_height", "never touch the aorta"),
        ({"intramural_length": 0.3}, "intramural_length", "stay fused"),
        ({"ostium_minor": 0.48}, "ostium_major", "exchange"),
        ({"take_off_angle": 25.0}, "take_off_angle", "angles in rad"),
        ({"reference_radius": 1.9}, "reference_radius", "lengths are in cm"),
        ({"junction_height": 0.8}, "junction_height", "order the heights"),
        ({"junction_radius": 0.4}, "ellipticity", "too wide for this aorta"),
        ({"septum": math.nan}, "septum", "bring it into this range"),
    ],
)
def test_each_fault_is_named_with_its_cure(
    changes: dict[str, float], named: str, cure: str
) -> None:
    p = dataclasses.replace(adult_anatomy(), **changes)
    with pytest.raises(ValueError, match="describe no anatomy") as caught:
        synthetic_anatomy(p)
    faults = {fault.name: str(fault) for fault in parameter_faults(p)}
    assert named in faults
    assert cure in faults[named]
    assert faults[named] in str(caught.value)


def test_all_faults_are_listed_at_once() -> None:
    p = dataclasses.replace(adult_anatomy(), septum=-1.0, ellipticity=9.0, normal_length=90.0)
    assert [f.name for f in parameter_faults(p)] == ["septum", "ellipticity", "normal_length"]


def test_colliding_arteries_are_refused() -> None:
    p = dataclasses.replace(adult_anatomy(), normal_angle=0.6, ostium_angle=0.6, normal_height=1.9)
    with pytest.raises(ValueError, match="raise normal_angle"):
        synthetic_anatomy(p)


def test_the_shortest_course_is_just_long_enough() -> None:
    p = adult_anatomy()
    shortest = shortest_intramural_length(p)
    assert not parameter_faults(dataclasses.replace(p, intramural_length=1.001 * shortest))
    assert parameter_faults(dataclasses.replace(p, intramural_length=0.999 * shortest))
