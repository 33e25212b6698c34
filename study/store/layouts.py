"""Documents of older layouts, brought to the present one.

| layout | what changed |
|---|---|
| 1 | the first |
| 2 | `provenance.options` holds the options; runs of a study have an `id`, `loop.run` names one |
"""

from typing import Any

LAYOUT = 2
"""The present layout; it grows when a key is added that is relied on, or changes its meaning."""

_NAME = "jaxfsi "

FORMAT = f"{_NAME}{LAYOUT}"
"""What a document says under `format`."""


def layout_of(document: Any) -> int | None:
    """Number of the layout of a document; None where it is no document of this program."""
    name = document.get("format") if isinstance(document, dict) else None
    if not isinstance(name, str) or not name.startswith(_NAME):
        return None
    number = name.removeprefix(_NAME)
    return int(number) if number.isascii() and number.isdigit() and len(number) < 5 else None


def to_present_layout(document: dict[str, Any], layout: int) -> None:
    """Bring a document to the present layout; parts that are damaged stay as they are.

    Options are not added: a document of layout 1 does not say them.

    Args:
        document: as it was read.
        layout: its own, at most the present one.
    """
    if layout < 2:
        _to_2(document)
    document["format"] = FORMAT


def _to_2(document: dict[str, Any]) -> None:
    if document.get("kind") != "study":
        return
    runs, shown, loop = (document.get(key) for key in ("runs", "shown", "loop"))
    for run in runs if isinstance(runs, list) else ():
        if isinstance(run, dict) and isinstance(run.get("folder"), str):
            run.setdefault("id", run["folder"].rsplit("/", 1)[-1])
    if isinstance(loop, dict) and isinstance(shown, list) and shown:
        loop.setdefault("run", shown[0])
