"""The page of a cohort."""

from study.report.cohort_figures import cohort_figures, interval_figure
from study.report.cohort_rows import BOUNDARIES, limit_counts, pair_rows
from study.report.page import rendered, safe
from study.store.stored_document import Document


def cohort_report(document: Document) -> str:
    """The page of a cohort, its figures inside."""
    figures = safe(cohort_figures(document))
    intervals = safe({"intervals": interval_figure(document)})["intervals"]
    return rendered(
        "cohort.html", d=document, rows=pair_rows(document), counts=limit_counts(document),
        boundaries=BOUNDARIES, fig=figures, intervals=intervals,
    )  # fmt: skip
