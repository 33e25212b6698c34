"""Pictures, document and page of a study, and where they are written."""

import base64
import pathlib
from typing import Any

import numpy as np

from calibration.lumen_shape import lumen_surface
from jaxfsi.fields import read_series
from study.report.algorithm_figures import study_figures
from study.report.algorithm_results import Document, study_document
from study.report.page import rendered, safe
from study.report.simulation_pictures import (
    PICTURES,
    draw_film,
    draw_lumen,
    draw_simulation,
)
from study.report.simulation_results import SERIES_FILE, Drawn, embedded_pictures
from study.run.algorithm import LOOP, StudyResult, shown_runs
from study.run.openings import Inlet
from study.run.progress import Progress
from study.store.output import write_files
from study.store.result_files import STUDY_FILE, STUDY_PAGE
from study.store.result_files import STUDY_PICTURES as PICTURE_FOLDER
from study.store.stored_document import to_json

FILM_SUFFIX = "film.gif"


def write_study(
    result: StudyResult, provenance: dict[str, Any], progress: Progress
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
    document = study_document(result, drawn, list(films), provenance)
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
    return document, write_files(result.bench.folder, files, fill=fill)


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
    bench, shown = result.bench, shown_runs(result)
    moving = [run for run in shown if run["label"] == LOOP][-1:] or shown[-1:]
    for run in shown:
        name = run["folder"].split("/")[-1]
        wave = run["history"]
        inlet = Inlet(np.array(wave["t_s"]), np.array(wave["P_aorta_mmHg"]))
        series = bench.folder / run["folder"] / SERIES_FILE
        if not read_series(series):
            continue
        scene = (series, bench.mesh, result.anatomy, inlet, run["period_s"])
        drawn[name] = Drawn(*draw_simulation(*scene))
        if name in result.sensitivities:
            values = result.sensitivities[name].lumen * 1e-3  # per mm³
            surface = lumen_surface(bench.mesh)
            drawn[name].pictures.update(draw_lumen(bench.mesh, result.anatomy, surface, values))
        if run in moving and drawn[name].pictures:
            film = draw_film(*scene)
            if film is not None:
                films[name] = film
    return drawn, films
