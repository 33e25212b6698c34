"""Runs of the layered bed: members of a record, with and without its effect."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from benchmarks.foreign.form import EffectForm
from benchmarks.foreign.layered_bed import LayeredBed, LayerParameters, layer_parameters
from benchmarks.foreign.layered_march import Law, LayeredCircuit, Tone
from benchmarks.foreign.members import ForeignMember, ForeignRun, Solver, beat_pressures
from benchmarks.foreign.patient import ForeignCondition
from benchmarks.foreign.waves import BeatPlan


@dataclasses.dataclass(frozen=True)
class LayeredForm(EffectForm):
    """An effect on the layered bed.

    Attributes:
        change: (elements of a member, condition) → elements under the effect.
        law: changes the elements at every step.
        tone: factors of the arterioles that follow mean pressures over many beats.
    """

    change: Callable[[LayerParameters, ForeignCondition], LayerParameters] | None = None
    law: Law | None = None
    tone: Tone | None = None


def layered_solver(bed: LayeredBed, steps: int) -> Solver:
    """A solver of records with these layers.

    Args:
        bed: the layers.
        steps: in a beat.
    """

    def run(
        members: Sequence[ForeignMember], form: EffectForm, plans: Mapping[str, BeatPlan]
    ) -> list[ForeignRun]:
        found: dict[int, ForeignRun] = {}
        for on in (False, True):
            places = [k for k, m in enumerate(members) if m.on == on]
            if places:
                part = [members[k] for k in places]
                runs = _solve(part, form if on else EffectForm(), plans, bed, steps)
                found.update(zip(places, runs, strict=True))
        return [found[k] for k in range(len(members))]

    return run


def stacked_parameters(
    members: Sequence[ForeignMember], form: EffectForm, bed: LayeredBed
) -> LayerParameters:
    """Elements of members along the last axis, changed by the effect where it acts."""
    found = []
    for m in members:
        p = layer_parameters(m.patient, m.condition, bed)
        if m.on and isinstance(form, LayeredForm) and form.change is not None:
            p = form.change(p, m.condition)
        p["stressed"] = np.array(float(m.condition.stressed))
        found.append(p)
    return {name: np.stack([p[name] for p in found], axis=-1) for name in found[0]}


def _solve(
    members: Sequence[ForeignMember],
    form: EffectForm,
    plans: Mapping[str, BeatPlan],
    bed: LayeredBed,
    steps: int,
) -> list[ForeignRun]:
    each = [plans[m.condition.name] for m in members]
    lead, recorded = each[0].lead, each[0].recorded
    laws = form if isinstance(form, LayeredForm) else LayeredForm()
    period = np.array([m.condition.period for m in members])

    def drive(phase: np.ndarray, beat: int) -> tuple[np.ndarray, np.ndarray]:
        both = [beat_pressures(m, q, form, phase, beat) for m, q in zip(members, each, strict=True)]
        P_ao, P_lv = (np.stack(part, axis=1) for part in zip(*both, strict=True))
        return P_ao, P_lv

    p = stacked_parameters(members, form, bed)
    circuit = LayeredCircuit(p, period, drive, laws.law, laws.tone)
    state, beat = circuit.settle(steps)
    before = 1 + lead
    if all(plan.regular for plan in each) and form.beats is None:
        beats = [beat] * (before + recorded)
    else:
        beats = [beat] + [circuit.beat(state, k, steps) for k in range(lead + recorded)]
    # the last sample of the periodic beat is also the instant before the first step
    x = np.concatenate([beat[-1:], *beats])[:, :3]
    count = (np.arange(x.shape[0]) - before * steps) / steps
    return [
        ForeignRun(count * T, x[:, 0, k], x[:, 2, k], x[:, 1, k], float(recorded * T))
        for k, T in enumerate(period)
    ]
