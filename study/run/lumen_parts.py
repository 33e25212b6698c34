"""The lumen of the anomalous artery as documents hold it: measured, and over a cycle in 3D."""

import dataclasses

import numpy as np

from jaxfsi import read_ivus_contours
from jaxfsi.fields.lumen_sections import LumenMotion
from lumped import MM
from study.case.anatomy import IvusAnatomy
from study.case.faults import CaseError, Fault
from study.case.model import Case

_MM2 = MM**2
_KPA = 1.0e4  # dyn/cm²

Numbers = list[float | None]


@dataclasses.dataclass(frozen=True)
class MotionPart:
    """Lumen and wall over a cycle; a number is None where a plane finds no lumen.

    Attributes:
        t_s: times of the frames from the start of the cycle.
        s_mm: distance of each plane from the ostium.
        area_image_mm2: area in the reference shape.
        minor_image_mm: minor axis there.
        area_mm2: area, by frame and plane.
        minor_mm: minor axis, by frame and plane.
        narrowest: index of the plane with the least area.
        narrowest_s_mm: where it lies.
        least_area_mm2: least area there.
        largest_area_mm2: largest area there.
        area_change: one less their ratio [-].
        von_mises_p99_kPa: 99th percentile of the stress of the wall around the planes.
    """

    t_s: list[float]
    s_mm: Numbers
    area_image_mm2: Numbers
    minor_image_mm: Numbers
    area_mm2: list[Numbers]
    minor_mm: list[Numbers]
    narrowest: int
    narrowest_s_mm: float
    least_area_mm2: float
    largest_area_mm2: float
    area_change: float
    von_mises_p99_kPa: list[float]


@dataclasses.dataclass(frozen=True)
class MeasuredLumen:
    """Lumen of a state as its contours give it.

    Attributes:
        s_mm: distance from the ostium.
        area_mm2: area of each contour.
        minor_mm: its minor axis.
    """

    s_mm: Numbers
    area_mm2: Numbers
    minor_mm: Numbers


def motion_part(motion: LumenMotion) -> MotionPart:
    """Lumen and wall over a cycle as the document holds them."""
    areas = motion.area / _MM2
    course = areas[:, motion.narrowest]
    return MotionPart(
        t_s=motion.t.tolist(),
        s_mm=_numbers(motion.s / MM),
        area_image_mm2=_numbers(motion.area_image / _MM2),
        minor_image_mm=_numbers(motion.minor_image / MM),
        area_mm2=[_numbers(row) for row in areas],
        minor_mm=[_numbers(row) for row in motion.minor / MM],
        narrowest=motion.narrowest,
        narrowest_s_mm=float(motion.s[motion.narrowest] / MM),
        least_area_mm2=float(course.min()),
        largest_area_mm2=float(course.max()),
        area_change=float(1.0 - course.min() / course.max()),
        von_mises_p99_kPa=[float(value) / _KPA for value in motion.von_mises_p99],
    )


def measured_states(case: Case) -> dict[str, MeasuredLumen]:
    """Area and minor axis along the artery of every state that the case has contours of.

    Empty where the anatomy is no ultrasound record.

    Raises:
        CaseError: contours cannot be read.
    """
    if not isinstance(case.anatomy, IvusAnatomy):
        return {}
    found = {}
    for name, state in case.anatomy.states.items():
        try:
            lumen = read_ivus_contours(state.contours, frame_table=state.frame_table)
        except ValueError as error:
            problem = str(error).removeprefix(f"{state.contours}: ")
            raise CaseError([Fault(state.contours, "", None, problem, "", "correct it")]) from error
        found[name] = MeasuredLumen(
            s_mm=_numbers(np.asarray(lumen.s) / MM),
            area_mm2=_numbers(np.asarray(lumen.area) / _MM2),
            minor_mm=_numbers(np.asarray(lumen.calipers.minor) / MM),
        )
    return found


def _numbers(values: np.ndarray) -> Numbers:
    return [float(f"{v:.5g}") if np.isfinite(v) else None for v in values]
