"""The lumen of the anomalous artery as documents hold it: measured, and over a cycle in 3D."""

import numpy as np

from jaxfsi import read_ivus_contours
from jaxfsi.fields.lumen_sections import LumenMotion
from lumped import MM
from study.case.anatomy import IvusAnatomy
from study.case.faults import CaseError, Fault
from study.case.model import Case
from study.run.study_parts import MeasuredLumen, MotionPart, Numbers

_MM2 = MM**2
_KPA = 1.0e4  # dyn/cm²


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
