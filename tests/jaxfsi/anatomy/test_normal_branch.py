"""The stem of the normal coronary: of the bundled patient, and what is refused."""

import numpy as np
import pytest

from jaxfsi.anatomy import (
    Anatomy,
    IvusOptions,
    SizedLine,
    aortic_gap,
    ivus_anatomy,
    measured_aorta,
    read_centerline,
    read_sized_line,
)
from jaxfsi.anatomy.sources.normal_branch import normal_branch
from study import demo_case_path

BUNDLED = demo_case_path().parent


def whole(**changes: object) -> Anatomy:
    given = {
        "frame_table": BUNDLED / "rest_frames.csv",
        "reference": BUNDLED / "rest_diastole_reference.csv",
        "aorta_centerline": BUNDLED / "aorta_centerline.csv",
        "normal_centerline": BUNDLED / "left_centerline.csv",
    }
    files = BUNDLED / "rest_diastole_contours.csv", BUNDLED / "centerline.csv"
    return ivus_anatomy(*files, **(given | changes))


@pytest.fixture(scope="module")
def patient() -> Anatomy:
    return whole()


def test_stem_follows_the_line_and_the_spheres_of_ct(patient):
    ct = read_sized_line(BUNDLED / "left_centerline.csv")
    rotation = np.array(patient.meta["aortic_axes_in_ct"])
    points = (ct.points - patient.meta["aortic_origin_in_ct"]) @ rotation.T
    line = patient.centerlines["normal"]
    nearest = np.linalg.norm(points[:, None] - line.points, axis=2)
    own = nearest.min(axis=1) < 0.1
    s = line.s[nearest.argmin(axis=1)]
    beyond = own & (s > 0.5) & (s < 0.85)  # clear of the aorta, and of the cut
    assert np.count_nonzero(beyond) >= 10
    assert nearest.min(axis=1)[own & (s > 0.0) & (s < 1.0)].max() < 0.05  # smoothing over 1.5 mm
    held = -patient.lumen(points[beyond])
    np.testing.assert_allclose(held, ct.radius[beyond], atol=0.02)  # smoothing


def test_stem_is_cut_where_it_is_asked_and_clear_of_all_else(patient):
    assert [opening.name for opening in patient.openings][-1] == "normal_outlet"
    assert list(patient.centerlines) == ["aorta", "anomalous", "normal"]
    assert 1.0 <= patient.centerlines["normal"].s[-1] < 1.05
    longer = whole(options=IvusOptions(normal_length=1.6))
    assert 1.6 <= longer.centerlines["normal"].s[-1] < 1.65
    for opening in patient.openings:
        rng = np.random.default_rng(0)
        direction = rng.normal(size=(2000, 3))
        across = direction - (direction @ opening.normal)[:, None] * opening.normal
        across /= np.linalg.norm(across, axis=1)[:, None]
        # the rim of the disc lies outside the wall all round: the plane cuts one vessel through
        assert np.all(patient.wall(opening.centre + opening.radius * across) > 0.0)


def test_sections_of_the_anomalous_artery_are_those_beside_a_straight_aorta(patient):
    straight = whole(aorta_centerline=None, normal_centerline=None)
    assert straight.meta["aorta_measured"] is False
    assert len(straight.openings) == 3
    for key in ("area_frames", "septum", "s_frames"):
        assert patient.meta[key] == straight.meta[key]


def fit_and_line():
    coronary = read_centerline(BUNDLED / "centerline.csv")
    aorta = read_sized_line(BUNDLED / "aorta_centerline.csv")
    fit = measured_aorta(coronary, aorta, offset=0.16)
    return fit, read_sized_line(BUNDLED / "left_centerline.csv")


def made(fit, line):
    return normal_branch(
        fit, line, length=1.0, fillet=0.06, thickness=lambda r: np.full_like(r, 0.06)
    )


def test_line_is_read_from_either_end():
    fit, line = fit_and_line()
    one, other = made(fit, line), made(fit, SizedLine(line.points[::-1], line.radius[::-1]))
    np.testing.assert_allclose(one.outlet.centre, other.outlet.centre, atol=0.03)
    start = one.vessel.tube.axis.points[:1]
    assert aortic_gap(fit.aorta, start)[0] < -0.05


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda line: line._replace(points=line.points + 3.0), r"begins .* outside"),
        (lambda line: SizedLine(line.points[:14], line.radius[:14]), r"does not leave the aorta"),
        (lambda line: line._replace(radius=3.0 * line.radius), r"radius of .* expected up to"),
    ],
    ids=["elsewhere", "short", "wide"],
)
def test_line_of_no_stem_is_refused(change, words):
    fit, line = fit_and_line()
    with pytest.raises(ValueError, match=words):
        made(fit, change(line))


def test_files_that_do_not_fit_are_named(tmp_path):
    with pytest.raises(ValueError, match=r"left_centerline.csv: .* needs the aorta.*Give"):
        whole(aorta_centerline=None)
    with pytest.raises(ValueError, match=r"centerline.csv: the centre line has no radii\. Save"):
        whole(aorta_centerline=BUNDLED / "centerline.csv")
    rows = np.loadtxt(BUNDLED / "aorta_centerline.csv", delimiter=",")
    path = tmp_path / "aorta.csv"
    for scale, words in (
        ([0.1] * 4, r"spacing .* expected .*in mm"),
        ([1.0, 1.0, 1.0, 0.01], r"the radius of point 1 is .* expected .*in mm"),
    ):
        np.savetxt(path, rows * scale, delimiter=",")
        with pytest.raises(ValueError, match=f"^{path}: .*{words}"):
            whole(aorta_centerline=path)
    path.write_text("1,2,3,4\n1,2,3\n")
    with pytest.raises(ValueError, match=rf"^{path}: line 2.*four finite numbers.*Expected"):
        whole(aorta_centerline=path)
    np.savetxt(path, rows[rows[:, 2] > 1735.0], delimiter=",")
    with pytest.raises(ValueError, match=rf"^{path}: .*reaches .* upstream.*lower aorta_below"):
        whole(aorta_centerline=path)
