"""Pictures, document and page of a study, drawn and written into its folder."""

import pathlib
from typing import Any

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
        drawing, filming = pool.submit(_drawn, result), pool.submit(_films, result)
        vessel = study_vessel(result)
        drawn = drawing.result()
        films = {name: film for name, film in filming.result().items() if drawn[name].pictures}
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


def _scenes(result: StudyResult) -> dict[str, tuple[Any, ...]]:
    """What of each calibrated run with frames is drawn."""
    found: dict[str, tuple[Any, ...]] = {}
    for run in result.calibrated:
        inlet = Inlet(np.array(run.history.t_s), np.array(run.history.P_aorta_mmHg))
        series = result.folder / run.folder / SERIES_FILE
        if read_series(series):
            found[run.id] = (series, result.mesh, result.anatomy, inlet, run.period_s)
    return found


def _drawn(result: StudyResult) -> dict[str, Drawn]:
    """Pictures of the calibrated runs."""
    drawn: dict[str, Drawn] = {}
    for name, scene in _scenes(result).items():
        drawn[name] = Drawn(*draw_simulation(*scene))
        if name in result.sensitivities:
            values = result.sensitivities[name].lumen * 1e-3  # per mm³
            surface = lumen_surface(result.mesh)
            lumen = draw_lumen(result.mesh, result.anatomy, surface, values)
            drawn[name].pictures.update(lumen)
    return drawn


def _films(result: StudyResult) -> dict[str, bytes]:
    """An animation of the last calibrated run under stress."""
    shown = result.calibrated
    moving = [run for run in shown if not run.is_rest][-1:] or shown[-1:]
    scenes = _scenes(result)
    films = {run.id: draw_film(*scenes[run.id]) for run in moving if run.id in scenes}
    return {name: film for name, film in films.items() if film is not None}
