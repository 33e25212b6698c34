"""The document of the command `simulate`."""

import dataclasses
import pathlib

import numpy as np

from jaxfsi import Mesh, Region
from jaxfsi.core.step.model import Model
from jaxfsi.fields import read_series
from jaxfsi.opening import is_opening, is_segment
from jaxfsi.simulation import ShearMeans, StepHistory
from jaxfsi.simulation.cycles import CycleMeans, cycle_means
from lumped import ML_PER_MIN, MMHG
from study.case.model import Case
from study.report.body_words import body_notes, body_part, normal_bed_notes
from study.report.chosen_laws import chosen_laws, wall_without_columns
from study.report.documents.parts import Note
from study.report.documents.simulate import (
    CollapseNumbers,
    FailedStep,
    PortNumbers,
    ShearNumbers,
    SimulatedHistory,
    SimulatedMesh,
    SimulateDocument,
    SolverNumbers,
)
from study.report.pictures import Drawn
from study.run.simulation import solver_choice
from study.run.simulation_data import Outcome, Setup
from study.store.document_rows import ratio_name
from study.store.json_form import ABSENT, Absent, from_json
from study.store.layouts import FORMAT
from study.store.provenance import Provenance
from study.store.result_files import SERIES_FILE

_MOST_SAMPLES = 3000


def simulation_document(
    case: Case,
    condition: str,
    setup: Setup,
    outcome: Outcome,
    drawn: Drawn,
    folder: pathlib.Path,
    provenance: Provenance,
) -> SimulateDocument:
    """The document of the command."""
    plan, record = setup.schedule, outcome.record
    cycles = cycle_means(record, setup.model.names, plan.period)
    whole = [cycle for cycle in cycles if cycle.complete]
    name = ratio_name(condition)
    ratio = whole[-1].ratio if whole else None
    return SimulateDocument(
        format=FORMAT,
        kind="simulate",
        patient=case.id,
        condition=condition,
        rigid=setup.model.is_rigid,
        material=None if setup.model.is_rigid else case.wall.material,
        wall_element=None if setup.model.is_rigid else case.wall.element,
        ratio_name=name,
        rest_ratio=ratio if name == "rest_ratio" else ABSENT,
        ffr=ratio if name == "ffr" else ABSENT,
        measured=case.conditions[condition].ffr,
        failure=outcome.failure,
        collapse=_collapse(outcome),
        interrupted=outcome.interrupted,
        notes=_notes(case, condition, setup, outcome, cycles),
        period_s=plan.period,
        alpha=float(setup.outlets.alpha),
        alpha_origin=setup.outlets.alpha_origin,
        ports=_ports(setup.model),
        cycles=cycles,
        wall_shear=_shear(outcome.shear),
        mesh=_mesh(setup.mesh),
        solver=_solver(case, setup, outcome),
        events=[from_json(FailedStep, e, "an event of the run") for e in outcome.events],
        frames=len(read_series(folder / SERIES_FILE)),
        pictures=list(drawn.pictures),
        picture_times_s=drawn.times,
        picture_note=drawn.note,
        sources=case.source,
        remarks=case.notes,
        provenance=provenance,
        history=_history(record, setup.model.names),
        body=body_part(case),
    )


def _ports(model: Model) -> dict[str, PortNumbers]:
    """Kind and parameters of each opening."""
    ports = zip(model.names, model.ports, strict=True)
    return {name: port.summary() for name, port in ports if is_opening(name)}


def _collapse(outcome: Outcome) -> CollapseNumbers | Absent:
    found = outcome.collapse
    return ABSENT if found is None else CollapseNumbers(**dataclasses.asdict(found))


def _shear(means: ShearMeans | None) -> ShearNumbers | None:
    if means is None:
        return None
    return ShearNumbers(
        mean_tawss_dyn_per_cm2=means.mean_tawss,
        p99_tawss_dyn_per_cm2=means.tawss_above(0.01),
        mean_osi=means.mean_osi,
        duration_s=means.duration,
    )


def _mesh(mesh: Mesh) -> SimulatedMesh:
    counts = {r.name.lower(): int(np.sum(mesh.region == r)) for r in Region}
    return SimulatedMesh(len(mesh.points), counts, list(mesh.openings))


