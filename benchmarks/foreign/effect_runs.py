"""What an effect changes in the data of a record whose patient, beats and acquisition are known.

Differences are whitened as in `visibility`, with one departure: a mean flow enters as its logarithm
over 5 %, for its noise is a share of the flow that is measured, not of the usual one.

Two accuracies. *Precise* runs have the beats of the record. *Fast* ones of the own circuit have
fewer steps, and where beats are irregular the mean beat alone, whose change is laid on each beat at
its own phase. In both, what is added to the base model's data is a difference of two runs alike.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from benchmarks.foreign import zerod
from benchmarks.foreign.circuit import LostError, Physics
from benchmarks.foreign.clock import Seen, see
from benchmarks.foreign.form import EffectForm
from benchmarks.foreign.members import (
    ForeignMember,
    ForeignRun,
    parameters_of,
    solve_each,
    stretched,
)
from benchmarks.foreign.patient import STATED_SD, ForeignCondition
from benchmarks.foreign.record import Scene
from benchmarks.foreign.visibility import Nuisances, nuisances, stacked
from benchmarks.foreign.waves import BeatPlan

STEPS = {(True, False): 160, (True, True): 160, (False, False): 48, (False, True): 96}
"""Steps a beat of the own circuit, by whether it is linear and whether the run is precise."""

FINER = (4,)
"""Times as many steps where all forms are lost."""

NONE = EffectForm()


@dataclasses.dataclass(frozen=True)
class Bench:
    """A scene and the base model's runs of its fitted conditions.

    Attributes:
        scene: patient, beats, acquisition, solver.
        conditions: that are fitted.
        unknowns: directions of what is unknown of the patient.
        usual: what the base model's sensors show.
        origin: the same, whitened.
        runs: the base model's runs.
    """

    scene: Scene
    conditions: tuple[ForeignCondition, ...]
    unknowns: Nuisances
    usual: list[Seen]
    origin: np.ndarray
    runs: list[ForeignRun]

    @property
    def names(self) -> list[str]:
        """Of the fitted conditions."""
        return [c.name for c in self.conditions]

    @property
    def blocks(self) -> bool:
        """Whether runs are svZeroDSolver's, of which there is one accuracy."""
        return self.scene.solver is zerod.solve_members

    def whitened(self, seen: Sequence[Seen]) -> np.ndarray:
        """Data of the fitted conditions."""
        found = []
        for one, usual in zip(seen, self.usual, strict=True):
            more = np.log(max(one.mean_flow, 1e-3) / usual.mean_flow)
            found.append(one._replace(mean_flow=usual.mean_flow * (1.0 + more)))
        return stacked(found, self.usual, self.names, self.scene.acquisition)


def bench(scene: Scene) -> Bench:
    """Run the base model of a scene, and its differences along the patient's unknowns."""
    patient, _, plans, acquisition, solver = scene
    conditions = tuple(c for c in patient.conditions if not c.held_out)
    unknowns, usual = nuisances(patient, plans, acquisition, solver)
    runs = solver([ForeignMember(patient, c, False) for c in conditions], NONE, plans)
    origin = stacked(usual, usual, [c.name for c in conditions], acquisition)
    return Bench(scene, conditions, unknowns, usual, origin, runs)


def differences(b: Bench, forms: Sequence[EffectForm], *, precise: bool) -> list[np.ndarray | None]:
    """Whitened data with each form minus those without.

    A shift of the stated pressures moves the centre of what is known of the patient; it enters as
    the change of data that it is worth.

    Args:
        b: scene and base model.
        forms: of one branch of one effect.
        precise: see the module's docstring.

    Returns:
        The differences, None for a form that no patient could have.
    """
    found: list[np.ndarray | None] = []
    for form, runs in zip(forms, _runs(b, forms, precise), strict=True):
        if runs is None:
            found.append(None)
            continue
        seen = [
            see(run, ForeignMember(b.scene.patient, c, True), form, b.scene.acquisition)
            for run, c in zip(runs, b.conditions, strict=True)
        ]
        d = b.whitened(seen) - b.origin
        shift = form.stated_shift / STATED_SD * b.unknowns.pressures
        found.append(d - b.unknowns.columns @ shift)
    return found


def in_sensors(form: EffectForm) -> bool:
    """Whether the circuit and what drives it are those of the base model."""
    drives = (form.inlet, form.squeeze, form.beats, form.parameters)
    return form.physics == Physics() and all(law is None for law in drives)


