"""Records of the own circuit, with a form of each effect drawn among several.

Regular beats from the start of ejection, with the noise that the records' format describes. The
base circuit is that of the method paper; effects are in `ostium`, `bed`, `sensing` and `outside`.
"""

import numpy as np

from benchmarks.foreign.assemble import aligned_acquisition, assembled, drawn
from benchmarks.foreign.catalogue import DRAWERS
from benchmarks.foreign.form import EffectForm, log_uniform
from benchmarks.foreign.members import own_solver
from benchmarks.foreign.patient import draw_patient
from benchmarks.foreign.record import ForeignRecord
from benchmarks.foreign.schedule import OUTSIDE, truth_of
from benchmarks.foreign.waves import regular_plan

STEPS = 320
"""Steps a beat."""

MANY_BEATS = ("pulsus_alternans", "arrhythmia", "thermal_trend", "moving_wire")
"""Causes that need several beats to act."""


def draw(seed: int, number: int) -> ForeignRecord:
    """A record.

    Args:
        seed: of the set.
        number: of the record in the set, from 0.
    """
    rng = np.random.default_rng([seed, number, 202])
    return drawn(truth_of(seed, number, OUTSIDE), DRAWERS, with_form, rng, number)


def with_form(form: EffectForm, rng: np.random.Generator, number: int = 0) -> ForeignRecord:
    """A record of a patient drawn at random under a given effect."""
    patient = draw_patient(rng)
    beats = int(rng.choice([1, 1, 3, 5, 8]))
    if form.form in MANY_BEATS:
        beats = 8
    samples = int(rng.choice([64, 100, 100, 128, 200]))
    acquisition = aligned_acquisition(patient, beats, samples, log_uniform(rng, 0.005, 0.03))
    plans = {c.name: regular_plan(beats) for c in patient.conditions}
    return assembled(
        "other_forms", number, patient, form, plans, acquisition, own_solver(STEPS), rng
    )
