"""Small examples of documents: results of commands with their long lists cut.

    python -m tests.study.report.documents.example RESULT ...

writes `examples/KIND.json` from each result that `jaxfsi` wrote; what made it stands in its
provenance, files without their folders.
"""

import json
import pathlib
import sys
from typing import Any

FOLDER = pathlib.Path(__file__).with_name("examples")

_MOST_NUMBERS, _MOST_TABLES = 3, 2


def cut(value: Any) -> Any:
    """A document with at most three numbers and two tables of each list, files by name."""
    if isinstance(value, dict):
        parts = {name: cut(part) for name, part in value.items()}
        if "narrowest" in parts:  # a place in lists that are cut
            parts["narrowest"] = min(parts["narrowest"], _MOST_NUMBERS - 1)
        return parts
    if isinstance(value, str) and value.startswith("/"):
        return pathlib.PurePath(value).name
    if not isinstance(value, list):
        return value
    if all(isinstance(part, str) for part in value):
        return [cut(part) for part in value]
    nested = any(isinstance(part, dict) for part in value)
    return [cut(part) for part in value[: _MOST_TABLES if nested else _MOST_NUMBERS]]


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name in sys.argv[1:]:
        document = json.loads(pathlib.Path(name).read_text(encoding="utf-8"))
        text = json.dumps(cut(document), indent=1, ensure_ascii=False) + "\n"
        (FOLDER / f"{document['kind']}.json").write_text(text, encoding="utf-8")
