"""Measured states of the lumen of a case, with their pressures.

A state CONDITION_diastole or CONDITION_systole has the aortic pressure of its condition and phase.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from calibration import LumenProfile, lumen_profile
from calibration.lumen_record import frame_distance
from jaxfsi import Lumen, read_ivus_contours
from jaxfsi.contours import read_frames
from jaxfsi.text_files import read_table
from lumped.units import MM, MMHG
from study.case.anatomy import IvusAnatomy, IvusState
from study.case.faults import CaseError, Fault
from study.case.model import Case
from study.run.refusal import file_fault

LEAST_FRAMES = 3
"""Frames of the image that a course has at least."""

MOST_TIMES = 4.0
"""Area over that of another state, at the median of the course, that no lumen of a person has."""


class MeasuredState(NamedTuple):
    """A measured state of the lumen.

    Attributes:
        name: CONDITION_diastole or CONDITION_systole.
        P_aorta: pressure in the aorta [dyn/cm²].
        ratio: pressure at the end of the course over that in the aorta [-].
        lumen: its contours.
        measured: whether the ratio was measured; otherwise it is 1.
    """

    name: str
    P_aorta: float
    ratio: float
    lumen: Lumen
    measured: bool = True

    def pressure(self, fallen: Float[np.ndarray, " nodes"]) -> Float[np.ndarray, " nodes"]:
        """Pressure where a share of the course has been passed [dyn/cm²]."""
        return self.P_aorta * (1.0 - (1.0 - self.ratio) * fallen)


def measured_states(case: Case) -> list[MeasuredState]:
    """The states of a case with their pressures, the image first.

    Raises:
        CaseError: there are fewer than two, one has no pressure or its contours do not begin at
            the ostium, or two are the same.
    """
    anatomy = case.anatomy
    assert isinstance(anatomy, IvusAnatomy), "checked by the requirements of the command"
    faults = list(_state_faults(case, anatomy))
    if faults:
        raise CaseError(faults)
    found = []
    for name, state in anatomy.states.items():
        condition, phase = name.rsplit("_", 1)
        entry = case.conditions[condition]
        P = float(entry.P_systolic if phase == "systole" else entry.P_diastolic)
        lumen = _lumen(case, state)
        ratio = 1.0 if entry.ffr is None else float(entry.ffr)
        found.append(MeasuredState(name, P, ratio, lumen, entry.ffr is not None))
    return found


def _lumen(case: Case, state: IvusState) -> Lumen:
    try:
        return read_ivus_contours(state.contours, frame_table=state.frame_table)
    except ValueError as error:
        raise CaseError([file_fault(case.path, error)]) from error


def _state_faults(case: Case, anatomy: IvusAnatomy) -> list[Fault]:
    faults = []
    states = anatomy.states
    if len(states) < 2:
        cure = "add tables [anatomy.states.CONDITION_systole] with the contours of other states"
        problem = "one measured state tells nothing about the wall; its motion shows between two"
        faults.append(Fault(case.path, "anatomy.states", None, problem, "2 or more", cure))
    seen: dict[bytes, str] = {}
    for name, state in states.items():
        place = f"anatomy.states.{name}"
        condition = name.rsplit("_", 1)[0]
        if condition not in case.conditions:
            known = ", ".join(case.conditions) or "none"
            problem = f"the pressure of this state is not known: there is no condition {condition}"
            cure = f"add [condition.{condition}] with P_systolic_mmHg and P_diastolic_mmHg"
            faults.append(Fault(case.path, place, None, problem, known, cure))
        content = state.contours.read_bytes()
        if content in seen:
            problem = f"its contours are those of {seen[content]}"
            cure = "name the contours of the state, or leave one of the two out"
            faults.append(Fault(case.path, f"{place}.contours", None, problem, "", cure))
        seen[content] = name
        faults += _registration(case, place, state)
    return faults


def _registration(case: Case, place: str, state: IvusState) -> list[Fault]:
    """Fault of contours whose distance from the ostium is not known."""
    if state.frame_table is None:
        return []  # the last frame is the ostium
    lumen = _lumen(case, state)
    numbers = read_frames(state.contours).keys()
    first = min(
        float(row["position"])
        for _, row in read_table(state.frame_table)
        if float(row["frame"]) in numbers
    )
    if abs(first) * MM <= 1.5 * frame_distance(lumen):
        return []
    problem = f"the frame nearest to the ostium lies {first:g} mm from it"
    cure = "give the frames from the ostium on, at position 0, or the state is not registered"
    return [Fault(case.path, f"{place}.frame_table", None, problem, "within a frame", cure)]


def check_compared(case: Case, states: Sequence[MeasuredState], course: float) -> None:
    """Refuse states that cannot be compared over a course [cm] from the ostium.

    Raises:
        CaseError: the course is too short or goes on where contours end, a lumen is many times that
            of the image, or a state has the pressure of the image.
    """
    faults = []
    image, *others = states
    least = LEAST_FRAMES * frame_distance(image.lumen)
    if course < least:
        problem = f"a course of {course / MM:g} mm has less than {LEAST_FRAMES} frames"
        allowed, cure = f"{least / MM:.3g} mm or more", "compare a longer --course"
        raise CaseError([Fault(case.path, "", None, problem, allowed, cure)])
    along = np.linspace(max(float(state.lumen.s[0]) for state in states), course, 9)
    for state in states:
        place, last = f"anatomy.states.{state.name}.contours", float(state.lumen.s[-1])
        if last < course:
            problem = f"its contours end {last / MM:.3g} mm from the ostium"
            cure, allowed = f"compare a shorter --course than {course / MM:g}", "the whole course"
            faults.append(Fault(case.path, place, None, problem, allowed, cure))
    for state in [] if faults else others:
        place = f"anatomy.states.{state.name}"
        change = lumen_profile(state.lumen, along).log_area
        times = np.exp(np.median(change - lumen_profile(image.lumen, along).log_area))
        if not 1.0 / MOST_TIMES < times < MOST_TIMES:
            problem = f"its lumen has {times:.3g} times the area of {image.name}"
            cure = "check the unit of its contours (mm), and that they are of the same vessel"
            allowed = f"{1.0 / MOST_TIMES:g} to {MOST_TIMES:g} times"
            faults.append(Fault(case.path, f"{place}.contours", None, problem, allowed, cure))
        if abs(state.P_aorta - image.P_aorta) < MMHG and state.ratio == image.ratio:
            problem = f"its pressure is that of {image.name}, so that no wall can move between them"
            cure = "check the pressures of both conditions, or leave the state out"
            faults.append(Fault(case.path, place, None, problem, "another pressure", cure))
    if faults:
        raise CaseError(faults)


def fitted_names(case: Case, names: Sequence[str], wanted: Sequence[str] | None) -> list[str]:
    """Names of the states to fit.

    Raises:
        CaseError: one is not a state beside the image.
    """
    if wanted is None:
        return list(names[:2])
    unknown = [name for name in wanted if name not in names]
    if unknown or not wanted:
        shown = unknown[0] if unknown else "none"
        problem = f"there is no state {shown!r} to fit beside the image"
        cure = f"choose from {', '.join(names)}"
        raise CaseError([Fault(case.path, "", None, problem, ", ".join(names), cure)])
    return list(dict.fromkeys(wanted))


def state_profile(
    case: Case, state: MeasuredState, s: Float[np.ndarray, " places"], error: float
) -> LumenProfile:
    """A measured lumen at distances from the ostium [cm], with the error of its contours [-].

    Raises:
        CaseError: the contours do not reach as far.
    """
    try:
        return lumen_profile(state.lumen, s, contour_error=error)
    except ValueError as refusal:
        place, cure = f"anatomy.states.{state.name}.contours", "compare a shorter --course"
        fault = Fault(case.path, place, None, str(refusal), "", cure)
        raise CaseError([fault]) from refusal
