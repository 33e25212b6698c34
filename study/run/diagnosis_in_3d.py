"""How far the gap shrinks in 3D: the calibrated model and the named effect, run in the FSI model.

Every condition of the record, fitted or held out, is run in 3D behind a finished study's geometry:
with the bed and the aortic pressure of the base model as calibrated to the record, and, where the
verdict names effects, with those of the named model (`diagnosis.boundary`). Sensors act on the
traces afterwards. Effects at the ostium need no adding: the 3D model has them. Runs are kept in the
output folder, so that the same command goes on where it was ended.
"""

import dataclasses
import math
import pathlib
import shutil
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from diagnosis import Diagnosis, Record, RecordedCondition, apply_effects, find_effect
from diagnosis.boundary import boundary_conditions, sensor_traces
from diagnosis.circuit import Circuit
from diagnosis.prediction import base_circuit, condition_settings, n_unknowns, selection
from diagnosis.shrink import measured_ratio
from diagnosis.verdict import Hypothesis
from lumped import MMHG
from study.case.condition import Condition
from study.case.faults import CaseError, Fault
from study.case.model import Case
from study.run.driven_beat import Drive, DrivenBeat, driven_beat, known_difference
from study.run.finished_study import FinishedStudy, finished_study
from study.run.gap_parts import ConditionGap, GapIn3D
from study.run.progress import Progress
from study.run.run_context import RunContext
from study.store.folder_lock import at_work
from study.store.options import DiagnoseOptions
from study.store.result_files import IN_3D_FOLDER as FOLDER

BEFORE, AFTER = "before", "after"


def study_in_3d(
    options: DiagnoseOptions, record: Record, progress: Progress
) -> FinishedStudy | None:
    """The finished study that --in-3d asks for; None where it was not asked for.

    Args:
        options: of the command `diagnose`.
        record: the record, for the names of its conditions.
        progress: told of the mesh.

    Raises:
        CaseError: --case names no finished study, or the record has no such condition.
    """
    if options.in_3d is None:
        return None
    check_in_3d(options, record)
    assert options.case is not None, "checked"
    return finished_study(options.case, progress)


def check_in_3d(options: DiagnoseOptions, record: Record) -> None:
    """Refuse conditions that the record does not have, and a missing study.

    Raises:
        CaseError: cause and cure.
    """
    known = [c.name for c in record.conditions]
    for name in options.in_3d or ():
        if name not in known:
            problem = f"there is no condition {name!r} to run in 3D"
            cure = f"choose from {', '.join(known)}"
            raise CaseError([Fault(options.record, "condition", None, problem, "", cure)])
    if options.case is None:
        cure = "add --case with the folder of a finished jaxfsi study"
        problem = "--in-3d needs the mesh of a finished study"
        raise CaseError([Fault(options.record, "", None, problem, "", cure)])


def gap_in_3d(
    record: Record,
    diagnosis: Diagnosis,
    study: FinishedStudy,
    chosen: Sequence[str],
    folder: pathlib.Path,
    progress: Progress,
) -> GapIn3D:
    """Run a record's conditions in 3D before and after the named effect.

    Args:
        record: the record.
        diagnosis: its diagnosis.
        study: a finished study of the same patient.
        chosen: names of the conditions to run; none for all.
        folder: of the results; runs go below it.
        progress: told of each run.

    Raises:
        RuntimeError: a run failed; cause and cure.
        KeyboardInterrupt: the user interrupted one; what was computed is kept.
    """
    context = _context(study, folder / FOLDER)
    named = diagnosis.judgement.named if diagnosis.judgement.verdict == "named" else ()
    models: dict[str, Hypothesis] = {BEFORE: ()} | (
        {AFTER: diagnosis.judgement.best} if named else {}
    )
    circuits = {label: circuits_of(diagnosis, model) for label, model in models.items()}
    run = [c.name for c in record.conditions if not chosen or c.name in chosen]
    names = [f"3D: {name}, {label}" for name in run for label in models]
    progress.plan({**dict.fromkeys(names, 120.0), "writing the report": 8.0})
    found = []
    for k, condition in enumerate(record.conditions):
        if condition.name not in run:
            continue
        entry = entry_of(context.case, condition)
        difference = known_difference(study.calibrated, entry)
        beats = {}
        for label, of_model in circuits.items():
            progress.step(f"3D: {condition.name}, {label}")
            boundary = boundary_conditions(of_model[k])
            drive = Drive(entry, boundary.bed, boundary.P_ostium, difference)
            with at_work(context.folder):
                beats[label] = driven_beat(context, f"{condition.name}-{label}", drive)
        own = {label: of_model[k] for label, of_model in circuits.items()}
        found.append(_compared(diagnosis, condition, k, own, beats))
    effects = [find_effect(diagnosis.effects, name) for name in named]
    return GapIn3D(
        study=study.context.folder.name,
        named=list(named),
        already_in_3d=[e.id for e in effects if e.place == "ostium"],
        at_the_boundary=[e.id for e in effects if e.place not in ("ostium", "sensor")],
        on_the_traces=[e.id for e in effects if e.place == "sensor"],
        conditions=found,
    )