def _solver(case: Case, setup: Setup, outcome: Outcome) -> SolverNumbers:
    plan, record = setup.schedule, outcome.record
    n = record.n_steps
    done = round(float(record.step[-1])) if n else 0
    return SolverNumbers(
        dt_s=plan.dt,
        steps_planned=plan.n_steps,
        steps_per_cycle=plan.per_cycle,
        steps_done=done,
        steps_taken=n,
        resumed_from=outcome.resumed_from,
        seconds_per_step=outcome.pace,
        seconds=outcome.seconds,
        mean_iterations=float(record.n_gmres.mean()) if n else None,
        largest_iterations=int(record.n_gmres.max()) if n else None,
        largest_residual=float(record.residual.max()) if n else None,
        least_volume=float(record.min_volume_ratio.min()) if n else None,
        tolerance=solver_choice(case.solver).tolerance,
        change_limit=case.solver.change_limit,
    )


def _notes(
    case: Case, condition: str, setup: Setup, outcome: Outcome, cycles: list[CycleMeans]
) -> list[Note]:
    notes = []
    if outcome.failure:
        notes.append(("warning", outcome.failure))
    if outcome.collapse is not None:
        text = f"{outcome.collapse.sentence} The run ends there; what was before is kept."
        notes.append(("warning", text))
    if outcome.interrupted:
        notes.append(
            ("warning", "the run was interrupted; run the same command again to resume it")
        )
    if not any(cycle.complete for cycle in cycles):
        notes.append(
            ("warning", "no cycle is complete: means and ratio cover only part of the first")
        )
    if setup.schedule.n_steps < setup.schedule.per_frame:
        text = (
            f"the run of {setup.schedule.n_steps} steps ends before the first frame, at step"
            f" {setup.schedule.per_frame}: the fields are those of the start alone, and there is no"
            " wall shear; raise --cycles, or frames_per_cycle below [solver]"
        )
        notes.append(("warning", text))
    if outcome.events:
        text = f"steps repeated with smaller ones after a failure: {len(outcome.events)}"
        notes.append(("info", text))
    if not setup.model.is_rigid:
        P = case.conditions.get("rest", case.conditions[condition]).P_diastolic / MMHG
        text = (
            f"the imaged shape carries the diastolic pressure, {P:.0f} mmHg, as prestress of the"
            " wall"
        )
        if case.wall.prestress == "none":
            text = (
                f"the wall is taken to be free of stress at the diastolic pressure, {P:.0f} mmHg,"
                " which also acts on its outside"
            )
        notes.append(("info", text))
    notes += [("info", text) for text in chosen_laws(case, rigid=setup.model.is_rigid)]
    if not setup.model.is_rigid:
        notes += [("info", text) for text in wall_without_columns(case, setup.mesh)]
    if is_segment(setup.mesh.openings):
        text = (
            "a vessel without the aorta: the aortic pressure of the condition acts at its inlet,"
            " and the coronary bed of the case, times alpha, is attached to each outlet"
        )
        notes.append(("info", text))
    notes += body_notes(case)
    notes += normal_bed_notes(case, setup.mesh.openings, float(setup.outlets.alpha))
    if setup.outlets.alpha_origin.startswith("nominal"):
        notes.append(("info", f"alpha = 1, {setup.outlets.alpha_origin}"))
    return [Note(level, text) for level, text in notes]


def _history(record: StepHistory, names: tuple[str, ...]) -> SimulatedHistory:
    """Every step, or every so-manieth where there are many."""
    some = slice(None, None, max(1, -(-record.n_steps // _MOST_SAMPLES)))

    def numbers(values: np.ndarray) -> list[float]:
        return [float(f"{value:.6g}") for value in values[some].tolist()]

    openings = {name: i for i, name in enumerate(names) if is_opening(name)}
    return SimulatedHistory(
        ports=list(openings),
        t_s=numbers(record.t),
        dt_s=numbers(record.dt),
        P_mmHg={name: numbers(record.P_port[:, i] / MMHG) for name, i in openings.items()},
        Q_ml_per_min={
            name: numbers(record.Q_port[:, i] / ML_PER_MIN) for name, i in openings.items()
        },
        n_linear=record.n_gmres[some].tolist(),
        residual=numbers(record.residual),
        change=numbers(record.change),
        least_volume=numbers(np.minimum(record.min_volume_ratio, 1e9)),
    )
