"""The document of the command `calibrate-wall`."""

import numpy as np
from jaxtyping import Float

from calibration import LumenProfile, lumen_change
from lumped import MMHG
from lumped.units import MM
from study.case.model import Case
from study.report.documents.parts import Note
from study.report.documents.wall import (
    FittedStiffness,
    LumenNumbers,
    LumenState,
    WallDocument,
)
from study.run.wall_calibration import StateMotion, WallFit
from study.store.layouts import FORMAT
from study.store.provenance import Provenance

UNITS = {"support": "dyn/cm3", "thickness": ""}
_MODULUS = "dyn/cm2"

FELL_SHORT = 1.5
"""Deviation in standard deviations beyond which a state counts as not explained; as little is one
explained that a lumen which does not move misses by no more."""

LEFT = (
    "Aortic pressure loads the lumens on both sides of the septum, so that moduli alone change"
    " little. The remaining causes are not in this model: stretch of the vessel along its length,"
    " torsion with the heart, frames that are not registered, vessel tone, and the catheter in the"
    " lumen. jaxfsi diagnose calls the remainder stress_narrowing where it differs between stress"
    " and rest, and dynamic_narrowing where it follows the beat, and weighs both against other"
    " effects on the measured ratios."
)

STILL = "rigid"
"""Name of a lumen that does not move."""


def wall_document(case: Case, fit: WallFit, provenance: Provenance) -> WallDocument:
    """The document of the command."""
    states = {motion.state.name: _state(fit, motion) for motion in fit.states}
    return WallDocument(
        format=FORMAT,
        kind="wall",
        patient=case.id,
        image=fit.image.name,
        P_image_mmHg=fit.image.P_aorta / MMHG,
        s_mm=(fit.s / MM).tolist(),
        image_lumen=_lumen(fit.image_profile.log_area, fit.image_profile.log_minor),
        stiffness=[
            FittedStiffness(
                name=name,
                unit=UNITS.get(name, _MODULUS),
                start=float(getattr(fit.start, name)),
                value=float(getattr(fit.found, name)),
                low=float(low),
                high=float(high),
            )
            for name, (low, high) in zip(fit.names, fit.interval, strict=True)
        ],
        misfit=fit.misfit,
        evaluations=fit.evaluations,
        determined=list(fit.messages),
        notes=[*_notes(states), *_unmeasured(fit), _as_case(fit)],
        states=states,
        provenance=provenance,
    )


def _lumen(
    log_area: Float[np.ndarray, " places"], log_minor: Float[np.ndarray, " places"]
) -> LumenNumbers:
    return LumenNumbers((np.exp(log_area) / MM**2).tolist(), (np.exp(log_minor) / MM).tolist())


def _state(fit: WallFit, motion: StateMotion) -> LumenState:
    image, measured = fit.image_profile, motion.measured
    area, minor = np.exp(measured.log_area) / MM**2, np.exp(measured.log_minor) / MM
    models = {name: _predicted(image, *logarithms) for name, logarithms in motion.predicted.items()}
    off = {
        name: _deviation(measured, image, *logarithms)
        for name, logarithms in motion.predicted.items()
    }
    still = np.zeros_like(measured.log_area)
    off[STILL] = _deviation(measured, image, still, still)
    change = {"measured": float(np.mean(np.exp(measured.log_area - image.log_area) - 1.0))}
    change |= {name: float(np.mean(np.exp(a) - 1.0)) for name, (a, _) in motion.predicted.items()}
    return LumenState(
        fitted=motion.fitted,
        P_aorta_mmHg=motion.state.P_aorta / MMHG,
        P_distal_mmHg=motion.state.P_aorta * motion.state.ratio / MMHG,
        measured=LumenNumbers(area.tolist(), minor.tolist()),
        area_sd_mm2=(area * measured.sd_area).tolist(),
        minor_sd_mm=(minor * measured.sd_minor).tolist(),
        predicted=models,
        change=change,
        deviation=off,
    )


def _predicted(
    image: LumenProfile,
    log_area: Float[np.ndarray, " places"],
    log_minor: Float[np.ndarray, " places"],
) -> LumenNumbers:
    return _lumen(image.log_area + log_area, image.log_minor + log_minor)


def _deviation(
    measured: LumenProfile,
    image: LumenProfile,
    log_area: Float[np.ndarray, " places"],
    log_minor: Float[np.ndarray, " places"],
) -> float:
    change = lumen_change(measured, image)
    off = [
        (log_area - np.asarray(change.log_area)) / np.asarray(change.sd_area),
        (log_minor - np.asarray(change.log_minor)) / np.asarray(change.sd_minor),
    ]
    return float(np.sqrt(np.mean(np.square(off))))


def _notes(states: dict[str, LumenState]) -> list[Note]:
    """How far the prediction falls short, state by state, and what may be left."""
    found = []
    for name, state in states.items():
        way = "fitted" if state.fitted else "predicted"
        off = state.deviation["fitted"]
        short = off > FELL_SHORT or off >= state.deviation[STILL]
        text = (
            f"{name.replace('_', ' ')} ({way}): the area changes by"
            f" {100 * state.change['measured']:+.1f} % as measured and by"
            f" {100 * state.change['fitted']:+.1f} % in the fitted wall, on average over the"
            f" course; what it misses is {off:.1f} standard deviations,"
            f" where a lumen that does not move misses {state.deviation[STILL]:.1f}."
        )
        found.append(Note("warning" if short else "info", text))
    if any(note.level == "warning" for note in found):
        found.append(Note("warning", LEFT))
    return found


def _unmeasured(fit: WallFit) -> list[Note]:
    """States in whose condition no pressure was measured behind the course."""
    names = [
        motion.state.name.replace("_", " ") for motion in fit.states if not motion.state.measured
    ]
    if not names:
        return []
    text = (
        f"{', '.join(names)}: no pressure ratio is known in this condition, so that the pressure"
        " does not fall along the course here. Give ffr in its table if it was measured."
    )
    return [Note("info", text)]


def _as_case(fit: WallFit) -> Note:
    """How a case has the wall that was found."""
    found = fit.found
    keys = (
        f"E_dyn_per_cm2 = {float(found.aorta):.4g}, E_coronary_dyn_per_cm2 ="
        f" {float(found.coronary):.4g} and E_septum_dyn_per_cm2 = {float(found.septum):.4g} below"
        f" [wall], stiffness_dyn_per_cm3 = {float(found.support):.4g} below [tissue]"
    )
    if "thickness" in fit.names:
        keys += f"; and {float(found.thickness):.4g} times the thickness"
    return Note("info", f"The fitted wall as a case has it: {keys}.")
