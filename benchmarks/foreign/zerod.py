"""Records of svZeroDSolver: its blocks, its own time integrator (generalized-alpha).

Regular beats from the start of ejection. Forms are in `zerod_forms`, blocks in `zerod_blocks`. The
wheel `svzerod` is needed when a record is drawn, not when this module is imported.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.foreign.assemble import aligned_acquisition, assembled, drawn
from benchmarks.foreign.form import EffectForm, log_uniform
from benchmarks.foreign.members import ForeignMember, ForeignRun, parameters_of
from benchmarks.foreign.patient import Parameters, draw_patient
from benchmarks.foreign.record import ForeignRecord
from benchmarks.foreign.schedule import truth_of
from benchmarks.foreign.waves import BeatPlan, regular_plan, ventricle
from benchmarks.foreign.zerod_blocks import coronary, solver_module
from benchmarks.foreign.zerod_forms import DRAWERS, KINDS

POINTS = 250
"""Time steps a beat."""

LEFT_OF_START = 9.0
"""Time constants of the slowest state that are run before the beat that is kept."""

PASSES, CHANGE_MMHG = 25, 2e-3
"""Passes over a beat at most where an effect iterates, and the change that ends them."""


def draw(seed: int, number: int) -> ForeignRecord:
    """A record.

    Args:
        seed: of the set.
        number: of the record in the set, from 0.

    Raises:
        ImportError: svZeroDSolver is not installed.
    """
    solver_module()
    rng = np.random.default_rng([seed, number, 101])
    return drawn(truth_of(seed, number, KINDS), DRAWERS, with_form, rng, number)


def with_form(form: EffectForm, rng: np.random.Generator, number: int = 0) -> ForeignRecord:
    """A record of a patient drawn at random under a given effect."""
    patient = draw_patient(rng)
    beats = 8 if form.form == "moving_wire" else int(rng.choice([1, 1, 3, 5, 8]))
    samples = int(rng.choice([50, 100, 125, 250]))
    acquisition = aligned_acquisition(patient, beats, samples, log_uniform(rng, 0.005, 0.03))
    plans = {c.name: regular_plan(beats) for c in patient.conditions}
    return assembled("zerod", number, patient, form, plans, acquisition, solve_members, rng)


def solve_members(
    members: Sequence[ForeignMember], form: EffectForm, plans: Mapping[str, BeatPlan]
) -> list[ForeignRun]:
    """Runs of members, one by one; a `members.Solver`."""
    return [_run(member, form, plans[member.condition.name]) for member in members]


def _run(member: ForeignMember, form: EffectForm, plan: BeatPlan) -> ForeignRun:
    c = member.condition
    phase = np.linspace(0.0, 1.0, POINTS + 1)
    P_ao = plan.family(phase, c.P_systolic, c.P_diastolic, c.P_diastolic)
    shape = ventricle(phase)
    if member.on and form.inlet is not None:
        P_ao = form.inlet(phase, P_ao, c.P_systolic, c.P_diastolic, c)
    if member.on and form.squeeze is not None:
        shape = form.squeeze(phase, shape, c)
    p = parameters_of(member, form)
    P_im = p["squeeze"] * c.P_systolic * shape
    if "narrow_most" in p:
        beat = _narrowed(p, P_ao, P_im, c.period)
    elif "gain" in p:
        beat = _regulated(p, P_ao, P_im, c.period)
    else:
        beat = _one_beat(p, P_ao, P_im, c.period)
    n = plan.lengths.shape[0]
    h = c.period / POINTS
    t = h * np.arange(n * POINTS) - plan.lead * c.period
    aorta, distal, flow = (np.tile(x[:-1], n) for x in (P_ao, *beat))
    return ForeignRun(t, aorta, distal, flow, plan.recorded * c.period)


def _one_beat(
    p: Parameters, P_ao: np.ndarray, P_im: np.ndarray, period: float
) -> tuple[np.ndarray, np.ndarray]:
    """Distal pressure and flow of the last cycle of a run."""
    slowest = p["C_im"] / (1.0 / p["R_3"] + 1.0 / (p["R_2"] + p["R_1"] + p["R_0"]))
    late = p.get("late_C", 0.0) * p.get("late_R", 0.0)
    cycles = int(np.ceil(LEFT_OF_START * max(slowest, late) / period)) + 3
    solver: Any = solver_module().Solver(coronary(p, P_ao, P_im, period, cycles))
    solver.run()
    distal, flow = (
        np.asarray(solver.get_single_result(f"{kind}:{place}")).ravel()
        for kind, place in (("pressure", "ostium:distal"), ("flow", "AORTA:ostium"))
    )
    return distal, flow


def _narrowed(p: Parameters, P_ao: np.ndarray, P_im: np.ndarray, period: float):
    """A vessel with a resistance R(t) between R_0 and its largest value.

    The vessel has the largest, and its inlet the pressure that (R_largest − R(t)) Q would lose
    less. Each pass takes Q of the last; it contracts because the part moved is the smaller one.
    """
    share = np.clip((P_ao - p["narrow_from_mmHg"]) / 70.0, 0.0, 1.3) ** p["narrow_power"]
    R = p["R_0"] * (1.0 + (p["narrow_most"] - 1.0) * share)
    largest = float(R.max())
    whole = {**p, "R_0": largest}
    beat = _one_beat(whole, P_ao, P_im, period)
    for _ in range(PASSES):
        then = _one_beat(whole, P_ao + (largest - R) * beat[1], P_im, period)
        change = float(np.abs(then[0] - beat[0]).max())
        beat = then
        if change < CHANGE_MMHG:
            break
    return beat


def _regulated(p: Parameters, P_ao: np.ndarray, P_im: np.ndarray, period: float):
    """A bed whose resistance is a power of its mean perfusion pressure, by substitution."""
    mean, beat = float(P_ao.mean()), (P_ao, P_ao)
    for _ in range(PASSES):
        factor = (max(mean, 5.0) / p["usual"]) ** (1.6 * p["gain"])
        arteries = factor if p["gain_arteries"] else 1.0
        bed = {**p, "R_2": p["R_2"] * factor, "R_1": p["R_1"] * arteries}
        beat = _one_beat(bed, P_ao, P_im, period)
        found = float(beat[0][:-1].mean())
        if abs(found - mean) < CHANGE_MMHG:
            break
        mean = found
    return beat