def circuits_of(diagnosis: Diagnosis, hypothesis: Hypothesis) -> list[Circuit]:
    """The circuit of each condition at a fitted hypothesis, its effects at their sizes."""
    record, fitted = diagnosis.record, diagnosis.fits[hypothesis]
    cases, x = condition_settings(record), np.asarray(fitted.x)[: n_unknowns(record)]
    own = selection(record.n_conditions, 0) @ x
    effects = diagnosis.acting[hypothesis]
    names = [effect.id for effect in diagnosis.effects]
    sizes = jnp.asarray([float(fitted.sizes[names.index(effect.id)]) for effect in effects])
    circuits = []
    for k in range(record.n_conditions):
        case = jax.tree.map(lambda leaf, k=k: leaf[k], cases)
        base = base_circuit(case, jnp.asarray(own[k]))
        circuits.append(apply_effects(base, effects, sizes))
    return circuits


def entry_of(case: Case, condition: RecordedCondition) -> Condition:
    """A record's condition as one of the case: its own pressures, the case's cardiac output."""
    known = case.conditions.get(condition.name)
    return Condition(
        name=condition.name,
        kind="rest" if condition.drug == "none" else "stress",
        P_systolic=condition.P_systolic,
        P_diastolic=condition.P_diastolic,
        period=condition.period,
        cardiac_output=None if known is None else known.cardiac_output,
        stroke_volume=None if known is None else known.stroke_volume,
    )


def _context(study: FinishedStudy, folder: pathlib.Path) -> RunContext:
    """The context of the study with a folder of its own, and the prestress that the study found."""
    stages = folder / "stages"
    stages.mkdir(parents=True, exist_ok=True)
    for path in (study.context.folder / "stages").glob("prestress-*.npz"):
        if not (stages / path.name).exists():
            shutil.copy(path, stages)
    return dataclasses.replace(study.context, folder=folder)


def _compared(
    diagnosis: Diagnosis,
    condition: RecordedCondition,
    k: int,
    circuits: dict[str, Circuit],
    beats: dict[str, DrivenBeat],
) -> ConditionGap:
    """Gaps of one condition [mmHg]: surrogate and 3D, before and after."""
    record = diagnosis.record
    fits = {BEFORE: diagnosis.base, AFTER: diagnosis.best}
    waves = {
        "surrogate": {label: np.asarray(fits[label].waves)[k, :2] / MMHG for label in beats},
        "in_3d": {
            label: sensor_traces(circuits[label], beat.P_ostium * MMHG, beat.P_distal * MMHG) / MMHG
            for label, beat in beats.items()
        },
    }
    has_trace = record.n_sensors > 1 and np.isfinite(float(record.wave_sd[k, 1]))
    trace = np.asarray(record.waves[k, 1]) / MMHG if has_trace else None
    ratio = measured_ratio(diagnosis, k)

    def rms(wave: np.ndarray) -> float | None:
        return None if trace is None else float(np.sqrt(np.mean((wave[1] - trace) ** 2)))

    def off(wave: np.ndarray) -> float | None:
        return None if ratio is None else abs(float(wave[1].mean() / wave[0].mean()) - ratio)

    floor = None
    if has_trace:
        floor = math.hypot(float(record.wave_sd[k, 1]), float(record.wave_offset_sd[k, 1])) / MMHG
    target = np.asarray(circuits[BEFORE].P_inlet) / MMHG
    return ConditionGap(
        condition=condition.name,
        held_out=condition.held_out,
        P_distal_rms_mmHg={
            model: {label: rms(wave) for label, wave in of.items()} for model, of in waves.items()
        },
        ratio_error={
            model: {label: off(wave) for label, wave in of.items()} for model, of in waves.items()
        },
        noise_floor_mmHg=floor,
        P_ostium_rms_mmHg=float(np.sqrt(np.mean((beats[BEFORE].P_ostium - target) ** 2))),
        P_distal_mmHg={label: _rounded(wave[1]) for label, wave in waves["in_3d"].items()},
    )


def _rounded(wave: Sequence[float] | np.ndarray) -> list[float]:
    return [round(float(v), 4) for v in wave]
