"""Run all benchmarks: `python -m benchmarks [--out DIR] [--only NAME ...] [--rounds N]`."""

import argparse
import importlib
import importlib.metadata
import json
import os
import pathlib
import platform
import subprocess
import sys
from datetime import UTC, datetime
from typing import Any

import jax

from lumped.whole_files import write_whole

BENCHMARKS = (
    "surrogate",
    "alpha",
    "vascular",
    "fits",
    "coverage",
    "posterior",
    "meshing",
    "verification",
    "wall",
    "slit",
    "steps",
    "published",
    "mesh_error",
)
LONG = ("sensitivity", "convergence", "wall_steps", "beats", "coverage_3d")
"""Run only where they are named: half an hour and more on two cores."""


def main() -> int:
    """Run the benchmarks, print their tables and write `benchmarks.json` and `benchmarks.md`.

    Returns:
        0; or 1 where an answer did not pass its gates.
    """
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("results/benchmarks"))
    parser.add_argument("--only", nargs="+", choices=(*BENCHMARKS, *LONG), default=BENCHMARKS)
    parser.add_argument("--rounds", type=int, default=5, help="timed calls of each function")
    parser.add_argument(
        "--preset", choices=("coarse", "medium", "fine"), default="medium", help="of meshing"
    )
    options = parser.parse_args()
    results = []
    for name in options.only:
        print(f"running {name} ...", file=sys.stderr, flush=True)
        chosen = {"preset": options.preset} if name == "meshing" else {}
        module = importlib.import_module(f"benchmarks.{name}")
        results.append(module.run(rounds=options.rounds, **chosen))
    machine = _machine()
    text = "\n\n".join([_heading(machine), *(table(result) for result in results)]) + "\n"
    print(text)
    options.out.mkdir(parents=True, exist_ok=True)
    document = {"machine": machine, "results": results}
    write_whole(options.out / "benchmarks.json", json.dumps(document))
    write_whole(options.out / "benchmarks.md", text)
    return 0 if all(result.get("passed", True) for result in results) else 1


def table(result: dict[str, Any]) -> str:
    """A benchmark's rows as a Markdown table, its notes below."""
    columns = list(dict.fromkeys(key for row in result["rows"] for key in row))
    lines = [
        f"## {result['name']}",
        "",
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
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _machine() -> dict[str, Any]:
    packages = (
        "jax",
        "diffrax",
        "optimistix",
        "equinox",
        "numpy",
        "svzerod",
        "mmgpy",
        "netgen-mesher",
    )
    versions = {}
    for package in packages:
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


def _heading(machine: dict[str, Any]) -> str:
    facts = ", ".join(f"{key} {value}" for key, value in machine.items())
    return (
        f"# Benchmarks\n\n{facts}\n\nTimes in seconds; first_s includes compilation, the others "
        "are warm calls in turn. The machine may be shared: trust medians and ratios."
    )


if __name__ == "__main__":
    sys.exit(main())
