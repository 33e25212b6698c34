"""The report of a diagnosis: one HTML page that stands alone, made from the document."""

from collections.abc import Mapping
from typing import Any

from study.report.diagnosis_figures import diagnosis_figures
from study.report.diagnosis_lumen_figures import change_words
from study.report.page import rendered, safe


def diagnosis_report(document: Mapping[str, Any]) -> str:
    """The report of a diagnosis as HTML, its figures inside.

    Args:
        document: what `diagnosis_document` made, fresh or read back.
    """
    change = (document.get("lumen") or {}).get("change")
    return rendered(
        "diagnosis.html",
        d=document,
        fig=safe(diagnosis_figures(document)),
        lumen_words=change_words(change) if change else "",
    )
