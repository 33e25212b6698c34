"""What the JSON files hold: one frozen dataclass a kind of document, and its JSON Schema.

The schemas of the present layout lie in ``study/data/schema``::

    python -m study.report.documents        write them again
"""

import importlib
import json
import pathlib
from collections.abc import Mapping
from typing import Any

from study.store.json_form import from_json, schema
from study.store.layouts import FORMAT, LAYOUT

KINDS = {
    "run": ("reduced", "RunDocument"),
    "calibrate": ("reduced", "CalibrateDocument"),
    "sweep": ("sweep", "SweepDocument"),
    "mesh": ("mesh", "MeshDocument"),
    "simulate": ("simulate", "SimulateDocument"),
    "wall": ("wall", "WallDocument"),
    "study": ("study", "StudyDocument"),
    "what-if": ("what_if", "WhatIfDocument"),
    "cohort": ("cohort", "CohortDocument"),
    "diagnose": ("diagnose", "DiagnoseDocument"),
    "plan": ("plan", "PlanDocument"),
}
"""Module and class of each kind of document, by what it says under `kind`."""


def document_type(kind: str) -> type:
    """The class of a kind of document.

    Args:
        kind: one of `KINDS`.
    """
    module, name = KINDS[kind]
    return getattr(importlib.import_module(f"{__name__}.{module}"), name)


def document_kinds() -> list[str]:
    """Kinds of documents that have a schema."""
    return list(KINDS)


def document_schema(kind: str) -> dict[str, Any]:
    """The JSON Schema of a kind of document.

    Args:
        kind: one of `KINDS`.
    """
    return schema(document_type(kind), f"{FORMAT} {kind}")


def schema_text(kind: str) -> str:
    """The JSON Schema of a kind of document as text."""
    return json.dumps(document_schema(kind), indent=1, ensure_ascii=False) + "\n"


def schema_path(kind: str) -> pathlib.Path:
    """Where the schema of a kind of document lies."""
    folder = pathlib.Path(__file__).parents[2] / "data" / "schema"
    return folder / f"{kind}-result-{LAYOUT}.json"


def typed(document: Mapping[str, Any]) -> Any:
    """A document as the class of its kind; keys that this does not have are left out.

    Args:
        document: of the present layout, see `study.store.stored_document.load_document`.

    Raises:
        KeyError: it is of no kind of `KINDS`.
        ValueError: a part is missing or of another type; which, and where.
    """
    return from_json(document_type(document["kind"]), document)
