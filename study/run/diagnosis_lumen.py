"""The least change of a studied lumen that explains a record, see `diagnosis.least_change`."""

import pathlib

import jax.numpy as jnp
import numpy as np

from diagnosis import Diagnosis
from diagnosis.least_change import (
    CORRELATION_LENGTH,
    CT_SD,
    ULTRASOUND_SD,
    LeastChange,
    least_change,
)
from diagnosis.reach import reach
from jaxfsi.anatomy import Anatomy, intramural_course
from study.case.anatomy import IvusAnatomy, SyntheticAnatomy
from study.case.model import Case
from study.run.diagnosis_lumen_parts import BAND, LumenReach, StudyLumen

NO_STUDY = (
    "This needs the lumen along the artery from a finished study: give the folder of the study as"
    " --case."
)


def study_lumen(study: pathlib.Path | None) -> StudyLumen | str:
    """The lumen of the study of a diagnosis, or why there is none.

    Args:
        study: its folder or `study.json`; None: there is none.
    """
    if study is None:
        return NO_STUDY
    from study.run.anatomy_source import case_anatomy  # these import the 3D core
    from study.run.finished_study import studied_case

    try:
        case = studied_case(study)
        if not isinstance(case.anatomy, IvusAnatomy | SyntheticAnatomy):
            kind = "none" if case.anatomy is None else case.anatomy.kind
            return f"The anatomy of the study, of kind {kind}, has no sections of the artery."
        return known_lumen(case, case_anatomy(case), study.name)
    except (ValueError, OSError) as error:
        return f"The lumen of the study could not be opened again: {error}."


def known_lumen(case: Case, anatomy: Anatomy, study: str) -> StudyLumen:
    """The lumen of a case.

    Args:
        case: the case.
        anatomy: its anatomy, from contours or parameters.
        study: name of its study.
    """
    from study.run.what_if import aortic_area, lumen_of

    try:
        course = intramural_course(anatomy).end
    except ValueError:
        course = None
    drawn = isinstance(case.anatomy, SyntheticAnatomy)
    scan, sd = ("CT", CT_SD) if drawn else ("ultrasound", ULTRASOUND_SD)
    stated = case.uncertainty.lumen_sd
    return StudyLumen(
        study=study,
        lumen=lumen_of(anatomy),
        mu=case.blood.mu,
        rho=case.blood.rho_f,
        area_upstream=aortic_area(anatomy),
        sd=sd if stated is None else stated,
        scan=scan if stated is None else "the case",
        course=course,
    )


def found_reach(diagnosis: Diagnosis, known: StudyLumen | str) -> LumenReach | str:
    """What reaches a record, or why it is not known.

    Args:
        diagnosis: of the record.
        known: its lumen, or why there is none.
    """
    if isinstance(known, str):
        return known
    try:
        return lumen_reach(diagnosis, known)
    except ValueError as error:
        return f"{error}"


def lumen_reach(diagnosis: Diagnosis, known: StudyLumen) -> LumenReach:
    """What reaches a record, and the least change of the lumen that would.

    Args:
        diagnosis: of the record.
        known: its lumen.
    """
    found = reach(diagnosis)
    judgement = diagnosis.judgement
    best = judgement.best
    changes_R0 = not best or best == found.hypothesis
    key = "+".join(best)
    other = ("", 0.0) if changes_R0 else (key, judgement.probabilities[key])
    if found.boundary or not found.free:
        return LumenReach(known, found, None, None, other)
    change = _change(known, found.log_factor, found.flow)
    ends = [found.log_factor + sign * BAND * found.log_factor_sd for sign in (-1.0, 1.0)]
    band = jnp.stack([_change(known, end, found.flow).delta_r for end in ends])
    return LumenReach(known, found, change, band, other)


def _change(known: StudyLumen, log_factor: float, flow: float) -> LeastChange:
    return least_change(
        known.lumen,
        np.exp(log_factor),
        sd=known.sd,
        mu=known.mu,
        rho=known.rho,
        Q=max(flow, 0.0),
        correlation_length=CORRELATION_LENGTH,
        area_upstream=known.area_upstream,
    )
