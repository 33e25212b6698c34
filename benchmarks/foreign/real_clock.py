"""Records of irregular beats, sampled by a clock that does not know them.

What all records have that the base model lacks: beats of other lengths (1 to 3 %), respiration,
pressures that vary from beat to beat, now and then an extrasystole with its pause, in a half of
them an aortic pressure of another family, in some a squeeze of the arteries that turns systolic
flow back. Rows start anywhere in a beat; the monitor states the heart rate in whole beats a minute.
Effects are those of `other_forms`.
"""

import numpy as np

from benchmarks.foreign.assemble import assembled, drawn
from benchmarks.foreign.catalogue import DRAWERS
from benchmarks.foreign.clock import Acquisition
from benchmarks.foreign.form import EffectForm, log_uniform
from benchmarks.foreign.members import own_solver
from benchmarks.foreign.patient import ForeignCondition, ForeignPatient, draw_patient
from benchmarks.foreign.record import ForeignRecord
from benchmarks.foreign.schedule import OUTSIDE, truth_of
from benchmarks.foreign.waves import (
    BeatPlan,
    assumed_aorta,
    augmented_family,
    ejection_family,
)

STEPS = 200
"""Steps a beat."""

LEAD = 2
"""Beats before the recording."""

RATES_HZ = (50, 100, 100, 100, 100, 200, 200, 1000)


def draw(seed: int, number: int) -> ForeignRecord:
    """A record.

    Args:
        seed: of the set.
        number: of the record in the set, from 0.
    """
    rng = np.random.default_rng([seed, number, 303])
    return drawn(truth_of(seed, number, OUTSIDE), DRAWERS, with_form, rng, number)


def with_form(form: EffectForm, rng: np.random.Generator, number: int = 0) -> ForeignRecord:
    """A record of a patient drawn at random under a given effect."""
    patient = draw_patient(rng)
    rate = int(rng.choice(RATES_HZ))
    beats = int(rng.integers(6, 9 if rate == 1000 else 13))
    family, named = assumed_aorta, "assumed"
    if rng.random() < 0.5:
        family, named = (ejection_family, augmented_family)[int(rng.integers(2))](rng)
    kappa = float(rng.uniform(0.01, 0.05)) if rng.random() < 0.2 else 0.0
    jitter = float(rng.uniform(0.01, 0.03))
    if form.form == "arrhythmia":
        jitter = float(rng.uniform(0.06, 0.1))
    breathing = float(rng.uniform(0.5, 3.5))
    ectopic = bool(rng.random() < 0.15)
    plans = {c.name: _plan(c, beats, jitter, breathing, ectopic, rng) for c in patient.conditions}
    actual = {
        name: BeatPlan(p.lengths, p.high, p.low, p.lead, False, family, kappa)
        for name, p in plans.items()
    }
    acquisition = _acquisition(patient, plans, rate, rng)
    background = {
        "family": named, "kappa": kappa, "jitter": jitter, "breathing_mmHg": breathing,
        "ectopic": ectopic, "rate_hz": rate, "beats": beats,
    }  # fmt: skip
    return assembled(
        "real_clock", number, patient, form, actual, acquisition, own_solver(STEPS), rng,
        background=background, assumed=plans if named != "assumed" or kappa > 0.0 else None,
    )  # fmt: skip


def _plan(
    condition: ForeignCondition,
    beats: int,
    jitter: float,
    breathing: float,
    ectopic: bool,
    rng: np.random.Generator,
) -> BeatPlan:
    """Irregular beats of a condition, of the assumed aortic pressure."""
    n = beats + LEAD
    lengths = 1.0 + jitter * np.clip(rng.normal(size=n), -2.2, 2.2)
    per_minute = rng.uniform(12.0, 22.0)
    angle = 2.0 * np.pi * (per_minute / 60.0 * condition.period * np.arange(n + 1) + rng.random())
    wave = breathing * np.sin(angle)
    lengths = lengths * (1.0 + 0.3 * jitter * np.sin(angle[:-1] + 1.0))
    scatter = rng.uniform(0.3, 1.2)
    high = wave[:-1] + scatter * rng.normal(size=n)
    low = 0.6 * wave + 0.5 * scatter * rng.normal(size=n + 1)
    if ectopic and beats >= 8:
        at = int(rng.integers(LEAD + 2, n - 3))
        lengths[at], lengths[at + 1] = 0.7, 1.28
        high[at + 1], low[at + 1] = high[at + 1] - 9.0, low[at + 1] + 4.0
        high[at + 2], low[at + 2] = high[at + 2] + 4.0, low[at + 2] - 5.0
    return BeatPlan(lengths, high, low, LEAD, False, assumed_aorta)


def _acquisition(
    patient: ForeignPatient, plans: dict[str, BeatPlan], rate: int, rng: np.random.Generator
) -> Acquisition:
    """Uniform samples from anywhere in the first recorded beat to the end of the last."""
    times, shown = {}, {}
    running = rng.random() < 0.5
    for c in patient.conditions:
        lengths = plans[c.name].lengths[LEAD:] * c.period
        first = float(rng.uniform(0.0, 0.95) * lengths[0]) if rng.random() < 0.8 else 0.0
        count = int((lengths.sum() - first - 0.003) * rate)
        times[c.name] = first + np.arange(count) / rate
        clock = round(float(rng.uniform(0.0, 40.0)), 3) if running else 0.0
        shown[c.name] = clock - first
    return Acquisition(times, shown, log_uniform(rng, 0.005, 0.03), False)
