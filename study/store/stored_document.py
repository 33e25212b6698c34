"""Documents as text and back: what the JSON files of all commands have in common."""

import json
import os
import pathlib
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from study.case.faults import CaseError, Fault
from study.store.layouts import FORMAT, LAYOUT, layout_of, to_present_layout
from study.store.result_files import (
    CALIBRATION_FILE,
    COHORT_FILE,
    DIAGNOSIS_FILE,
    MESH_FILE,
    PLAN_FILE,
    RESULT_FILE,
    SIMULATION_FILE,
    STUDY_FILE,
    SWEEP_FILE,
    WALL_FILE,
    WHAT_IF_FILE,
)
from study.store.stored_parts import Damage, Trail, last_read, parse

Document = dict[str, Any]

_Made = TypeVar("_Made")

LARGEST_SIZE = 2**26
"""Size beyond which a file is taken for something else [bytes]."""

_CURE = f"give a {RESULT_FILE} that jaxfsi wrote, or the folder that holds it"
_AGAIN = "run the command that made it again, or give a copy that was not changed"

_FILES = (
    COHORT_FILE,
    STUDY_FILE,
    RESULT_FILE,
    SIMULATION_FILE,
    DIAGNOSIS_FILE,
    PLAN_FILE,
    MESH_FILE,
    CALIBRATION_FILE,
    SWEEP_FILE,
    WALL_FILE,
    WHAT_IF_FILE,
)
"""Documents of a folder; where it holds more than one, the first is shown."""


def to_json(document: Mapping[str, Any]) -> str:
    """A document as JSON text; it refuses numbers that JSON does not have (NaN, infinity)."""
    return json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def without_waveforms(document: Document) -> Document:
    """The document without its long arrays: waveforms, histories, outlines of meshed lumens."""
    short = {n: part for n, part in document.items() if n not in ("waveforms", "history")}
    if document["kind"] == "study":
        runs = [{k: v for k, v in run.items() if k != "history"} for run in short["runs"]]
        return {**short, "runs": runs}
    if document["kind"] == "mesh":
        return {**short, "states": _without_outlines(short["states"])}
    mesh = short.get("mesh")
    if mesh and "states" in mesh:
        short["mesh"] = {**mesh, "states": _without_outlines(mesh["states"])}
    return short


def _without_outlines(states: Mapping[str, Document]) -> dict[str, Document]:
    return {
        name: {
            **entry,
            "sections": [
                {key: part for key, part in section.items() if key != "outlines"}
                for section in entry["sections"]
            ],
        }
        for name, entry in states.items()
    }


def load_document(path: str | os.PathLike[str]) -> Document:
    """Read a document that was written before.

    Args:
        path: the file, or the folder that holds `result.json`, `mesh.json`, `study.json`, ....

    Raises:
        CaseError: the file cannot be read, or is no document of this or an older layout.
    """
    file = _file_of(pathlib.Path(path))

    def refusal(problem: str) -> CaseError:
        return CaseError([Fault(file, "", None, problem, "", _CURE)])

    try:
        # a device or a pipe has no size, and no end
        if file.exists() and not file.is_file():
            raise refusal("no regular file")
        if file.stat().st_size > LARGEST_SIZE:
            raise refusal(f"larger than any result ({LARGEST_SIZE // 2**20} MiB)")
        document = parse(file.read_bytes(), Trail())
    except OSError as error:
        raise refusal(
            f"cannot be opened: {error.strerror or 'the system does not say why'}"
        ) from None
    except Damage as damage:
        raise refusal(f"the document is damaged: {damage}") from None
    layout = layout_of(document)
    if layout is None or layout < 1:
        raise refusal(f'no result of jaxfsi (its "format" is not "{FORMAT}" or an older one)')
    if layout > LAYOUT:
        problem = f'a newer version of jaxfsi wrote it (its "format" is "{document["format"]}")'
        cure = f"update jaxfsi; this version reads results up to {FORMAT!r}"
        raise CaseError([Fault(file, "", None, problem, "", cure)])
    to_present_layout(document, layout)
    return document


def readable(path: pathlib.Path, document: Document, use: Callable[[], _Made]) -> _Made:
    """What is made of a stored document; where that fails, the document is refused.

    Args:
        path: its file, or the folder that holds it.
        document: as `load_document` gives it.
        use: makes something of it, and nothing else than the document can make it fail.

    Raises:
        CaseError: a part of the document is missing or not what it should be.
    """
    try:
        return use()
    except (OSError, CaseError, MemoryError):
        raise
    except Exception as error:
        place = last_read(document)
        where = f"{place}, or a part below it," if place else "a part of it"
        problem = f"the result is damaged: {where} is missing or not what jaxfsi writes there"
        raise CaseError([Fault(_file_of(path), "", None, problem, "", _AGAIN)]) from error


def _file_of(path: pathlib.Path) -> pathlib.Path:
    if not path.is_dir():
        return path
    named = [path / name for name in _FILES if os.path.lexists(path / name)]
    regular = [file for file in named if file.is_file()]
    return (regular or named or [path / RESULT_FILE])[0]
