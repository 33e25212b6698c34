"""Pictures, document and page of a study, drawn and written into its folder."""

import pathlib
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from jaxfsi.adjoint.lumen_shape import lumen_surface
from jaxfsi.fields import read_series
from jaxfsi.meshing.isolate import threads_of_children
from jaxfsi.simulation.cycles import Inlet
from study.report.algorithm_results import study_document
from study.report.pictures import Drawn, embedded_pictures, film_text, write_study_pictures
from study.report.simulation_pictures import draw_film, draw_lumen, draw_simulation
from study.report.study_report import study_report
from study.report.study_vessel import study_vessel, vessel_files, vessel_name
from study.run.progress import Progress
from study.run.study_result import StudyResult
from study.store.json_form import as_json
from study.store.output import write_files
from study.store.provenance import Provenance
from study.store.result_files import SERIES_FILE, STUDY_FILE, STUDY_PAGE
from study.store.stored_document import to_json

Document = dict[str, Any]

_RENDERERS = 2
"""Processes that draw at once: each takes one core and about 300 MB."""


def write_study(
    result: StudyResult, provenance: Provenance, progress: Progress
) -> tuple[Document, list[pathlib.Path]]:
    """Draw a study and write its document and page into its folder.

    Args:
        result: the study.
        provenance: see `study.store.provenance`.
        progress: told of each step.

    Returns:
        The document and the paths written.
    """
    progress.step("drawing")
    with threads_of_children(_RENDERERS) as pool:
        drawing = _drawing(result, pool)
        vessel = study_vessel(result)
        drawn, films = _drawn(drawing)
    progress.step("writing the report")
    document = as_json(
        study_document(result, drawn, list(films), provenance.took(progress.spent()))
    )
    pictures = {name: embedded_pictures(part.pictures) for name, part in drawn.items()}
    texts = {n: film_text(c) for n, c in films.items()}
    page = study_report(document, pictures, texts, vessel_name(vessel, "study"))
    shown = {**vessel_files(vessel, "study"), STUDY_PAGE: page}
    files = {**shown, STUDY_FILE: to_json(document)}
    written = write_files(
        result.folder, files, fill=lambda part: write_study_pictures(part, drawn, films)
    )
    return document, written


class _Drawing(NamedTuple):
    """Pictures of a run that processes of their own are drawing."""

    simulation: Future[tuple[dict[str, bytes], list[float], str | None]]
    lumen: Future[dict[str, bytes]] | None
    film: Future[bytes | None] | None


def _drawing(result: StudyResult, pool: ThreadPoolExecutor) -> dict[str, _Drawing]:
    """Pictures of the calibrated runs; an animation of the last one under stress."""
    drawing: dict[str, _Drawing] = {}
    shown = result.calibrated
    moving = [run for run in shown if not run.is_rest][-1:] or shown[-1:]
    for run in shown:
        inlet = Inlet(np.array(run.history.t_s), np.array(run.history.P_aorta_mmHg))
        series = result.folder / run.folder / SERIES_FILE
        if not read_series(series):
            continue
        scene = (series, result.mesh, result.anatomy, inlet, run.period_s)
        lumen = None
        if run.id in result.sensitivities:
            values = result.sensitivities[run.id].lumen * 1e-3  # per mm³
            surface = lumen_surface(result.mesh)
            lumen = pool.submit(draw_lumen, result.mesh, result.anatomy, surface, values)
        drawing[run.id] = _Drawing(
            pool.submit(draw_simulation, *scene),
            lumen,
            pool.submit(draw_film, *scene) if run in moving else None,
        )
    return drawing


def _drawn(drawing: dict[str, _Drawing]) -> tuple[dict[str, Drawn], dict[str, bytes]]:
    """The pictures and animations by run, once they are drawn."""
    drawn: dict[str, Drawn] = {}
    films: dict[str, bytes] = {}
    for name, of_run in drawing.items():
        drawn[name] = Drawn(*of_run.simulation.result())
        if of_run.lumen is not None:
            drawn[name].pictures.update(of_run.lumen.result())
        film = None if of_run.film is None else of_run.film.result()
        if film is not None:
            films[name] = film
    return drawn, films
