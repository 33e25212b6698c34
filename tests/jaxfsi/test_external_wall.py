"""The wall between contours of the lumen and of the external membrane."""

import pathlib

import numpy as np
import pytest

from jaxfsi.anatomy import ivus_anatomy
from jaxfsi.anatomy.sources.external_wall import outline_distances, read_external_wall
from jaxfsi.contours import read_frames
from jaxfsi.polygons import polygon_areas
from study import read_case
from study.case.demo import demo_case_path
from study.run.anatomy_source import case_anatomy
from study.store.case_inputs import input_files
from study.store.meshes import mesh_key

BUNDLED = demo_case_path().parent
T = 2.0 * np.pi * np.arange(200) / 200
CIRCLE = np.stack([np.cos(T), np.sin(T)], axis=1)


def write(path: pathlib.Path, frames: dict[int, tuple[float, np.ndarray]]) -> pathlib.Path:
    lines = [
        f"{number}\t{x:.9f}\t{y:.9f}\t{z:.4f}"
        for number, (z, points) in frames.items()
        for x, y in points
    ]
    path.write_text("\n".join(lines) + "\n")
    return path


def circles(radius, shift=0.0, numbers=range(6)):
    """Frames a millimetre apart; radius [mm] may be a function of the frame."""
    return {
        n: (float(n), (radius(n) if callable(radius) else radius) * CIRCLE + [shift, 0.0])
        for n in numbers
    }


def test_wall_between_circles_is_the_difference_of_their_radii(tmp_path):
    lumen = write(tmp_path / "l.csv", circles(1.5))
    membrane = write(tmp_path / "m.csv", circles(lambda n: 1.8 + 0.1 * n))
    found = read_external_wall(lumen, membrane, np.arange(6)[::-1])
    # a polygon of 200 corners lies 0.1 micron within its circle at most
    np.testing.assert_allclose(found.mean, 0.03 + 0.01 * np.arange(6)[::-1], atol=5e-5)
    np.testing.assert_allclose(found.least, found.greatest, atol=5e-5)


def test_eccentric_wall_is_thin_on_one_side(tmp_path):
    lumen = write(tmp_path / "l.csv", circles(1.5, shift=0.4))
    membrane = write(tmp_path / "m.csv", circles(2.1))
    found = read_external_wall(lumen, membrane, np.arange(6))
    np.testing.assert_allclose(found.least, 0.02, atol=5e-5)
    np.testing.assert_allclose(found.greatest, 0.10, atol=5e-5)
    # the mean of 2.1 − |0.4 + 1.5 exp(iφ)| over the lumen's outline
    exact = 2.1 - np.hypot(0.4 + 1.5 * CIRCLE[:, 0], 1.5 * CIRCLE[:, 1]).mean()
    np.testing.assert_allclose(found.mean, 0.1 * exact, atol=5e-5)


def test_points_outside_a_polygon_are_at_a_negative_distance():
    square = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
    points = np.array([[1.0, 1.0], [0.5, 1.0], [3.0, 1.0], [-3.0, -4.0]])
    np.testing.assert_allclose(outline_distances(points, square), [1.0, 0.5, -1.0, -5.0])


def test_frames_without_a_membrane_take_the_thickness_of_their_neighbours(tmp_path):
    lumen = write(tmp_path / "l.csv", circles(1.5))
    membrane = write(tmp_path / "m.csv", circles(lambda n: 1.8 + 0.1 * n, numbers=(1, 3, 4)))
    found = read_external_wall(lumen, membrane, np.arange(6))
    np.testing.assert_array_equal(np.isnan(found.mean), [True, False, True, False, False, True])
    s = 0.1 * np.arange(6)
    expected = 0.03 + 0.01 * np.array([1.0, 1.0, 2.0, 3.0, 4.0, 4.0])
    np.testing.assert_allclose(found.along(s, s), expected, atol=5e-5)


def test_membranes_that_are_none_of_this_pullback_are_refused(tmp_path):
    lumen = write(tmp_path / "l.csv", circles(1.5))
    small = write(tmp_path / "small.csv", circles(1.2))
    with pytest.raises(ValueError, match=r"small.csv: in frame 0 100% of the lumen lies outside"):
        read_external_wall(lumen, small, np.arange(6))
    with pytest.raises(ValueError, match=r"l.csv: the membrane lies on the lumen in every frame"):
        read_external_wall(lumen, lumen, np.arange(6))
    other = write(tmp_path / "other.csv", circles(1.8, numbers=range(90, 95)))
    with pytest.raises(ValueError, match=r"0 frames of the lumen have a membrane"):
        read_external_wall(lumen, other, np.arange(6))
    frames = {n: (z + 2.0, points) for n, (z, points) in circles(1.8).items()}
    with pytest.raises(ValueError, match=r"frame 0 lies at z = 2, that of the lumen at 0 mm"):
        read_external_wall(lumen, write(tmp_path / "z.csv", frames), np.arange(6))


