"""Puts a record together: patient, beats, acquisition and effect, from any solver."""

from collections.abc import Callable, Mapping

import numpy as np

from benchmarks.foreign.clock import Acquisition, Seen, see
from benchmarks.foreign.form import EffectForm
from benchmarks.foreign.members import ForeignMember, Solver
from benchmarks.foreign.patient import ForeignPatient
from benchmarks.foreign.record import ForeignRecord, Scene, written
from benchmarks.foreign.visibility import nuisances, stacked, visibility
from benchmarks.foreign.waves import BeatPlan

ATTEMPTS = 20
"""Draws of a record before a truth counts as impossible."""


def assembled(
    generator: str,
    number: int,
    patient: ForeignPatient,
    form: EffectForm,
    plans: Mapping[str, BeatPlan],
    acquisition: Acquisition,
    solver: Solver,
    rng: np.random.Generator,
    *,
    background: dict | None = None,
    assumed: Mapping[str, BeatPlan] | None = None,
) -> ForeignRecord:
    """A record with its truth.

    Args:
        generator: name of the generator.
        number: of the record.
        patient: true parameters.
        form: the effect.
        plans: beats of each condition.
        acquisition: how it is recorded.
        solver: the generator's solver.
        rng: source of the noise.
        background: what the generator adds to the base model in all records.
        assumed: the beats without that, to size it as `background["lambda"]`.
    """
    members = [ForeignMember(patient, c, on) for on in (False, True) for c in patient.conditions]
    runs = solver(members, form, plans)
    seen = [see(run, m, form, acquisition) for run, m in zip(runs, members, strict=True)]
    names = [c.name for c in patient.conditions]
    without, with_ = (
        dict(zip(names, part, strict=True)) for part in (seen[: len(names)], seen[len(names) :])
    )
    fitted = [c.name for c in patient.conditions if not c.held_out]
    directions, usual = nuisances(patient, plans, acquisition, solver)

    def data(of: Mapping[str, Seen]) -> np.ndarray:
        return stacked([of[name] for name in fitted], usual, fitted, acquisition)

    visible = visibility(directions, data(with_) - data(without), stated_shift=form.stated_shift)
    background = dict(background or {})
    if assumed is not None:
        calm = [ForeignMember(patient, c, False) for c in patient.conditions if not c.held_out]
        none = EffectForm()
        plain = [
            see(run, m, none, acquisition)
            for run, m in zip(solver(calm, none, assumed), calm, strict=True)
        ]
        away = stacked(usual, usual, fitted, acquisition)
        away = away - stacked(plain, usual, fitted, acquisition)
        background["lambda"] = visibility(directions, away)
    truth = {
        "truth": form.effect,
        "form": form.form,
        "size": form.size,
        "place": form.place,
        "generator": generator,
        "lambda": visible,
        "background": background,
        "correlation_s": acquisition.correlation,
        "traces": {
            name: {
                "t": acquisition.times[name],
                "with": with_[name]._asdict(),
                "without": without[name]._asdict(),
            }
            for name in names
        },
    }
    name = f"record-{number:04d}"
    files = written(name, patient, with_, acquisition, form.stated_shift, rng)
    scene = Scene(patient, form, plans, acquisition, solver)
    return ForeignRecord(name, truth, files, scene)


def drawn(
    name: str,
    drawers: Mapping[str, Callable[[np.random.Generator], EffectForm]],
    with_form: Callable[[EffectForm, np.random.Generator, int], ForeignRecord],
    rng: np.random.Generator,
    number: int,
) -> ForeignRecord:
    """A record of a truth; drawn anew where no patient could have it, never for its visibility.

    Args:
        name: of the truth.
        drawers: what draws its form and size.
        with_form: what makes a record of that.
        rng: source of all numbers.
        number: of the record.

    Raises:
        RuntimeError: no patient could have any of the records drawn.
    """
    for _ in range(ATTEMPTS):
        try:
            record = with_form(drawers[name](rng), rng, number)
        except RuntimeError:  # the effect is too large for the solver
            continue
        if _plausible(record):
            return record
    raise RuntimeError(f"No patient could have '{name}' in {ATTEMPTS} draws. Draw smaller effects.")


def _plausible(record: ForeignRecord) -> bool:
    """Whether pressures and flows are those of a circulation, in all conditions."""
    for traces in record.truth["traces"].values():
        P, flow, ratio = (traces["with"][key] for key in ("P_distal", "mean_flow", "ffr"))
        if not (P.min() > -12.0 and P.max() < 300.0 and flow > 2.0 and 0.3 < ratio < 1.1):
            return False
    return True


def aligned_acquisition(
    patient: ForeignPatient, beats: int, samples: int, correlation: float
) -> Acquisition:
    """Whole equal beats from the start of ejection, with so many samples each."""
    count = np.arange(beats * samples) / samples
    times = {c.name: count * c.period for c in patient.conditions}
    return Acquisition(times, dict.fromkeys(times, 0.0), correlation, True)
