"""The document, the table and the page of the command `what-if`."""

import csv
import io
from collections.abc import Iterator, Mapping
from typing import Any

from study.case.model import Case
from study.case.operation import WORDS
from study.report.documents.parts import Note
from study.report.documents.what_if import WhatIfDocument
from study.report.number_formats import signed, significant
from study.report.page import rendered, safe
from study.report.ratio_limits import side
from study.report.what_if_figures import what_if_figures
from study.run.limits import FFR_GREY, FFR_THRESHOLD, REST_RATIO_THRESHOLD
from study.run.what_if_parts import OperatedLumen, OperatedRatio, WhatIf
from study.store.layouts import FORMAT
from study.store.provenance import Provenance

ALPHA_KEPT = (
    "alpha, the scale of the resistances of the bed, is tuned to the measured resting ratio before"
    " the operation and kept after it: an operation on the artery does not change the bed. What"
    " the bed does over months of better flow is not predicted"
)
IDEAL = (
    "the operation is idealised: round sections of the area of the artery beyond its intramural"
    " course, no scar, patch or struts, the same wall and the same pressures"
)


def what_if_document(found: WhatIf, case: Case, provenance: Provenance) -> WhatIfDocument:
    """The document of a what-if.

    Args:
        found: what it found.
        case: the case.
        provenance: where the result comes from.
    """
    return WhatIfDocument(
        format=FORMAT,
        kind="what-if",
        patient=case.id,
        operation=found.operation,
        diameter_mm=found.diameter_mm,
        mode=found.mode,
        law=found.law,
        rule=case.stress.rule,
        alpha=found.alpha,
        verdict=_verdict(found, case.stress.rule),
        before=found.before,
        after=found.after,
        ratios=found.ratios,
        notes=[Note("info", text) for text in (ALPHA_KEPT, IDEAL, *found.remarks)],
        provenance=provenance,
    )


def _verdict(found: WhatIf, rule: str) -> str:
    """The change of each ratio, by the case's own rule where it was run."""
    rules = {ratio.rule for ratio in found.ratios} - {None}
    own = rule if rule in rules else next(iter(rules), None)
    shown = [ratio for ratio in found.ratios if ratio.rule in (None, own)]
    told = "; ".join(_changed(ratio) for ratio in shown)
    told = f"{told[0].upper()}{told[1:]}"
    size = "" if found.diameter_mm is None else f" to {found.diameter_mm:g} mm"
    return f"{WORDS[found.operation]}{size}. {told}. alpha = {found.alpha:.4g} is kept."


def _changed(ratio: OperatedRatio) -> str:
    name = "resting Pd/Pa" if ratio.rule is None else f"FFR under {ratio.condition}"
    if ratio.after is None:
        return f"{name} {ratio.before:.3f} before; after it the lumen collapses"
    change = signed(ratio.after - ratio.before, 3)
    return f"{name} {ratio.before:.3f} before, {ratio.after:.3f} after ({change})"


def lumen_table(lumen: OperatedLumen) -> str:
    """Sections of one side as CSV."""
    out = io.StringIO()
    rows = csv.writer(out, lineterminator="\n")
    rows.writerow(["s_mm", "area_mm2", "major_axis_mm", "minor_axis_mm"])
    columns = (lumen.s_mm, lumen.area_mm2, lumen.major_axis_mm, lumen.minor_axis_mm)
    rows.writerows(zip(*columns, strict=True))
    return out.getvalue()


def what_if_report(document: Mapping[str, Any]) -> str:
    """The page of a what-if as HTML, its figures inside.

    Args:
        document: the document as JSON holds it, fresh or read back.
    """
    return rendered(
        "what_if.html",
        d=document,
        words=WORDS[document["operation"]],
        fig=safe(what_if_figures(document)),
        rows=list(_rows(document)),
        numbers=list(_numbers(document)),
    )


def _rows(document: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Ratios with their change and the side of their limit."""
    for ratio in document["ratios"]:
        rest = ratio["rule"] is None
        limit = (REST_RATIO_THRESHOLD, None) if rest else (FFR_THRESHOLD, FFR_GREY)
        after = ratio["after"]
        yield {
            **ratio,
            "name": "resting Pd/Pa" if rest else f"FFR, {ratio['condition']}",
            "change": None if after is None else after - ratio["before"],
            "sides": [side(ratio[when], *limit) for when in ("before", "after")],
        }


def _numbers(document: Mapping[str, Any]) -> Iterator[tuple[str, str, str, str]]:
    """Name, unit, and value before and after of what describes the artery."""
    sides = [document[name] for name in ("before", "after")]
    for name, unit, values, decimals in (
        ("length from ostium to outlet", "mm", [one["length_mm"] for one in sides], 1),
        ("least area", "mm²", [min(one["area_mm2"]) for one in sides], 2),
        ("least minor axis", "mm", [min(one["minor_axis_mm"]) for one in sides], 2),
    ):
        yield name, unit, f"{values[0]:.{decimals}f}", f"{values[1]:.{decimals}f}"
    for name, unit in (("R0", "dyn·s/cm⁵"), ("K", "dyn·s²/cm⁸")):
        yield name, unit, significant(sides[0][name], 4), significant(sides[1][name], 4)