# the other phase has the same vessel under another pressure
@pytest.mark.parametrize("phase", ["diastolic", pytest.param("systolic", marks=pytest.mark.slow)])
def test_wall_of_a_real_coronary(shared_data, phase):
    folder = shared_data / "ivus_eem"
    if not folder.is_dir():
        pytest.skip("pullback with external membranes (ivus_eem) is not here")
    lumen, membrane = folder / f"{phase}_contours.csv", folder / f"eem_{phase}_contours.csv"
    inner, outer = read_frames(lumen), read_frames(membrane)
    numbers = np.array(list(inner))
    found = read_external_wall(lumen, membrane, numbers)
    assert np.all(np.isfinite(found.mean))
    assert np.all(found.least > 0.0)  # every membrane surrounds its lumen
    for k, number in enumerate(numbers.tolist()):
        area = [float(polygon_areas(f[number].points_mm[None])[0]) for f in (inner, outer)]
        # an eccentric wall is thinner in the mean of distances than between equal circles
        radii = np.sqrt(np.array(area) / np.pi)
        assert 0.1 * (radii[1] - radii[0]) == pytest.approx(found.mean[k], abs=0.012)
        apart = np.linalg.norm(inner[number].points_mm[:, None] - outer[number].points_mm, axis=2)
        assert 0.1 * apart.min() == pytest.approx(found.least[k], abs=2e-3)
        assert 0.1 * apart.min(axis=1).max() == pytest.approx(found.greatest[k], abs=2e-3)
    # diseased: the wall grows from 0.1 mm to 0.8 mm within 2 cm
    assert found.mean.min() < 0.02
    assert found.mean.max() > 0.07


@pytest.fixture(scope="module")
def swollen(tmp_path_factory) -> pathlib.Path:
    """Membranes of the bundled patient: its contours, 0.3 mm wider along their radii."""
    frames = {}
    for number, frame in read_frames(BUNDLED / "rest_diastole_contours.csv").items():
        way = frame.points_mm - frame.points_mm.mean(axis=0)
        wider = frame.points_mm + 0.3 * way / np.linalg.norm(way, axis=1, keepdims=True)
        frames[number] = (frame.z_mm, wider)
    return write(tmp_path_factory.mktemp("membranes") / "eem.csv", frames)


def test_anatomy_has_the_measured_wall(swollen):
    given = {
        "frame_table": BUNDLED / "rest_frames.csv",
        "reference": BUNDLED / "rest_diastole_reference.csv",
        "aorta_radius": 1.4,
    }
    files = BUNDLED / "rest_diastole_contours.csv", BUNDLED / "centerline.csv"
    anatomy = ivus_anatomy(*files, external=swollen, **given)
    usual = ivus_anatomy(*files, **given)
    mean = np.array(anatomy.meta["wall_mean"])
    assert np.all((mean > 0.018) & (mean < 0.031))
    line = anatomy.centerlines["anomalous"]
    beyond = line.points[(line.s > 1.6) & (line.s < 2.2)]  # away from the aorta
    np.testing.assert_allclose(anatomy.thickness(beyond), mean[-1], atol=0.006)
    assert np.all(usual.thickness(beyond) > 0.045)  # a tenth of the radius, at least 0.5 mm
    assert "wall_mean" not in usual.meta


def test_case_names_the_membranes(swollen, tmp_path):
    text = demo_case_path().read_text()
    for name in BUNDLED.glob("*.csv"):
        text = text.replace(f'"{name.name}"', f'"{name}"')
    path = tmp_path / "case.toml"
    path.write_text(text)
    plain = read_case(path)
    key = f'centerline = "{BUNDLED / "centerline.csv"}"'
    path.write_text(text.replace(key, f'{key}\nexternal_contours = "{swollen}"', 1))
    case = read_case(path)
    assert swollen in input_files(case)
    assert mesh_key(case, "rest_diastole") != mesh_key(plain, "rest_diastole")
    assert "wall_mean" in case_anatomy(case).meta
