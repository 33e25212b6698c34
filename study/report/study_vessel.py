"""The interactive page of the vessel, of a study and of a single run."""

import pathlib
from collections.abc import Iterator

import numpy as np

from jaxfsi.anatomy import Anatomy
from jaxfsi.simulation.cycles import cycle_means
from study.case.model import Case
from study.report.vessel_data import VesselData
from study.report.vessel_page import vessel_page
from study.report.vessel_scene import ShownRun, vessel_data, wall_words
from study.run.results import Run3D
from study.run.simulation_data import Outcome, Setup
from study.run.study_result import StudyResult
from study.store.document_rows import ratio_name
from study.store.json_form import Absent, as_json
from study.store.result_files import (
    SERIES_FILE,
    SIMULATION_PAGE,
    SIMULATION_VESSEL_DATA,
    SIMULATION_VESSEL_PAGE,
    STUDY_PAGE,
    STUDY_VESSEL_DATA,
    STUDY_VESSEL_PAGE,
)
from study.store.result_names import NOMINAL
from study.store.stored_document import to_json

VESSEL_FILES = {
    "study": (STUDY_VESSEL_PAGE, STUDY_VESSEL_DATA, STUDY_PAGE),
    "simulate": (SIMULATION_VESSEL_PAGE, SIMULATION_VESSEL_DATA, SIMULATION_PAGE),
}
"""Page of the vessel, its data, and the page with all results, by kind of result."""


def study_vessel(result: StudyResult) -> VesselData | None:
    """What the page of a study holds; None where no run has frames."""
    return vessel_data(result.case.id, result.mesh, result.anatomy, _runs(result))


def _runs(result: StudyResult) -> Iterator[ShownRun]:
    """Runs with the nominal outlet, then those with the calibrated one; stress after rest."""
    calibrated = {run.id for run in result.calibrated}
    for run in sorted(result.runs, key=lambda r: r.id in calibrated):
        if run.ratio is None or not (run.id in calibrated or run.label == NOMINAL):
            continue
        yield ShownRun(
            id=run.id,
            condition=run.condition,
            rule=run.rule,
            outlet=_outlet_words(run.alpha),
            wall=wall_words(result.case, rigid=False),
            ratio_name=ratio_name(run.condition),
            measured=result.case.conditions[run.condition].ffr,
            cycle=run.cycles[-1],
            ratio=run.ratio,
            period=run.period_s,
            series=result.folder / run.folder / SERIES_FILE,
            site=_site(run),
            wider=result.sensitivities[run.id].lumen if run.id in result.sensitivities else None,
        )


def _outlet_words(alpha: float) -> str:
    return f"alpha = {alpha:.4g}"


def _site(run: Run3D) -> tuple[np.ndarray, np.ndarray] | None:
    t, P = run.history.t_site_s, run.history.P_site_mmHg
    if isinstance(t, Absent) or isinstance(P, Absent):
        return None
    return np.array(t), np.array(P)


def simulation_vessel(
    case: Case,
    condition: str,
    setup: Setup,
    outcome: Outcome,
    anatomy: Anatomy | None,
    series: pathlib.Path,
) -> VesselData | None:
    """What the page of a single run holds.

    Args:
        case: the case.
        condition: name of the condition.
        setup: what the run started from.
        outcome: what it left.
        anatomy: what its mesh was made of; None where that is not known.
        series: PVD file of its frames.

    Returns:
        None where there are no frames, or no distal outlet.
    """
    period = setup.schedule.period
    cycles = cycle_means(outcome.record, setup.model.names, period)
    shown = [cycle for cycle in cycles if cycle.complete][-1:] or cycles[:1]
    if not shown or shown[0].ratio is None:
        return None
    run = ShownRun(
        id=condition,
        condition=condition,
        rule=None,
        outlet=_outlet_words(float(setup.outlets.alpha)),
        wall=wall_words(case, rigid=setup.model.is_rigid),
        ratio_name=ratio_name(condition),
        measured=case.conditions[condition].ffr,
        cycle=shown[0],
        ratio=shown[0].ratio,
        period=period,
        series=series,
    )
    return vessel_data(case.id, setup.mesh, anatomy, [run])


def vessel_files(data: VesselData | None, kind: str) -> dict[str, str]:
    """The page of a vessel and its data as texts by name of file; none where there is none.

    Args:
        data: what it holds.
        kind: of the result.
    """
    if data is None:
        return {}
    return {**vessel_pages(data, kind), VESSEL_FILES[kind][1]: to_json(as_json(data))}


def vessel_pages(data: VesselData | None, kind: str) -> dict[str, str]:
    """The page alone; the same arguments."""
    if data is None:
        return {}
    page, _, report = VESSEL_FILES[kind]
    return {page: vessel_page(data, report)}


def vessel_name(data: VesselData | None, kind: str) -> str | None:
    """Name of the page of a vessel, for a link to it; None where there is none."""
    return None if data is None else VESSEL_FILES[kind][0]
