"""Pictures, document and page of a study, and where they are written."""

import base64
import pathlib
from typing import Any

import numpy as np

from jaxfsi.adjoint.lumen_shape import lumen_surface
from jaxfsi.fields import read_series
from jaxfsi.simulation.cycles import Inlet
from study.report.algorithm_figures import study_figures
from study.report.algorithm_results import study_document
from study.report.page import rendered, safe
from study.report.simulation_pictures import (
    PICTURES,
    draw_film,
    draw_lumen,
    draw_simulation,
)
from study.report.simulation_results import SERIES_FILE, Drawn, embedded_pictures
from study.run.progress import Progress
from study.run.study_result import StudyResult
from study.store.json_form import as_json
from study.store.output import write_files
from study.store.provenance import Provenance
from study.store.result_files import STUDY_FILE, STUDY_PAGE
from study.store.result_files import STUDY_PICTURES as PICTURE_FOLDER
from study.store.stored_document import to_json

Document = dict[str, Any]

FILM_SUFFIX = "film.gif"


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
    drawn, films = _drawn(result)
    progress.step("writing the report")
    document = as_json(study_document(result, drawn, list(films), provenance))
    pictures = {name: embedded_pictures(part) for name, part in drawn.items()}
    page = study_report(document, pictures, {n: film_text(c) for n, c in films.items()})

    def fill(part: pathlib.Path) -> None:
        place = part / PICTURE_FOLDER
        place.mkdir()
        for name, pictures in drawn.items():
            for key, content in pictures.pictures.items():
                (place / f"{name}-{key}.png").write_bytes(content)
        for name, content in films.items():
            (place / f"{name}-{FILM_SUFFIX}").write_bytes(content)

    files = {STUDY_PAGE: page, STUDY_FILE: to_json(document)}
    return document, write_files(result.folder, files, fill=fill)


def study_report(
    document: Document, pictures: dict[str, dict[str, str]], films: dict[str, str]
) -> str:
    """The report of a study as HTML, its figures inside.

    Args:
        document: what `study_document` made, fresh or read back.
        pictures: addresses of pictures by run and name.
        films: addresses of animations by run.
    """
    return rendered(
        "study.html",
        d=document,
        fig=safe(study_figures(document)),
        picture=pictures,
        film=films,
        captions=PICTURES,
    )


def stored_study_report(folder: pathlib.Path, document: Document) -> str:
    """The report of a stored study; pictures that are gone are left out."""
    place = folder / PICTURE_FOLDER
    pictures = {
        name: Drawn(
            {
                key: (place / f"{name}-{key}.png").read_bytes()
                for key in keys
                if (place / f"{name}-{key}.png").is_file()
            },
            [],
            None,
        )
        for name, keys in document["pictures"].items()
    }
    films = {
        name: film_text((place / f"{name}-{FILM_SUFFIX}").read_bytes())
        for name in document["films"]
        if (place / f"{name}-{FILM_SUFFIX}").is_file()
    }
    embedded = {name: embedded_pictures(part) for name, part in pictures.items()}
    return study_report(document, embedded, films)


def film_text(content: bytes) -> str:
    """An animation as the address of a picture."""
    return "data:image/gif;base64," + base64.b64encode(content).decode("ascii")


def _drawn(result: StudyResult) -> tuple[dict[str, Drawn], dict[str, bytes]]:
    """Pictures of the calibrated runs; an animation of the last one under stress."""
    drawn: dict[str, Drawn] = {}
    films: dict[str, bytes] = {}
    shown = result.calibrated
    moving = [run for run in shown if not run.is_rest][-1:] or shown[-1:]
    for run in shown:
        inlet = Inlet(np.array(run.history.t_s), np.array(run.history.P_aorta_mmHg))
        series = result.folder / run.folder / SERIES_FILE
        if not read_series(series):
            continue
        scene = (series, result.mesh, result.anatomy, inlet, run.period_s)
        drawn[run.id] = Drawn(*draw_simulation(*scene))
        if run.id in result.sensitivities:
            values = result.sensitivities[run.id].lumen * 1e-3  # per mm³
            surface = lumen_surface(result.mesh)
            lumen = draw_lumen(result.mesh, result.anatomy, surface, values)
            drawn[run.id].pictures.update(lumen)
        if run in moving and drawn[run.id].pictures:
            film = draw_film(*scene)
            if film is not None:
                films[run.id] = film
    return drawn, films