def _runs(
    b: Bench, forms: Sequence[EffectForm], precise: bool, finer: tuple[int, ...] = (1,)
) -> list[list[ForeignRun] | None]:
    """Runs of each form; forms whose states are lost are left out, or all are run again finer."""
    if in_sensors(forms[0]):
        return [b.runs] * len(forms)
    if b.blocks:
        return [_blocks(b, form) for form in forms]
    try:
        return list(_own(b, forms, precise, finer))
    except LostError as error:
        n = len(b.conditions)
        lost = np.array(error.members.reshape(-1, n)[1:].any(axis=1))
        kept = [form for form, gone in zip(forms, lost, strict=True) if not gone]
        if kept and len(kept) < len(forms):
            alike = iter(_runs(b, kept, precise, finer))
            return [None if gone else next(alike) for gone in lost]
        return [None] * len(forms) if finer == FINER else _runs(b, forms, precise, FINER)


def _blocks(b: Bench, form: EffectForm) -> list[ForeignRun] | None:
    """Runs of svZeroDSolver; a condition that the form leaves alone is not run again."""
    found = []
    for run, c in zip(b.runs, b.conditions, strict=True):
        on, off = (ForeignMember(b.scene.patient, c, state) for state in (True, False))
        same = form.inlet is None and form.squeeze is None
        if same and {**parameters_of(on, form), "on": 0.0} == parameters_of(off, form):
            found.append(run)
            continue
        try:
            found += b.scene.solver([on], form, b.scene.plans)
        except RuntimeError:
            return None
    return found


def _own(
    b: Bench, forms: Sequence[EffectForm], precise: bool, finer: tuple[int, ...]
) -> list[list[ForeignRun]]:
    """Base runs plus what forms change in runs side by side."""
    plans = {c.name: b.scene.plans[c.name] for c in b.conditions}
    mean = not precise and forms[0].beats is None and not all(p.regular for p in plans.values())
    if mean:
        plans = {name: _mean_beat(plan) for name, plan in plans.items()}
    members = [
        ForeignMember(b.scene.patient, c, on)
        for on in (False, *(True for _ in forms))
        for c in b.conditions
    ]
    n = len(b.conditions)
    each = [form for form in (forms[0], *forms) for _ in range(n)]
    # without an effect the number of the form is the first one's
    physics = _joint(forms)
    runs = solve_each(members, each, physics, plans, STEPS[physics.linear, precise], finer=finer)
    return [
        [_laid(b.runs[k], runs[k], runs[n * (j + 1) + k], b, k, mean) for k in range(n)]
        for j in range(len(forms))
    ]


def _mean_beat(plan: BeatPlan) -> BeatPlan:
    return BeatPlan(np.ones(1), np.zeros(1), np.zeros(2), 0, True, plan.family, plan.kappa)


def _laid(
    base: ForeignRun, off: ForeignRun, on: ForeignRun, b: Bench, place: int, mean: bool
) -> ForeignRun:
    """The base run plus the difference of two runs, at its times or at its phases of a beat."""
    c = b.conditions[place]
    if mean:
        plan = b.scene.plans[c.name]
        edges = np.concatenate([[0.0], np.cumsum(plan.lengths)])
        turn = base.t / c.period + edges[plan.lead]
        beat = np.clip(np.searchsorted(edges, turn + 1e-9) - 1, 0, plan.lengths.size - 1)
        length = plan.lengths[beat]
        at = stretched((turn - edges[beat]) / length, length)
        own, around = off.t / c.period, 1.0
    else:
        at, own, around = base.t, off.t, None

    def plus(name: str) -> np.ndarray:
        change = getattr(on, name) - getattr(off, name)
        return getattr(base, name) + np.interp(at, own, change, period=around)

    return base._replace(P_aorta=plus("P_aorta"), P_distal=plus("P_distal"), Q=plus("Q"))


def _joint(forms: Sequence[EffectForm]) -> Physics:
    """Laws that take each member's own form, by its place `which`."""
    first = forms[0].physics
    laws = {}
    for name in ("loss", "arterial", "tone", "venous", "side", "extra"):
        each = [getattr(form.physics, name) for form in forms]
        laws[name] = None if each[0] is None else _chosen(each)
    return first._replace(**laws)


def _chosen(laws: list):
    if len(laws) == 1:
        return laws[0]

    def law(p, *rest):
        return _pick(p["which"], [one(p, *rest) for one in laws])

    return law


def _pick(which: np.ndarray, found: list):
    if isinstance(found[0], tuple | list):
        return [_pick(which, list(part)) for part in zip(*found, strict=True)]
    if all(np.isscalar(one) for one in found) and len(set(found)) == 1:
        return found[0]
    out = found[0]
    for k, one in enumerate(found[1:], start=1):
        out = np.where(which == k, one, out)
    return out
