"""The page of a study."""

import pathlib
from collections.abc import Mapping
from typing import Any

from study.report.algorithm_figures import study_figures
from study.report.page import rendered, safe
from study.report.parameter_names import NAMES
from study.report.picture_captions import PICTURES
from study.report.pictures import stored_films, stored_study_pictures
from study.report.ratio_limits import SOURCES, limit_rows, measured_words
from study.report.uncertainty_figures import uncertainty_figure
from study.report.uncertainty_words import rules_words, uncertainty_rows, uncertainty_words

Document = Mapping[str, Any]


def study_report(
    document: Document,
    pictures: Mapping[str, Mapping[str, str]],
    films: Mapping[str, str],
    vessel: str | None = None,
) -> str:
    """The page of a study as HTML, its figures inside.

    Args:
        document: the document of the study as JSON holds it, fresh or read back.
        pictures: addresses of pictures by run and name.
        films: addresses of animations by run.
        vessel: name of the page of the vessel beside it; None: there is none.
    """
    return rendered(
        "study.html",
        d=document,
        fig=safe({**study_figures(document), "uncertainty": uncertainty_figure(document)}),
        uncertainty=uncertainty_rows(document),
        uncertainty_words=uncertainty_words(document),
        rules_words=rules_words(document),
        limits=limit_rows(document),
        limit_sources=SOURCES,
        measured_words=measured_words(document),
        called=NAMES,
        picture=pictures,
        film=films,
        captions=PICTURES,
        vessel=vessel,
    )


def stored_study_report(folder: pathlib.Path, document: Document, vessel: str | None = None) -> str:
    """The page of a stored study; pictures that are gone are left out."""
    pictures = stored_study_pictures(folder, document)
    return study_report(document, pictures, stored_films(folder, document), vessel)
