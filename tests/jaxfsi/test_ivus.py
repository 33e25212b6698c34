import functools
import pathlib

import numpy as np
import pytest
import skimage.measure

from jaxfsi.anatomy import (
    Anatomy,
    IvusOptions,
    at_arc_length,
    eccentric_sections,
    fit_aorta,
    ivus_anatomy,
    lofted,
    read_centerline,
    read_pullback,
)
from jaxfsi.polygons import polygon_areas
from study import demo_case_path

BUNDLED = demo_case_path().parent
CONTOURS = BUNDLED / "rest_diastole_contours.csv"
FRAME_TABLE = BUNDLED / "rest_frames.csv"
REFERENCE = BUNDLED / "rest_diastole_reference.csv"
STATES = [(drug, phase) for drug in ("rest", "stress") for phase in ("diastolic", "systolic")]
STEP = 0.01
HALF = 0.36


@pytest.fixture(scope="module")
def folder(shared_data: pathlib.Path) -> pathlib.Path:
    return shared_data / "ivus_aaoca"


@functools.cache
def patient(folder: pathlib.Path, drug: str, phase: str) -> Anatomy:
    pullback = folder / f"ivus_{drug}"
    return ivus_anatomy(
        pullback / f"{phase}_contours.csv",
        folder / "centerline_raw.csv",
        frame_table=pullback / "combined_sorted_manual.csv",
        reference=pullback / f"{phase}_reference_points.csv",
        state=f"{drug} {phase}",
    )


def bundled(**changes: object) -> Anatomy:
    given = {"frame_table": BUNDLED / "rest_frames.csv"} | changes
    return ivus_anatomy(BUNDLED / "rest_diastole_contours.csv", BUNDLED / "centerline.csv", **given)


def coronary_axis(anatomy: Anatomy):
    return anatomy.lumen.args[0][1].tube.axis


def lumen_sections(anatomy: Anatomy) -> tuple[np.ndarray, np.ndarray]:
    """Area [cm²] of the lumen in the plane of each frame, and its distance from the aorta."""
    position, _, normal, binormal = at_arc_length(
        coronary_axis(anatomy), np.array(anatomy.meta["s_frames"])
    )
    grid = np.arange(-HALF, HALF, STEP)
    u, v = (x.ravel() for x in np.meshgrid(grid, grid, indexing="ij"))
    areas, gaps = [], []
    for p, n, b in zip(position, normal, binormal, strict=True):
        value = anatomy.lumen(p + u[:, None] * n + v[:, None] * b).reshape(len(grid), -1)
        middle = [[HALF / STEP, HALF / STEP]]
        (loop,) = [
            loop
            for loop in skimage.measure.find_contours(value, 0.0)
            if skimage.measure.points_in_poly(middle, loop)[0]
        ]
        np.testing.assert_array_equal(loop[0], loop[-1])  # closed: does not merge with the aorta
        offset = loop[:-1] * STEP - HALF
        areas.append(abs(polygon_areas(offset[None])[0]))
        points = p + offset[:, :1] * n + offset[:, 1:] * b
        gaps.append(np.min(np.hypot(points[:, 0], points[:, 1])) - anatomy.meta["aorta_radius"])
    return np.array(areas), np.array(gaps)


@pytest.mark.parametrize(
    ("drug", "phase"),
    [
        ("rest", "diastolic"),
        # these two have the least and the greatest resistance (test_reduced_law.py)
        pytest.param("rest", "systolic", marks=pytest.mark.slow),
        pytest.param("stress", "diastolic", marks=pytest.mark.slow),
        ("stress", "systolic"),
    ],
)
def test_lumen_areas_and_septum_are_the_measured_ones(folder, drug, phase):
    anatomy = patient(folder, drug, phase)
    areas, gaps = lumen_sections(anatomy)
    # No frame is left out. Loft 0.2 % (bicubic surface through monotone cubics), marching squares
    # at 0.1 mm 0.6 %; one end frame, where the take-off begins, is up to 0.8 % off.
    np.testing.assert_allclose(areas, anatomy.meta["area_frames"], rtol=0.015)
    s = np.array(anatomy.meta["s_frames"])
    measured = np.isin(s, anatomy.meta["septum_s"])
    # 0.02 mm: the error of a marching-squares contour of curvature 1/0.5 mm at 0.1 mm.
    np.testing.assert_allclose(gaps[measured], anatomy.meta["septum"], atol=2e-3)


def test_all_states_share_the_aorta_and_the_ostium_end(folder):
    anatomies = [patient(folder, drug, phase) for drug, phase in STATES]
    for anatomy in anatomies:
        assert anatomy.meta["ostium_is_first_point"]
        # The centre line of this patient lies on a 1.4 cm aorta within 0.1 mm over 15 mm.
        assert anatomy.meta["centerline_residual"] < 0.01
    axes = np.array([anatomy.meta["aortic_axes_in_ct"] for anatomy in anatomies])
    # The states differ in septum and slit by 0.1 mm, which turns the fitted axis by < 1°.
    assert np.max(np.linalg.norm(axes - axes[0], axis=2)) < np.radians(1.0)


