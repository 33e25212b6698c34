"""One beat at rest and under dobutamine of twenty drawn anatomies whose walls bend.

The anatomies of `benchmarks.meshing`, drawn from the published distributions, with pressures and
rates as `benchmarks.virtual_cohort` draws them. Each is the command `jaxfsi simulate` on a coarse
mesh with steps of 3 ms and α from the reduced model: a run must end its beat, or end in a collapse
that is reported with its time and place. Where the slit of an elastic wall snaps, faster than any
step resolves, the beat is run again with the viscosity that the message asks for: 2 ms times
Young's modulus. A run that was interrupted goes on in its folder.
"""

import json
import pathlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from benchmarks.meshing import EACH, SEED
from benchmarks.virtual_cohort import artery_law, case_text, draw_conditions
from jaxfsi.anatomy import sample_anatomies
from jaxfsi.anatomy.sources.parameters import SyntheticParameters

CONDITIONS = ("rest", "dobutamine")
MEASURED = {"rest": 0.93, "adenosine": 0.88, "dobutamine": 0.85}
_CARDIAC_OUTPUT = {"adult": 5.6, "paediatric": 4.2}
_DT = 3e-3
_VISCOSITY = 3e4
"""2 ms times 1.5 MPa [poise]."""


def run(rounds: int = 1, folder: pathlib.Path | None = None) -> dict[str, Any]:
    """Run every beat once.

    Args:
        rounds: not used: a beat is run once.
        folder: where runs are kept; a temporary one if it is not given.

    Returns:
        {"name", "rows", "notes", "passed"}, ready for JSON.
    """
    del rounds
    rows = kept_in(folder, _rows)
    return {
        "name": "beats",
        "rows": rows,
        "notes": [
            "status: exit status of `jaxfsi simulate --preset coarse --dt 3e-3 --cycles 1`.",
            "repeated: steps that failed and were taken in halves; least_volume: of the most"
            " squeezed element of blood over its reference; elastic: why the wall had to be given"
            " viscosity.",
        ],
        "passed": all("ratio" in row and (row["status"] == 0 or row["collapse"]) for row in rows),
    }


def kept_in(
    folder: pathlib.Path | None, make: Callable[[pathlib.Path], list[dict[str, Any]]]
) -> list[dict[str, Any]]:
    """Rows whose runs are kept in a folder, or in a temporary one if it is not given."""
    if folder is not None:
        return make(folder)
    with tempfile.TemporaryDirectory() as place:
        return make(pathlib.Path(place))


def _rows(folder: pathlib.Path) -> list[dict[str, Any]]:
    rows = []
    for name, text in cases():
        for condition in CONDITIONS:
            rows.append(beat(name, folder / name, text, condition))
            print(f"  {rows[-1]}", file=sys.stderr, flush=True)
    return rows


def beat(name: str, place: pathlib.Path, text: str, condition: str) -> dict[str, Any]:
    """One beat, with viscosity where the elastic wall snaps."""
    elastic = {"anatomy": name} | _ran(place, text, condition)
    if "snaps" not in elastic["why"]:
        return elastic
    viscous = text.replace("[wall]\n", f"[wall]\ndamping_poise = {_VISCOSITY:g}\n")
    found = _ran(place / "viscous", viscous, condition)
    return {"anatomy": name} | found | {"elastic": elastic["why"]}


def cases() -> Iterator[tuple[str, str]]:
    """Name and case file of each anatomy."""
    for side in ("left", "right"):
        for k, age in enumerate(("adult", "paediatric")):
            drawn = sample_anatomies((SEED, k), EACH, side=side, age=age)
            for number, parameters in enumerate(drawn, start=1):
                name = f"{side}-{age}-{number}"
                generator = np.random.default_rng([SEED, k, number, side == "left"])
                yield name, _case(name, parameters, generator, _CARDIAC_OUTPUT[age])


def _case(
    name: str, parameters: SyntheticParameters, generator: np.random.Generator, output: float
) -> str:
    conditions = draw_conditions(generator)
    for condition, entry in conditions.items():
        entry["ffr"] = MEASURED[condition]
    conditions["rest"]["cardiac_output_l_per_min"] = output
    law = artery_law(parameters)
    return case_text(
        {
            "id": name,
            "anatomy": parameters,
            "law": (float(law.R0), float(law.K)),
            "conditions": conditions,
        }
    )


def _ran(place: pathlib.Path, text: str, condition: str) -> dict[str, Any]:
    place.mkdir(parents=True, exist_ok=True)
    (place / "case.toml").write_text(text, encoding="utf-8")
    out = place / condition
    start = time.perf_counter()
    start_up = "import sys; from study.cli.entry import main; sys.exit(main())"
    command = [sys.executable, "-c", start_up, "simulate", str(place / "case.toml")]
    command += ["--condition", condition, "--preset", "coarse", "--dt", str(_DT), "--cycles", "1"]
    ended = subprocess.run([*command, "--out", str(out)], capture_output=True, check=False)
    row: dict[str, Any] = {"condition": condition, "status": ended.returncode}
    row["total_s"] = time.perf_counter() - start
    file = out / "simulation.json"
    if not file.is_file():
        lines = ended.stderr.decode(errors="replace").strip().splitlines()
        return row | {"collapse": "", "why": lines[-1] if lines else ""}
    document = json.loads(file.read_text(encoding="utf-8"))
    collapse = document.get("collapse")
    return row | {
        "collapse": json.dumps(collapse) if collapse else "",
        "why": document.get("failure") or "",
        "ratio": document.get("ffr") or document.get("rest_ratio"),
        "repeated": len(document["events"]),
        "iterations": document["solver"]["mean_iterations"],
        "least_volume": document["solver"]["least_volume"],
    }
