"""Good results of every command that keeps some, made once and kept in a folder."""

import json
import os
import pathlib
import shutil
import subprocess
import sys
from collections.abc import Callable

from tests.fuzz.cases import bases
from tests.fuzz.records import csv, good
from tests.fuzz.solids import good_files
from tests.fuzz.toml_text import Tables, dumps

PROGRAM = "import sys; from study.cli.entry import main; sys.exit(main(sys.argv[1:]))"

STUDIED: Tables = {
    "patient": {"id": "tube"},
    "anatomy": {"kind": "mesh", "path": "mesh.vtu", "unit": "cm"},
    "condition": {
        "rest": {
            "P_systolic_mmHg": 110.0, "P_diastolic_mmHg": 65.0, "period_s": 0.8,
            "cardiac_output_l_per_min": 4.5, "ffr": 0.91,
        },
        "dobutamine": {"P_systolic_mmHg": 130.0, "P_diastolic_mmHg": 70.0, "period_s": 0.45},
    },
    "solver": {"dt_s": 2e-3, "checkpoint_every": 10},
}  # fmt: skip
FINISHED: Tables = {**STUDIED, "surrogate": {"R0_dyn_s_per_cm5": 5e3}}


def write_inputs(folder: pathlib.Path) -> None:
    """Inputs of all commands: `case.toml`, `tube.toml`, `studied.toml`, `record`, `cohort`."""
    folder.mkdir(parents=True, exist_ok=True)
    plain, _ = bases()["numbers"]
    (folder / "case.toml").write_text(dumps(plain))
    (folder / "tube.toml").write_text(dumps(FINISHED))
    (folder / "studied.toml").write_text(dumps(STUDIED))
    for name, data in good_files(".vtu").items():
        (folder / name).write_bytes(data)
    tables, rows = good()
    (folder / "record").mkdir(exist_ok=True)
    (folder / "record/record.toml").write_text(dumps(tables))
    for name, values in rows.items():
        (folder / "record" / name).write_text(csv(values))
    small = {key: plain[key] for key in ("patient", "condition", "surrogate")}
    for name, ffr in (("a", 0.93), ("b", 0.88)):
        (folder / "cohort" / name).mkdir(parents=True, exist_ok=True)
        rest = {**small["condition"]["rest"], "ffr": ffr}
        tables = {**small, "condition": {**small["condition"], "rest": rest}}
        tables["condition"]["dobutamine"] = {**small["condition"]["dobutamine"], "ffr": ffr - 0.03}
        (folder / "cohort" / name / "case.toml").write_text(dumps(tables))


COMMANDS: dict[str, tuple[str, ...]] = {
    "run": ("run", "case.toml", "--no-mesh"),
    "mesh": ("mesh", "tube.toml"),
    "simulate": ("simulate", "tube.toml", "--rigid", "--cycles", "0.04"),
    "diagnose": ("diagnose", "record"),
    "plan": ("plan-measurement", "record"),
    "cohort": ("cohort", "cohort", "--workers", "1"),
    "study": ("study", "studied.toml", "--quick", "--dt", "0.01"),
}
"""Commands of which results are kept."""

BEHIND: dict[str, tuple[str, ...]] = {"cohort": ("--", "--no-mesh")}


def start(
    arguments: tuple[str, ...], folder: pathlib.Path, log: pathlib.Path, cache: pathlib.Path
) -> "subprocess.Popen[bytes]":
    """Start a command in a folder, in a process group of its own."""
    environment = {**os.environ, "JAXFSI_CACHE_DIR": str(cache), "NPROC": "1"}
    with log.open("wb") as stream:
        return subprocess.Popen(
            [sys.executable, "-c", PROGRAM, *arguments],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=stream,
            stderr=stream,
            env=environment,
            start_new_session=True,
        )


def arguments_of(name: str, out: str) -> tuple[str, ...]:
    """The command that makes a result, with its folder for output."""
    return (*COMMANDS[name], "--out", out, *BEHIND.get(name, ()))


def good_results(
    folder: pathlib.Path, tell: Callable[[str], None], names: tuple[str, ...] = tuple(COMMANDS)
) -> pathlib.Path:
    """The folder of good results, each below its name; those that are missing are made."""
    place = folder / "results"
    write_inputs(place)
    for name in names:
        if (place / "out" / name).is_dir():
            continue
        tell(json.dumps({"preparing": name}))
        log = place / f"{name}.log"
        process = start(arguments_of(name, f"out/.{name}"), place, log, folder / "compiled")
        if process.wait() == 0:
            os.replace(place / "out" / f".{name}", place / "out" / name)
        else:
            tell(json.dumps({"no good result of": name, "said": log.read_text()[-800:]}))
            shutil.rmtree(place / "out" / f".{name}", ignore_errors=True)
    return place


DOCUMENTS = {
    "run": "result.json", "mesh": "mesh.json", "simulate": "simulation.json",
    "diagnose": "diagnosis.json", "plan": "plan.json", "cohort": "cohort.json",
    "study": "study.json",
}  # fmt: skip


def good_documents(place: pathlib.Path) -> dict[str, bytes]:
    """The stored documents by the name of their file."""
    paths = {file: place / "out" / name / file for name, file in DOCUMENTS.items()}
    return {file: path.read_bytes() for file, path in paths.items() if path.is_file()}