def test_slits_lie_on_the_aortic_wall_on_the_side_of_the_reference(folder):
    pullback = read_pullback(
        folder / "ivus_stress" / "systolic_contours.csv",
        frame_table=folder / "ivus_stress" / "combined_sorted_manual.csv",
        reference=folder / "ivus_stress" / "systolic_reference_points.csv",
    )
    assert pullback.side_known
    extents = np.ptp(pullback.sections[:8], axis=1)
    # Slits of ellipticity 4 to 5: the long side runs along v, the wall.
    assert np.all(extents[:, 1] > 3.3 * extents[:, 0])
    assert np.all(polygon_areas(pullback.sections) > 0.0)


def test_openings_hold_their_own_vessel_only():
    anatomy = bundled()
    names = [opening.name for opening in anatomy.openings]
    assert names == ["aorta_inlet", "aorta_outlet", "anomalous_outlet"]
    centres = np.stack([opening.centre for opening in anatomy.openings])
    assert np.all(anatomy.lumen(centres) < 0.0)
    assert np.all((centres > anatomy.bounds[0]) & (centres < anatomy.bounds[1]))
    rng = np.random.default_rng(0)
    for opening in anatomy.openings:
        direction = rng.normal(size=(2000, 3))
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        across = direction - (direction @ opening.normal)[:, None] * opening.normal
        across /= np.linalg.norm(across, axis=1)[:, None]
        # The rim of the disc lies outside the wall all round: the plane cuts the vessel through.
        assert np.all(anatomy.wall(opening.centre + opening.radius * across) > 0.0)
    outlet = anatomy.openings[2]
    shell = outlet.centre + outlet.radius * direction
    outside_aorta = np.hypot(shell[:, 0], shell[:, 1]) - 1.4
    assert np.min(outside_aorta) > anatomy.thickness(np.array([[1.4, 0.0, 1.5]]))[0]


def test_lumen_is_one_piece_and_the_septum_is_whole():
    anatomy = bundled()
    step = 0.06
    axes = [np.arange(low, high, step) for low, high in anatomy.bounds.T]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    value = anatomy.lumen(x.reshape(-1, 3)).reshape(x.shape[:3])
    inside = np.pad(value < 0.0, 1)
    # The lumen of two vessels joined once is a ball: one piece, Euler characteristic one.
    assert skimage.measure.euler_number(inside, connectivity=1) == 1
    assert np.max(skimage.measure.label(inside, connectivity=1)) == 1


def test_given_septum_replaces_the_measured_one():
    anatomy = bundled(septum=0.12, aorta_radius=1.3)
    np.testing.assert_array_equal(anatomy.meta["septum"], 0.12)
    _, gaps = lumen_sections(anatomy)
    np.testing.assert_allclose(gaps[: len(anatomy.meta["septum"])], 0.12, atol=2e-3)


def test_wall_is_thick_on_the_aorta_and_thin_on_the_coronary():
    anatomy = bundled(options=IvusOptions(thickness_minimum=0.04, thickness_maximum=0.16))
    aorta = np.array([[-1.4, 0.0, 0.5]])
    outlet = anatomy.openings[2]
    # Factor 0.1 of 1.4 cm; clip(0.1 x 0.25, 0.04, ...). Corners of the clip are rounded by 1/16 of
    # the span of the limits.
    assert abs(anatomy.thickness(aorta)[0] - 0.14) < 0.12 / 16.0
    assert abs(anatomy.thickness(outlet.centre[None])[0] - 0.04) < 0.12 / 16.0
    np.testing.assert_allclose(anatomy.wall(aorta), -anatomy.thickness(aorta), atol=1e-6)


def test_loft_passes_through_every_section_and_between_them():
    t = 2.0 * np.pi * np.arange(200) / 200
    slit = np.stack([0.06 * np.cos(t), 0.28 * np.sin(t)], axis=1)
    disc = 0.25 * np.stack([np.cos(t), np.sin(t)], axis=1)
    frames = eccentric_sections(np.stack([slit, disc]), 96)
    # A polygon of n points inscribed in an ellipse is 2π²/3n² too small: 0.07 % at n = 96.
    np.testing.assert_allclose(
        polygon_areas(frames), np.pi * np.array([0.06 * 0.28, 0.25**2]), rtol=1e-3
    )
    s = np.linspace(0.0, 0.3, 7)
    areas = polygon_areas(lofted(np.array([0.0, 0.3]), frames, s))
    np.testing.assert_allclose(areas[[0, -1]], polygon_areas(frames), rtol=1e-12)
    assert np.all(np.diff(areas) > 0.0)


