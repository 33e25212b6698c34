"""Operations on an anatomy: what they change, what stays, and the loss that is left."""

import math

import jax.numpy as jnp
import numpy as np
import pytest

from calibration import lumen_law
from jaxfsi import Lumen
from jaxfsi.anatomy import (
    adult_anatomy,
    intramural_course,
    paediatric_anatomy,
    reimplanted,
    stented,
    synthetic_anatomy,
    unroofed,
    vessel_sections,
)
from jaxfsi.anatomy.vessel_sections import aorta_distance, away_from_aorta, contours_at, tube_areas
from jaxfsi.meshing.build import build_mesh

OPERATIONS = {"unroof": unroofed, "reimplant": reimplanted, "stent": stented}


@pytest.fixture(scope="module", params=["adult right", "child left"])
def anatomy(request):
    parameters = {"adult right": adult_anatomy("right"), "child left": paediatric_anatomy("left")}
    return synthetic_anatomy(parameters[request.param])


@pytest.fixture(scope="module")
def adult():
    return synthetic_anatomy(adult_anatomy("right"))


def law(anatomy):
    sections = vessel_sections(anatomy)
    lumen = Lumen(jnp.asarray(sections.contours), jnp.asarray(sections.s))
    return lumen_law(lumen, mu=0.04, rho=1.06)


def artery(anatomy):
    return next(v for v in anatomy.vessels if v.name == "anomalous")


def test_course_is_that_of_the_parameters(adult):
    course = intramural_course(adult)
    assert course.end == adult.meta["parameters"]["intramural_length"]
    assert course.reference_area == pytest.approx(math.pi * 0.19**2)


def test_contours_of_a_tube_come_back(adult):
    vessel = artery(adult)
    s = np.array([0.5, 1.0, 2.5])
    # an ellipse of 96 points has 0.1 % less area than the curve through them
    expected = [0.5 * math.pi * 0.19**2, 0.5 * math.pi * 0.19**2, math.pi * 0.19**2]
    assert tube_areas(vessel.tube, s) == pytest.approx(expected, rel=1e-2)


@pytest.mark.parametrize("name", OPERATIONS)
def test_course_is_round_with_the_reference_area(anatomy, name):
    course = intramural_course(anatomy)
    sections = vessel_sections(OPERATIONS[name](anatomy))
    lumen = Lumen(jnp.asarray(sections.contours), jnp.asarray(sections.s))
    # the passage into the patient's own sections may dip by a few per cent where these widen
    assert np.min(lumen.area) > 0.93 * course.reference_area
    first = lumen.calipers.minor[0] / lumen.calipers.major[0]
    assert float(first) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("name", OPERATIONS)
def test_loss_falls(anatomy, name):
    before, after = law(anatomy), law(OPERATIONS[name](anatomy))
    assert float(after.R0) < 0.6 * float(before.R0)
    assert float(after.K) < float(before.K)


@pytest.mark.parametrize("name", OPERATIONS)
def test_outlet_aorta_and_other_artery_stay(anatomy, name):
    changed = OPERATIONS[name](anatomy)
    assert changed.openings == anatomy.openings
    assert changed.vessels[0] is anatomy.vessels[0]
    assert changed.vessels[2] is anatomy.vessels[2]
    end = anatomy.centerlines["anomalous"].points[-1]
    # two samplings of one path, 0.2 mm apart, cubic between
    assert changed.centerlines["anomalous"].points[-1] == pytest.approx(end, abs=2e-3)
    own, new = artery(anatomy), artery(changed)
    ends = [tube_areas(v.tube, v.tube.axis.s[-1:])[0] for v in (own, new)]
    assert ends[1] == pytest.approx(ends[0], rel=1e-4)


def test_reimplanted_artery_is_shorter_than_unroofed_than_its_own(anatomy):
    lengths = [
        change(anatomy).centerlines["anomalous"].s[-1]
        for change in (reimplanted, unroofed, stented)
    ]
    assert lengths == sorted(lengths)
    assert lengths[1] < lengths[2] == anatomy.centerlines["anomalous"].s[-1]


def test_reimplanted_artery_leaves_at_a_right_angle(adult):
    axis = artery(reimplanted(adult)).tube.axis
    aorta = adult.vessels[0].tube
    start = int(np.searchsorted(axis.s, 0.0))
    line = aorta.axis.points
    outward = (
        axis.points[start] - line[np.argmin(np.linalg.norm(line - axis.points[start], axis=1))]
    )
    # the wall of the sinus is not parallel to the axis of the aorta
    assert axis.tangent[start] @ outward / np.linalg.norm(outward) > 0.9


def test_stent_keeps_the_tissue_between_the_lumens(anatomy):
    s = np.linspace(0.35, 0.95, 5) * intramural_course(anatomy).end
    gaps = []
    for changed in (anatomy, stented(anatomy)):
        vessel = artery(changed)
        gap = aorta_distance(changed.vessels[0], vessel.tube)
        gaps.append(np.interp(s, vessel.tube.axis.s, gap))
    # along the course the aortic wall is curved, so that a round section touches at one line
    assert gaps[1] == pytest.approx(gaps[0], abs=0.012)


def test_wider_stents_leave_less_loss(adult):
    losses = [law(stented(adult, d)) for d in (0.25, 0.3, 0.35, 0.4)]
    for name in ("R0", "K"):
        values = [float(getattr(one, name)) for one in losses]
        assert values == sorted(values, reverse=True)


def test_away_is_away(adult):
    vessel = artery(adult)
    axis = vessel.tube.axis
    away = away_from_aorta(adult.vessels[0], axis)
    step = away[:, :1] * axis.normal + away[:, 1:] * axis.binormal
    line = adult.vessels[0].tube.axis.points

    def distance(points):
        return np.min(np.linalg.norm(points[:, None] - line[None], axis=2), axis=1)

    beside = axis.s > 0.0
    assert np.all((distance(axis.points + 0.01 * step) > distance(axis.points))[beside])
    assert contours_at(vessel.tube, axis.s).shape[0] == len(axis.s)


def test_what_has_no_course_is_refused(adult, tmp_path):
    with pytest.raises(ValueError, match=r"within 0.1\.\.0.6 cm"):
        stented(adult, 3.0)
    bare = adult.__class__(
        *(getattr(adult, n) for n in ("name", "lumen", "wall", "local_radius", "thickness")),
        adult.openings, adult.bounds, adult.centerlines,
    )  # fmt: skip
    with pytest.raises(ValueError, match="no sections of an anomalous artery"):
        unroofed(bare)


@pytest.mark.slow
@pytest.mark.parametrize("name", OPERATIONS)
def test_operated_anatomy_makes_a_sound_mesh(adult, name):
    report = build_mesh(OPERATIONS[name](adult), preset="coarse").report.to_dict()
    assert report["topology"]["faults"] == []
    for measures in report["quality"]["measures"].values():
        # the bound of any coarse mesh
        assert measures["min_dihedral_deg"]["minimum"] > 5.0
