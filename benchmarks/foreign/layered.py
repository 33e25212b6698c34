"""Records of a bed of three muscle layers, with a form of each effect drawn among several.

The true bed is not the base model's single compartment: layers lie in parallel, are squeezed
differently and have resistances that depend on their volume. Its total resistances, compliances and
mean flow are those of the base model; the difference that is left stands in each label as
`background`. The bed is in `layered_bed`, its integrator in `layered_march`, effects are in
`layered_vessel`, `layered_muscle`, `layered_reading` and `layered_outside`.
"""

import numpy as np

from benchmarks.foreign.assemble import assembled, drawn
from benchmarks.foreign.clock import Acquisition
from benchmarks.foreign.form import EffectForm, log_uniform
from benchmarks.foreign.layered_bed import LayeredBed, draw_bed, single_compartment, towards
from benchmarks.foreign.layered_catalogue import KINDS, LAYERED_DRAWERS, LAYERED_OUTSIDE
from benchmarks.foreign.layered_solver import layered_solver
from benchmarks.foreign.members import ForeignMember
from benchmarks.foreign.patient import ForeignPatient, draw_patient
from benchmarks.foreign.record import ForeignRecord
from benchmarks.foreign.schedule import truth_of
from benchmarks.foreign.waves import BeatPlan, assumed_aorta, regular_plan

STEPS = 640
"""Steps a beat."""

INERTIAL, INERTIAL_STEPS = ("plug", "plug_with_skin", "long_branch"), 1000
"""Forms under which pressures ring, and steps a beat for them."""

BACKGROUND_MMHG = (0.5, 1.0)
"""Bounds of the largest difference of the distal pressures from the base model's."""

ROUGH_STEPS = 120
"""Steps a beat where layers and single compartment are compared."""

LEAST_SAMPLES = 30
"""Of the shortest beat."""

SCATTERED = 1.0 / 3.0
"""Share of the records of several beats whose pressures scatter, about a third of all."""


def draw(seed: int, number: int) -> ForeignRecord:
    """A record.

    Args:
        seed: of the set.
        number: of the record in the set, from 0.
    """
    rng = np.random.default_rng([seed, number, 404])
    return drawn(truth_of(seed, number, LAYERED_OUTSIDE), LAYERED_DRAWERS, with_form, rng, number)


def with_form(form: EffectForm, rng: np.random.Generator, number: int = 0) -> ForeignRecord:
    """A record of a patient and of layers drawn at random under a given effect."""
    patient = draw_patient(rng)
    bed, background = calibrated(patient, draw_bed(rng), rng.uniform(*BACKGROUND_MMHG))
    scatters = bool(rng.random() < SCATTERED)
    least = next((k.beats for k in KINDS if k.effect == form.effect and k.form == form.form), 1)
    beats = int(rng.choice([3, 4, 6] if scatters else [1, 1, 3, 4, 8]))
    beats = max(beats, least + 1) if least > 1 else beats
    rate = log_uniform(rng, 60.0, 500.0)
    acquisition = _acquisition(patient, beats, rate, log_uniform(rng, 0.005, 0.03))
    plans = {
        c.name: _scattered(beats, rng) if scatters else regular_plan(beats)
        for c in patient.conditions
    }
    background["pressures_scatter"] = scatters
    solver = layered_solver(bed, steps_of(form))
    return assembled(
        "layered", number, patient, form, plans, acquisition, solver, rng,
        background=background,
    )  # fmt: skip


def steps_of(form: EffectForm) -> int:
    """Steps a beat that hold the distal pressure within 0.1 mmHg of that of half the step."""
    return INERTIAL_STEPS if form.form in INERTIAL else STEPS


def _acquisition(
    patient: ForeignPatient, beats: int, rate: float, correlation: float
) -> Acquisition:
    """Whole equal beats at about the same rate [Hz] in all conditions."""
    times = {}
    for c in patient.conditions:
        samples = max(round(rate * c.period), LEAST_SAMPLES)
        times[c.name] = np.arange(beats * samples) / samples * c.period
    return Acquisition(times, dict.fromkeys(times, 0.0), correlation, True)


def _scattered(beats: int, rng: np.random.Generator) -> BeatPlan:
    """Equal beats whose systolic and diastolic pressures scatter a little."""
    lead = 1
    n = beats + lead
    high = rng.uniform(0.5, 1.6) * rng.normal(size=n)
    low = np.append(0.4 * high, 0.0) + rng.uniform(0.2, 0.7) * rng.normal(size=n + 1)
    low[0] = 0.0  # the beat before the lead-in ends at the mean diastolic pressure
    return BeatPlan(np.ones(n), high, low, lead, False, assumed_aorta)


def calibrated(patient: ForeignPatient, bed: LayeredBed, rms: float) -> tuple[LayeredBed, dict]:
    """Layers with the mean flow of the single compartment, and what still differs.

    Args:
        patient: true parameters.
        bed: the layers, uncalibrated.
        rms: largest difference of the distal pressures [mmHg]; layers that differ more are moved
            towards the single compartment.

    Returns:
        the layers with their `scale`; `distal_rms_mmHg`, the difference of the distal pressures
        over all conditions, and `flow_share`, the largest relative difference of the mean flow.
    """
    members = [ForeignMember(patient, c, False) for c in patient.conditions]
    plans = {c.name: regular_plan(1) for c in patient.conditions}

    def run(of: LayeredBed) -> tuple[np.ndarray, np.ndarray]:
        """Mean flows and distal traces of a beat."""
        runs = layered_solver(of, ROUGH_STEPS)(members, EffectForm(), plans)
        beats = [r.t > 0.0 for r in runs]
        flows = [r.Q[inside].mean() for r, inside in zip(runs, beats, strict=True)]
        traces = [r.P_distal[inside] for r, inside in zip(runs, beats, strict=True)]
        return np.array(flows), np.array(traces)

    Q, P = run(single_compartment())
    _, P_first = run(bed)
    bed = towards(bed, min(rms / float(np.sqrt(np.mean(np.square(P_first - P)))), 1.0))
    ratio = float((run(bed)[0] / Q).mean())
    bed = bed._replace(scale=1.0 + 1.15 * (ratio - 1.0))  # the layers hold most of the resistance
    Q_last, P_last = run(bed)
    return bed, {
        "structure": "layers",
        "distal_rms_mmHg": float(np.sqrt(np.mean(np.square(P_last - P)))),
        "flow_share": float(np.abs(Q_last / Q - 1.0).max()),
    }
