"""What the JSON files hold: one frozen dataclass a kind of document, and its JSON Schema."""

import importlib
from typing import Any

from study.store.json_form import schema
from study.store.layouts import FORMAT

KINDS = {
    "study": ("study", "StudyDocument"),
}
"""Module and class of each kind of document, by what it says under `kind`."""


def document_schema(kind: str) -> dict[str, Any]:
    """The JSON Schema of a kind of document.

    Args:
        kind: one of `KINDS`.
    """
    module, name = KINDS[kind]
    document = getattr(importlib.import_module(f"{__name__}.{module}"), name)
    return schema(document, f"{FORMAT} {kind}")
