"""The least change of a studied lumen that explains a record, see `diagnosis.least_change`."""

import pathlib
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from diagnosis import Diagnosis
from diagnosis.least_change import (
    CORRELATION_LENGTH,
    CT_SD,
    ULTRASOUND_SD,
    LeastChange,
    least_change,
)
from diagnosis.reach import Reach, reach
from jaxfsi import Lumen
from jaxfsi.anatomy import Anatomy, intramural_course
from study.case.anatomy import IvusAnatomy, SyntheticAnatomy
from study.case.faults import CaseError
from study.case.model import Case
from study.run.anatomy_source import case_anatomy
from study.run.diagnosis import study_of
from study.run.finished_study import studied_case
from study.run.what_if import aortic_area, lumen_of

BAND = 2.0
"""Standard deviations of ln of the wanted loss that the band of a change spans either way."""

NO_STUDY = (
    "The lumen along the artery is known from a finished study: with its folder as --case this page"
    " says whether another lumen would explain the record."
)


class StudyLumen(NamedTuple):
    """The lumen of a finished study.

    Attributes:
        study: name of its folder or file.
        lumen: sections from the ostium downstream.
        mu: viscosity of blood [P].
        rho: its density [g/cm³].
        area_upstream: of the aorta [cm²].
        sd: standard deviation of the half-axes as scanned [cm].
        scan: what that is of: `ultrasound`, `CT`, or `the case`.
        course: length of the intramural course from the ostium [cm]; None where nothing tells.
    """

    study: str
    lumen: Lumen
    mu: float
    rho: float
    area_upstream: float
    sd: float
    scan: str
    course: float | None


class LumenReach(NamedTuple):
    """What reaches a record, and the change of the lumen that would.

    Attributes:
        known: the lumen as scanned.
        reach: what boundary parameters reach, and the loss wanted.
        change: the least change with that loss; None where none is needed, or none would help.
        band: its δr with a loss `BAND` standard deviations lower and higher [cm].
        other: the most probable hypothesis where it leaves R0 alone, else empty, and its
            probability.
    """

    known: StudyLumen
    reach: Reach
    change: LeastChange | None
    band: Float[Array, "2 sections"] | None
    other: tuple[str, float]


def study_lumen(place: pathlib.Path | None) -> StudyLumen | str:
    """The lumen of the study of a diagnosis, or why there is none.

    Args:
        place: what --case names; None: nothing.
    """
    try:
        study = None if place is None else study_of(place)
        if study is None:
            return NO_STUDY
        case = studied_case(study)
        if not isinstance(case.anatomy, IvusAnatomy | SyntheticAnatomy):
            kind = "none" if case.anatomy is None else case.anatomy.kind
            return f"The anatomy of the study, of kind {kind}, has no sections of the artery."
        return known_lumen(case, case_anatomy(case), study.name)
    except (CaseError, OSError) as error:
        return f"The lumen of the study could not be opened again: {error}."


def known_lumen(case: Case, anatomy: Anatomy, study: str) -> StudyLumen:
    """The lumen of a case.

    Args:
        case: the case.
        anatomy: its anatomy, from contours or parameters.
        study: name of its study.
    """
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
