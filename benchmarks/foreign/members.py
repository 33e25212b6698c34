"""Runs of the own circuit: variants of a patient, with and without an effect, side by side."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.foreign.circuit import FINER, Physics, solve
from benchmarks.foreign.form import EffectForm
from benchmarks.foreign.patient import (
    ForeignCondition,
    ForeignPatient,
    Parameters,
    base_parameters,
)
from benchmarks.foreign.waves import BeatPlan, ventricle

END_OF_SYSTOLE = 0.42
"""Phase up to which a beat takes systole's share of a changed length."""

SYSTOLIC_SHARE = 0.4
"""Power of a beat's length with which its systole changes."""


class ForeignMember(NamedTuple):
    """One run: a patient in a condition, with or without the effect."""

    patient: ForeignPatient
    condition: ForeignCondition
    on: bool


class ForeignRun(NamedTuple):
    """Traces of a member.

    Attributes:
        t: times from the first recorded beat on [s].
        P_aorta, P_distal: pressures [mmHg].
        Q: flow through the proximal vessel [mL/s].
        end: end of the last beat [s].
    """

    t: np.ndarray
    P_aorta: np.ndarray
    P_distal: np.ndarray
    Q: np.ndarray
    end: float


Solver = Callable[[Sequence[ForeignMember], EffectForm, Mapping[str, BeatPlan]], list[ForeignRun]]
"""Runs of members under an effect, with the beats of each condition by its name."""


def parameters_of(member: ForeignMember, form: EffectForm) -> Parameters:
    """Parameters of a member, the effect's among them."""
    p = {**base_parameters(member.patient, member.condition), **form.constants}
    if member.on and form.parameters is not None:
        p = form.parameters(p, member.condition)
    return {**p, "on": float(member.on)}


def own_solver(steps: int) -> Solver:
    """The own circuit with so many steps a beat."""

    def run(
        members: Sequence[ForeignMember], form: EffectForm, plans: Mapping[str, BeatPlan]
    ) -> list[ForeignRun]:
        return solve_each(members, [form] * len(members), form.physics, plans, steps)

    return run


def solve_each(
    members: Sequence[ForeignMember],
    forms: Sequence[EffectForm],
    physics: Physics,
    plans: Mapping[str, BeatPlan],
    steps: int,
    *,
    finer: tuple[int, ...] = FINER,
) -> list[ForeignRun]:
    """Runs of members side by side, each under its own form.

    Args:
        members: runs.
        forms: of each member, with the same constants.
        physics: laws of all of them; a law finds the place of its form in the parameter `which`.
        plans: beats of each condition by its name.
        steps: steps a beat.
        finer: multiples of them that are tried where fewer lose the solution.
    """
    each = [plans[m.condition.name] for m in members]
    found = [parameters_of(m, form) for m, form in zip(members, forms, strict=True)]
    p = {name: np.array([one[name] for one in found]) for name in found[0]}
    p["kappa"] = p["kappa"] + np.array([plan.kappa for plan in each])
    distinct = list({id(form): form for form in forms}.values())
    places = {id(form): k for k, form in enumerate(distinct)}
    p["which"] = np.array([places[id(form)] for form in forms])
    period = np.array([m.condition.period for m in members])
    regular = all(plan.regular for plan in each) and all(form.beats is None for form in forms)
    lengths = np.stack([plan.lengths for plan in each], axis=1)
    plan = BeatPlan(lengths, np.zeros(0), np.zeros(0), each[0].lead, regular, each[0].family)
    out = solve(p, plan, _pressures(members, each, forms), period, physics, steps, finer=finer)
    end = period * lengths[plan.lead :].sum(axis=0)
    return [
        ForeignRun(out.t[:, k], out.P_aorta[:, k], out.P_distal[:, k], out.Q[:, k], float(end[k]))
        for k in range(len(members))
    ]


def _pressures(
    members: Sequence[ForeignMember], plans: Sequence[BeatPlan], forms: Sequence[EffectForm]
):
    """The driving pressures of all members, as `circuit.solve` asks for them."""

    def pressures(phase: np.ndarray, beat: int) -> tuple[np.ndarray, np.ndarray]:
        columns = [
            beat_pressures(m, plan, form, phase, beat)
            for m, plan, form in zip(members, plans, forms, strict=True)
        ]
        P_ao, P_im = (np.stack(part, axis=1) for part in zip(*columns, strict=True))
        return P_ao, P_im

    return pressures


def beat_pressures(
    member: ForeignMember, plan: BeatPlan, form: EffectForm, phase: np.ndarray, beat: int
) -> tuple[np.ndarray, np.ndarray]:
    """Aortic and ventricular pressure [mmHg] of a beat of a member; −1 is the mean beat."""
    c, mean = member.condition, beat < 0
    length = 1.0 if mean else float(plan.lengths[beat])
    high, low, after = c.P_systolic, c.P_diastolic, c.P_diastolic
    if not mean:
        high, low, after = high + plan.high[beat], low + plan.low[beat], low + plan.low[beat + 1]
        if member.on and form.beats is not None:
            now, then = form.beats(beat, c), form.beats(beat + 1, c)
            high, low, after = high + now[0], low + now[1], after + then[1]
    phase = stretched(phase, length)
    P = plan.family(phase, high, low, after)
    shape = ventricle(phase)
    if member.on and form.inlet is not None:
        P = form.inlet(phase, P, high, low, c)
    if member.on and form.squeeze is not None:
        shape = form.squeeze(phase, shape, c)
    return P, high * shape


def stretched(phase: np.ndarray, length: float | np.ndarray) -> np.ndarray:
    """Phases of the mean beat at phases of a beat of another length."""
    share = length / length**SYSTOLIC_SHARE
    turn = END_OF_SYSTOLE / share
    rest = END_OF_SYSTOLE + (1.0 - END_OF_SYSTOLE) * (phase - turn) / (1.0 - turn)
    return np.where(phase < turn, phase * share, rest)