def test_folded_section_is_refused():
    t = 2.0 * np.pi * np.arange(100) / 100
    radius = np.where(np.abs(t - 3.0) < 0.2, 0.05, 0.2)
    angle = t + 0.6 * np.exp(-(((t - 3.0) / 0.3) ** 2)) * np.sin(12.0 * t)
    folded = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    with pytest.raises(ValueError, match=r"folds back.*Redraw"):
        eccentric_sections(folded[None], 96)


def test_ostium_end_can_be_said_and_a_foreign_aorta_is_refused():
    line = read_centerline(BUNDLED / "centerline.csv")
    assert fit_aorta(line, 1.4, offset=0.16).from_first
    assert fit_aorta(line[::-1], 1.4, offset=0.16).from_first is False
    turn = np.linspace(0.0, 20.0, 300)
    coil = np.stack([0.5 * np.cos(turn), 0.5 * np.sin(turn), -0.3 * turn], axis=1)
    with pytest.raises(ValueError, match=r"does not run beside an aorta.*Check"):
        fit_aorta(coil, 1.4, offset=0.16, length=6.0)
    with pytest.raises(ValueError, match=r"aortic radius of 14 cm.*cm"):
        bundled(aorta_radius=14.0)


def test_centre_line_in_the_wrong_unit_is_refused(tmp_path):
    text = (BUNDLED / "centerline.csv").read_text(encoding="utf-8-sig")
    rows = [[float(x) for x in line.split(",")] for line in text.splitlines()]
    path = tmp_path / "c.csv"
    path.write_text("\n".join(",".join(str(0.1 * x) for x in row) for row in rows))
    with pytest.raises(ValueError, match=r"length.*in mm"):
        read_centerline(path)
    path.write_text("1,2\n")
    with pytest.raises(ValueError, match=r"line 1.*three finite numbers.*Expected"):
        read_centerline(path)
    path.write_text("")
    with pytest.raises(ValueError, match=r"0 points"):
        read_centerline(path)


def test_wall_thicker_than_the_radius_is_refused():
    options = IvusOptions(thickness_minimum=0.3, thickness_maximum=0.4)
    with pytest.raises(ValueError, match=r"thicker than the vessel's radius.*Lower"):
        bundled(options=options)


def test_unknown_septum_is_refused():
    with pytest.raises(ValueError, match=r"no tissue thickness.*frame table"):
        bundled(frame_table=None)
    with pytest.raises(ValueError, match=r"not between 0 and 1 cm"):
        bundled(septum=9.6)
    anatomy = bundled(frame_table=None, septum=0.1)
    assert anatomy.meta["aortic_side_known"] is False


def _copy(tmp_path, name, change):
    """A file of the bundled patient with its rows changed."""
    lines = (BUNDLED / name).read_text(encoding="utf-8-sig").splitlines()
    path = tmp_path / name
    path.write_text("\n".join(change(lines)) + "\n")
    return path


def _columns_scaled(columns, factor):
    def change(lines):
        header = lines[0].split(",")
        places = [header.index(column) for column in columns]
        rows = [line.split(",") for line in lines[1:]]
        for row in rows:
            for place in places:
                if row[place]:
                    row[place] = f"{float(row[place]) * factor:g}"
        return [lines[0], *(",".join(row) for row in rows)]

    return change


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        (("position", "measurement_1"), r"measurement_1 is .* Is it in cm\?"),
        (("position",), r"positions span .* Is the table in cm\?"),
        (("measurement_1",), r"measurement_1 is .* Is it in cm\?"),
    ],
)
def test_frame_table_in_cm_is_asked_about(columns, words, tmp_path):
    table = _copy(tmp_path, FRAME_TABLE.name, _columns_scaled(columns, 0.1))
    with pytest.raises(ValueError, match=f"^{table}: .*{words}"):
        read_pullback(CONTOURS, frame_table=table, reference=REFERENCE)


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        (1, "nan", "not four finite numbers"),
        (2, "1e300", "from the middle of frame"),
        (3, "inf", "not four finite numbers"),
        (1, "300", "from the middle of frame"),
        (3, "2.45", r"along the pullback.*Is it in cm\?"),
    ],
)
def test_reference_point_elsewhere_is_refused(place, value, words, tmp_path):
    def change(lines):
        fields = lines[0].split("\t")
        fields[place] = value
        return ["\t".join(fields)]

    point = _copy(tmp_path, REFERENCE.name, change)
    with pytest.raises(ValueError, match=f"^{point}: .*{words}"):
        read_pullback(CONTOURS, frame_table=FRAME_TABLE, reference=point)


def test_contours_with_heights_in_cm_are_asked_about(tmp_path):
    def change(lines):
        rows = [line.split("\t") for line in lines]
        return ["\t".join([*row[:3], f"{0.1 * float(row[3]):.9g}"]) for row in rows]

    contours = _copy(tmp_path, CONTOURS.name, change)
    with pytest.raises(ValueError, match=f"^{contours}: z spans .*Is it in cm"):
        read_pullback(contours)
