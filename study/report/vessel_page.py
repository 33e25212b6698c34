"""The interactive page of a vessel: one file that needs no network.

The program of the page is bundled from ``study/report/viewer/source`` by ``make viewer``.
"""

import importlib.resources
import json
from typing import Any

from markupsafe import Markup

from study.report.page import rendered
from study.report.vessel_colours import ABOVE, BELOW, MOVED, PRESSURE, WIDER, low_end
from study.report.vessel_data import VesselData
from study.store.json_form import as_json


def vessel_page(data: VesselData, report: str | None) -> str:
    """The page as HTML.

    Args:
        data: what it holds.
        report: name of the file beside it with all results; None: there is none.
    """
    held = as_json(data)
    for view in held["views"]:
        view.pop("picture")  # stands in the page itself
    return rendered(
        "vessel.html",
        v=data,
        report=report,
        wider=any(view.wider_per_mm3 is not None for view in data.views),
        data=_as_script(held),
        colours=_as_script(_colours(data)),
        bundle=Markup(_bundle()),
    )


def _bundle() -> str:
    place = importlib.resources.files("study.report") / "viewer" / "bundle.js"
    return place.read_text("utf-8")


def _colours(data: VesselData) -> dict[str, Any]:
    low = low_end(min(view.least_ratio for view in data.views), data.limit)
    return {
        "ratio": {"low": low, "below": BELOW, "colours": ABOVE},
        "pressure": PRESSURE,
        "moved": MOVED,
        "wider": WIDER,
    }


def _as_script(value: Any) -> Markup:
    """A value as JSON that may stand inside a script of a page."""
    text = json.dumps(value, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return Markup(text.replace("<", "\\u003c"))
