"""Measured states of a case: their pressures, and the ones that cannot be used."""

import shutil

import numpy as np
import pytest

from lumped import MMHG
from study import CaseError, demo_case_path, read_case
from study.run.measured_states import (
    check_compared,
    fitted_names,
    measured_states,
    state_profile,
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The bundled patient with its contours in a second state, a tenth narrower."""
    place = tmp_path_factory.mktemp("states")
    for file in demo_case_path().parent.iterdir():
        shutil.copy(file, place / file.name)
    lines = (place / "rest_diastole_contours.csv").read_text("utf-8-sig").splitlines()
    narrower = []
    for line in lines:
        frame, x, y, z = line.split("\t")
        narrower.append(f"{frame}\t{0.9 * float(x)}\t{float(y)}\t{z}\n")
    (place / "narrower.csv").write_text("".join(narrower))
    text = (place / "case.toml").read_text()
    begin, end = text.index("[anatomy.states"), text.index("[condition.rest]")
    (place / "case.toml").write_text(text[:begin] + text[end:])
    return place


def _case(folder, *states, without=()):
    """The case with further states: (name, contours, frame table)."""
    text = (folder / "case.toml").read_text()
    for name in without:
        begin = text.index(f"[condition.{name}]")
        end = text.find("\n[", begin)
        text = text[:begin] + ("" if end < 0 else text[end + 1 :])
    for name, contours, table in states:
        text += f'\n[anatomy.states.{name}]\ncontours = "{contours}"\n'
        text += f'frame_table = "{table}"\n' if table else ""
    path = folder / "states.toml"
    path.write_text(text)
    return read_case(path)


def test_pressure_of_a_state_is_that_of_its_condition_and_phase(folder):
    case = _case(folder, ("dobutamine_systole", "narrower.csv", "rest_frames.csv"))
    image, state = measured_states(case)
    assert (image.name, state.name) == ("rest_diastole", "dobutamine_systole")
    assert (image.P_aorta / MMHG, state.P_aorta / MMHG) == pytest.approx((75.0, 140.0))
    assert (image.ratio, state.ratio) == (0.91, 1.0)
    assert np.asarray(state.lumen.area) == pytest.approx(0.9 * np.asarray(image.lumen.area))
    fall = image.pressure(np.array([0.0, 0.5, 1.0])) / MMHG
    assert fall == pytest.approx([75.0, 75.0 * 0.955, 75.0 * 0.91])


def test_contours_with_commas_and_a_header_have_a_frame_table_too(folder):
    lines = (folder / "narrower.csv").read_text().splitlines()
    rows = [line.replace("\t", ",") for line in lines]
    (folder / "commas.csv").write_text("\n".join(["frame,x,y,z", *rows]))
    case = _case(folder, ("dobutamine_systole", "commas.csv", "rest_frames.csv"))
    tabs = _case(folder, ("dobutamine_systole", "narrower.csv", "rest_frames.csv"))
    found, expected = (measured_states(c)[1].lumen.area for c in (case, tabs))
    np.testing.assert_array_equal(found, expected)


def test_one_state_is_refused(folder):
    with pytest.raises(CaseError, match="one measured state tells nothing"):
        measured_states(_case(folder))


def test_state_without_pressure_is_refused(folder):
    states = ("dobutamine_systole", "narrower.csv", "rest_frames.csv")
    with pytest.raises(CaseError, match="there is no condition dobutamine"):
        measured_states(_case(folder, states, without=["dobutamine"]))


def test_states_with_the_same_contours_are_refused(folder):
    states = ("rest_systole", "rest_diastole_contours.csv", "rest_frames.csv")
    with pytest.raises(CaseError, match="its contours are those of rest_diastole"):
        measured_states(_case(folder, states))


def test_contours_that_do_not_begin_at_the_ostium_are_refused(folder):
    rows = (folder / "rest_frames.csv").read_text().splitlines()
    moved = [rows[0]]
    for row in rows[1:]:
        frame, position, rest = row.split(",", 2)
        moved.append(f"{frame},{float(position) + 8.0},{rest}")
    (folder / "moved_frames.csv").write_text("\n".join(moved) + "\n")
    states = ("rest_systole", "narrower.csv", "moved_frames.csv")
    with pytest.raises(CaseError, match="lies 8 mm from it"):
        measured_states(_case(folder, states))


def test_first_two_states_are_fitted_unless_named(folder):
    case, names = _case(folder), ["rest_systole", "a_diastole", "a_systole"]
    assert fitted_names(case, names, None) == names[:2]
    assert fitted_names(case, names, ["a_systole"]) == ["a_systole"]
    with pytest.raises(CaseError, match="no state 'b_systole'"):
        fitted_names(case, names, ["b_systole"])
    with pytest.raises(CaseError, match="choose from rest_systole"):
        fitted_names(case, names, [])


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (("--course", "9000"), "course"),
        (("--free", "colour"), "colour"),
    ],
)
def test_command_refuses_what_it_cannot_do_and_writes_nothing(folder, command, given, says):
    _case(folder, ("rest_systole", "narrower.csv", "rest_frames.csv"))
    out = folder / "out"
    refused = command("calibrate-wall", folder / "states.toml", *given, folder=out)
    assert refused.status == 2
    assert says in refused.stderr
    assert not out.exists() or not any(out.iterdir())


def test_a_case_without_contours_is_refused(folder, command):
    (folder / "drawn.toml").write_text('[patient]\nid = "x"\n[anatomy]\nkind = "synthetic"\n')
    refused = command("calibrate-wall", folder / "drawn.toml", folder=folder / "drawn")
    assert refused.status == 2
    assert "ivus" in refused.stderr


def test_bundled_patient_has_four_states():
    states = measured_states(read_case(demo_case_path()))
    assert [state.name for state in states] == [
        "rest_diastole", "rest_systole", "dobutamine_diastole", "dobutamine_systole",
    ]  # fmt: skip
    assert [len(state.lumen.s) for state in states] == [20, 17, 25, 22]


def test_states_are_compared_where_their_contours_reach(folder):
    case = _case(folder, ("rest_systole", "narrower.csv", "rest_frames.csv"))
    image = measured_states(case)[0]
    with pytest.raises(CaseError, match="--course"):
        state_profile(case, image, np.array([9.0]), 0.05)


def test_a_lumen_many_times_that_of_the_image_is_refused(folder):
    case = _case(folder, ("rest_systole", "narrower.csv", "rest_frames.csv"))
    image, state = measured_states(case)
    check_compared(case, [image, state], 1.0)
    in_cm = state.lumen.__class__(10.0 * state.lumen.contours, state.lumen.s)
    with pytest.raises(CaseError, match="its lumen has 90 times the area of rest_diastole"):
        check_compared(case, [image, state._replace(lumen=in_cm)], 1.0)


def test_a_state_under_the_pressure_of_the_image_is_refused(folder):
    case = _case(folder, ("rest_systole", "narrower.csv", "rest_frames.csv"))
    image, state = measured_states(case)
    with pytest.raises(CaseError, match="its pressure is that of rest_diastole"):
        check_compared(case, [image, state._replace(P_aorta=image.P_aorta)], 1.0)


def test_a_course_beyond_the_contours_is_refused_before_the_mesh(folder, command):
    _case(folder, ("rest_systole", "narrower.csv", "rest_frames.csv"))
    out = folder / "far"
    refused = command("calibrate-wall", folder / "states.toml", "--course", "90", folder=out)
    assert refused.status == 2
    assert "its contours end" in refused.stderr
    assert not out.exists() or not any(out.iterdir())


def test_a_course_of_less_than_three_frames_is_refused(folder):
    case = _case(folder, ("rest_systole", "narrower.csv", "rest_frames.csv"))
    with pytest.raises(CaseError, match="less than 3 frames"):
        check_compared(case, measured_states(case), 0.01)


def test_support_without_stiffness_is_refused(folder, command):
    _case(folder, ("rest_systole", "narrower.csv", "rest_frames.csv"))
    path = folder / "damped.toml"
    text = (folder / "states.toml").read_text()
    path.write_text(text + "\n[tissue]\ndamping_dyn_s_per_cm3 = 1e3\n")
    refused = command("calibrate-wall", path, folder=folder / "damped")
    assert refused.status == 2
    assert "no effect in a static equilibrium" in refused.stderr
