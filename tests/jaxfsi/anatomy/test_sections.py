import numpy as np
import pytest

from jaxfsi.anatomy import (
    centerline_point,
    lumen_outline,
    measured_section,
    paediatric_anatomy,
    surface_section,
    synthetic_anatomy,
)

Z = np.array([0.0, 0.0, 1.0])
PERIMETER = 1.336489322055496  # of the ellipse with half axes 0.3 and 0.1 (elliptic integral)


def lumen_section(lumen, centre, normal, **how):
    return measured_section(lumen_outline(lumen, centre, normal, **how))


def _elliptic_cylinder(points: np.ndarray) -> np.ndarray:
    return np.hypot(points[:, 0] / 0.3, points[:, 1] / 0.1) - 1.0


def test_size_of_an_ellipse_converges_with_second_order() -> None:
    errors = []
    for n in (41, 81, 161):
        found = lumen_section(_elliptic_cylinder, np.zeros(3), Z, half_width=0.5, n_points=n)
        errors.append([abs(found.area / (np.pi * 0.03) - 1.0), abs(found.perimeter - PERIMETER)])
    # Piecewise linear zero line: second order, observed 1.9 or more over two halvings.
    assert np.all(np.log2(np.array(errors[0]) / np.array(errors[2])) > 3.4)
    assert errors[2][0] < 2e-3


def test_calipers_of_an_ellipse() -> None:
    found = lumen_section(_elliptic_cylinder, np.zeros(3), Z, half_width=0.5)
    assert found.major == pytest.approx(0.6, rel=2e-3)  # grid points 0.006 apart, second order
    assert found.minor == pytest.approx(0.2, rel=5e-3)


def test_an_oblique_cut_is_longer() -> None:
    normal = np.array([np.sin(0.8), 0.0, np.cos(0.8)])
    found = lumen_section(_elliptic_cylinder, np.zeros(3), normal, half_width=0.6)
    assert found.area == pytest.approx(np.pi * 0.03 / np.cos(0.8), rel=3e-3)


def test_only_the_part_round_the_centre_counts() -> None:
    def two(points: np.ndarray) -> np.ndarray:
        other = np.linalg.norm(points[:, :2] - np.array([0.0, 0.35]), axis=1) / 0.2 - 1.0
        return np.minimum(_elliptic_cylinder(points), other)

    found = lumen_section(two, np.zeros(3), Z, half_width=0.7)
    alone = lumen_section(_elliptic_cylinder, np.zeros(3), Z, half_width=0.7)
    assert found == alone


def test_centre_and_width_are_checked() -> None:
    with pytest.raises(ValueError, match="outside the lumen"):
        lumen_section(_elliptic_cylinder, np.array([0.0, 0.3, 0.0]), Z, half_width=0.5)
    with pytest.raises(ValueError, match="Enlarge half_width"):
        lumen_section(_elliptic_cylinder, np.zeros(3), Z, half_width=0.2)


def _cylinder(n: int, radius: float, centre: float) -> tuple[np.ndarray, np.ndarray]:
    angle = 2.0 * np.pi * np.arange(n) / n
    ring = np.stack([centre + radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    points = np.concatenate([np.c_[ring, np.full(n, -1.0)], np.c_[ring, np.full(n, 1.0)]])
    i, j = np.arange(n), (np.arange(n) + 1) % n
    return points, np.concatenate([np.stack([i, j, j + n], 1), np.stack([i, j + n, i + n], 1)])


def test_section_of_a_triangulated_prism_is_its_polygon() -> None:
    n = 12
    points, triangles = _cylinder(n, 0.3, 0.0)
    other, more = _cylinder(n, 0.3, 1.0)
    both, faces = np.concatenate([points, other]), np.concatenate([triangles, more + len(points)])
    found = surface_section(both, faces, np.array([0.05, 0.0, 0.1]), Z)
    assert found.area == pytest.approx(n / 2 * 0.09 * np.sin(2 * np.pi / n), rel=1e-12)
    assert found.perimeter == pytest.approx(2 * n * 0.3 * np.sin(np.pi / n), rel=1e-12)
    assert found.major == pytest.approx(0.6, rel=1e-4)  # directions 0.25 degrees apart


def test_a_plane_that_misses_is_refused() -> None:
    points, triangles = _cylinder(12, 0.3, 0.0)
    with pytest.raises(ValueError, match="misses the surface"):
        surface_section(points, triangles, np.array([0.0, 0.0, 2.0]), Z)
    with pytest.raises(ValueError, match="Give a point inside"):
        surface_section(points, triangles, np.array([0.9, 0.0, 0.0]), Z)


def test_sections_of_the_synthetic_arteries_are_those_asked_for() -> None:
    p = paediatric_anatomy()
    anatomy = synthetic_anatomy(p)
    middle = 0.8 * p.intramural_length
    distal = p.intramural_length + 1.0
    slit, reference = (
        lumen_section(
            anatomy.lumen,
            *centerline_point(anatomy.centerlines["anomalous"], s),
            half_width=0.35,
        )
        for s in (middle, distal)
    )
    # Second-order zero line at 0.0044 cm on half axes of 0.07 cm and more: (h/b)²/2 = 0.2 %.
    assert slit.area == pytest.approx(p.intramural_area, rel=5e-3)
    assert slit.major / slit.minor == pytest.approx(p.ellipticity, rel=1e-2)
    assert reference.area == pytest.approx(p.reference_area, rel=5e-3)
