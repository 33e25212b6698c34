"""Results of benchmarks as stored documents and as Markdown tables.

A document holds one result and how it was found::

    {"benchmark": "alpha", "command": "python -m benchmarks --only alpha",
     "machine": {"date": ..., "commit": ..., "cpus": ..., "load": [...], "jax": ..., ...},
     "result": {"name": ..., "rows": [{column: value, ...}, ...], "notes": [...]}}

The pages of `docs/benchmarks` are made from such files.
"""

import importlib.metadata
import json
import os
import pathlib
import platform
import subprocess
from datetime import UTC, datetime
from typing import Any

import jax

from lumped.whole_files import write_whole

_PACKAGES = ("jax", "diffrax", "optimistix", "equinox", "numpy", "svzerod", "mmgpy",
             "netgen-mesher", "blackjax")  # fmt: skip


def machine() -> dict[str, Any]:
    """Date, commit, processor and versions of the packages that results depend on."""
    versions = {}
    for package in _PACKAGES:
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            versions[package] = "absent"
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False
    ).stdout.strip()
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "cpus": os.cpu_count(),
        "load": os.getloadavg(),
        "device": jax.devices()[0].device_kind,
        "python": platform.python_version(),
        "commit": commit,
        **versions,
    }


def write_result(
    folder: pathlib.Path,
    benchmark: str,
    result: dict[str, Any],
    facts: dict[str, Any],
    command: str,
) -> pathlib.Path:
    """Store one result as `BENCHMARK.json`.

    Args:
        folder: where; it is made if needed.
        benchmark: name of the benchmark.
        result: its name, rows and notes.
        facts: see `machine`.
        command: what repeats it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    document = {"benchmark": benchmark, "command": command, "machine": facts, "result": result}
    path = folder / f"{benchmark}.json"
    write_whole(path, json.dumps(document, indent=1) + "\n")
    return path


def table(result: dict[str, Any], *, level: int = 2) -> str:
    """A benchmark's rows as a Markdown table, its notes below.

    Args:
        result: its name, rows and notes.
        level: of the heading; 0 leaves it out.
    """
    columns = list(dict.fromkeys(key for row in result["rows"] for key in row))
    lines = [f"{'#' * level} {result['name']}", ""] if level else []
    lines += [
        "| " + " | ".join(columns) + " |",
        "|" + "---|" * len(columns),
    ]
    lines += [
        "| " + " | ".join(_cell(row.get(column, "")) for column in columns) + " |"
        for row in result["rows"]
    ]
    notes = result["notes"]
    lines += ["", *(f"- {note}" for note in ([notes] if isinstance(notes, str) else notes))]
    return "\n".join(lines)


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    text = f"{value:.3g}" if isinstance(value, float) else str(value)
    return text.replace("|", "\\|")
