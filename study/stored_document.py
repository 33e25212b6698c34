"""Documents as text and back: what the JSON files of all commands have in common."""

import json
import pathlib
from collections.abc import Mapping
from typing import Any

from study.faults import CaseError, Fault
from study.result_files import (
    COHORT_FILE,
    DIAGNOSIS_FILE,
    MESH_FILE,
    PLAN_FILE,
    RESULT_FILE,
    SIMULATION_FILE,
    STUDY_FILE,
)

Document = dict[str, Any]

FORMAT = "jaxfsi 1"
"""Name and version of the layout; the version grows when a key changes its meaning."""

_FILES = (
    COHORT_FILE,
    STUDY_FILE,
    RESULT_FILE,
    SIMULATION_FILE,
    DIAGNOSIS_FILE,
    PLAN_FILE,
    MESH_FILE,
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


def load_document(path: pathlib.Path) -> Document:
    """Read a document that was written before.

    Args:
        path: the file, or the folder that holds `result.json`, `mesh.json`, `study.json`, ....

    Raises:
        CaseError: the file cannot be read, or is no document of this layout.
    """
    held = [path / name for name in _FILES if (path / name).is_file()]
    file = (held or [path / RESULT_FILE])[0] if path.is_dir() else path
    cure = f"give a {RESULT_FILE} that jaxfsi wrote, or the folder that holds it"

    def refusal(problem: str) -> CaseError:
        return CaseError([Fault(file, "", None, problem, "", cure)])

    try:
        document = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise refusal(f"cannot be opened: {error.strerror or error}") from None
    except (ValueError, RecursionError) as error:
        raise refusal(f"no JSON: {str(error)[:120]}") from None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise refusal(f'no result of this version (its "format" is not "{FORMAT}")')
    return document


def damaged(path: pathlib.Path, error: Exception) -> CaseError:
    """The refusal of a document in which a part is missing or not what it should be."""
    problem = f"a part of the result is missing or damaged: {error!r}"
    return CaseError([Fault(path, "", None, problem, "", "run the command again")])
