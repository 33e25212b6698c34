"""Commands that are killed, and commands that are at work in one folder at once."""

import dataclasses
import json
import os
import pathlib
import random
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable
from typing import Any

from tests.fuzz.campaign import Tally
from tests.fuzz.oracle import Breach, differences, numbers
from tests.fuzz.results import DOCUMENTS, FINISHED, arguments_of, start, write_inputs
from tests.fuzz.toml_text import dumps

Tell = Callable[[str], None]
Found = tuple[Tally, list[dict[str, Any]]]

SYNTHETIC = {
    "kind": "synthetic", "side": "right", "intramural_length_mm": 8.0, "ostium_minor_mm": 1.4,
    "ostium_major_mm": 2.9,
}  # fmt: skip
KILLS = (
    "cold mesh", "cohort", "diagnose", "run", "simulate", "calibrate", "sweep", "mesh", "run",
    "simulate",
)  # fmt: skip
PAIRS = ("calibrate", "run", "sweep", "calibrate", "mesh", "simulate")
HOURS = 3600.0


@dataclasses.dataclass(frozen=True)
class Command:
    """A command, the file it writes, and how one changes its input."""

    arguments: tuple[str, ...]
    document: str


def command(name: str, ffr: str = "") -> Command:
    """A command by name; with another case where `ffr` names one."""
    case = f"case{ffr}.toml"
    match name:
        case "cold mesh":
            return Command(
                ("mesh", "drawn.toml", "--preset", "coarse", "--out", "out"), "mesh.json"
            )
        case "calibrate":
            return Command(("calibrate", case, "--out", "out"), "calibration.json")
        case "sweep":
            alphas = "0.1:1:5" if not ffr else "0.1:2:5"
            return Command(("sweep", case, "--alpha", alphas, "--out", "out"), "sweep.json")
        case "run":
            return Command(("run", case, "--no-mesh", "--out", "out"), "result.json")
        case "mesh":
            unit = ("--unit", "mm") if ffr else ()
            return Command(("mesh", "tube.toml", *unit, "--out", "out"), "mesh.json")
        case "simulate":
            more = ("--alpha", "0.3") if ffr else ()
            words = ("simulate", "tube.toml", "--rigid", "--cycles", "0.04", *more, "--out", "out")
            return Command(words, "simulation.json")
    return Command(arguments_of(name, "out"), DOCUMENTS[name])


def inputs(folder: pathlib.Path) -> None:
    """Inputs of all commands, and a second case with another measured ratio."""
    write_inputs(folder)
    text = (folder / "case.toml").read_text()
    (folder / "case2.toml").write_text(text.replace("ffr = 0.91", "ffr = 0.84", 1))
    drawn = {key: FINISHED[key] for key in ("patient", "condition", "surrogate")}
    (folder / "drawn.toml").write_text(dumps({**drawn, "anatomy": SYNTHETIC}))


class Bench:
    """Runs commands undisturbed, once each, and keeps what they find and how long they take."""

    def __init__(self, folder: pathlib.Path):
        """Compiled code is kept in the folder, and meshes with it."""
        self.cache = folder / "compiled"
        self.known: dict[tuple[str, str], tuple[dict[str, Any], float]] = {}

    def undisturbed(self, name: str, ffr: str = "") -> tuple[dict[str, Any], float]:
        """What a command finds, and its seconds with compiled code."""
        if (name, ffr) not in self.known:
            with tempfile.TemporaryDirectory() as place:
                folder = pathlib.Path(place)
                inputs(folder)
                once = command(name, ffr)
                begun = time.monotonic()
                status, said = self.run(once, folder)
                if status != 0:
                    raise RuntimeError(f"{once.arguments} ends with {status}: {said[-500:]}")
                document = json.loads((folder / "out" / once.document).read_text())
                self.known[name, ffr] = document, time.monotonic() - begun
        return self.known[name, ffr]

    def run(self, once: Command, folder: pathlib.Path) -> tuple[int, str]:
        """Run a command to its end."""
        process = self.begin(once, folder, "log")
        return process.wait(timeout=HOURS), (folder / "log").read_text(errors="replace")

    def begin(self, once: Command, folder: pathlib.Path, log: str) -> "subprocess.Popen[bytes]":
        """Begin a command."""
        return start(once.arguments, folder, folder / log, self.cache)


def kills(
    count: int, seed: int, folder: pathlib.Path, out: pathlib.Path | None, tell: Tell
) -> Found:
    """Kill commands at random times, then give each once more."""
    bench, rng, tally = Bench(folder), random.Random(f"kill {seed}"), Tally("kill")
    findings: list[dict[str, Any]] = []
    for k in range(count):
        name = KILLS[k % len(KILLS)]
        _one(
            tally, findings, out, tell, k, name, lambda place, n=name: _killed(bench, rng, n, place)
        )
    return tally, findings


def _killed(
    bench: Bench, rng: random.Random, name: str, folder: pathlib.Path
) -> tuple[list[Breach], str]:
    good, seconds = bench.undisturbed(name)
    inputs(folder)
    if name == "cold mesh":  # meshes that were made are kept beside compiled code
        for path in bench.cache.rglob("*mesh*"):
            shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink()
    once, found = command(name), []
    earlier = rng.random() < 0.5
    if earlier:
        status, said = bench.run(once, folder)
        if status != 0:
            return [Breach("status", f"ends with {status}: {said[-300:]}")], "earlier"
    wait = rng.uniform(0.2, 1.1) * seconds
    process = bench.begin(once, folder, "killed")
    try:
        process.wait(timeout=wait)
    except subprocess.TimeoutExpired:
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    found += _left_over(process.pid)
    found += unreadable(folder / "out")
    if earlier and not holds(folder / "out", good):
        found.append(Breach("lost", "the earlier result is gone"))
    status, said = bench.run(once, folder)
    if status != 0:
        found.append(Breach("status", f"the same command ends with {status}: {said[-300:]}"))
    elif not (folder / "out" / once.document).is_file():
        found.append(Breach("lost", f"no {once.document}"))
    else:
        again = json.loads((folder / "out" / once.document).read_text())
        other = differing(good, again)
        if other:
            found.append(Breach("numbers", f"other numbers than undisturbed: {other[:3]}"))
    found += unreadable(folder / "out")
    return found, f"after {wait:.1f} of {seconds:.1f} s, earlier result: {earlier}"


def pairs(
    count: int, seed: int, folder: pathlib.Path, out: pathlib.Path | None, tell: Tell
) -> Found:
    """Two commands in one folder, at once or one soon after the other."""
    bench, rng, tally = Bench(folder), random.Random(f"pair {seed}"), Tally("pair")
    findings: list[dict[str, Any]] = []
    for k in range(count):
        name = PAIRS[k % len(PAIRS)]
        _one(
            tally, findings, out, tell, k, name, lambda place, n=name: _paired(bench, rng, n, place)
        )
    return tally, findings


def _paired(
    bench: Bench, rng: random.Random, name: str, folder: pathlib.Path
) -> tuple[list[Breach], str]:
    names = ("", "2" if rng.random() < 0.7 else "")
    goods = [bench.undisturbed(name, ffr) for ffr in names]
    inputs(folder)
    delay = rng.choice([0.0, 0.0, rng.uniform(0.0, 1.0)]) * goods[0][1]
    processes = []
    for k, ffr in enumerate(names):
        time.sleep(delay * k)
        processes.append(bench.begin(command(name, ffr), folder, f"log{k}"))
    statuses = [process.wait(timeout=HOURS) for process in processes]
    said = [(folder / f"log{k}").read_text(errors="replace") for k in range(2)]
    found = unreadable(folder / "out")
    for status, text in zip(statuses, said, strict=True):
        if "Traceback" in text:
            found.append(Breach("traceback", text[-400:]))
        if status not in (0, 2):
            found.append(Breach("status", f"ends with {status}: {text[-300:]}"))
        if status == 2 and "another" not in text:
            found.append(Breach("words", f"refused with: {text[-300:]}"))
    if 0 not in statuses:
        found.append(Breach("status", "both are refused"))
    for (document, _), status, ffr in zip(goods, statuses, names, strict=True):
        if status == 0 and not holds(folder / "out", document):
            found.append(Breach("lost", f"a result (case{ffr}) that ended with 0 is nowhere"))
    kind = "different" if names[1] else "equal"
    return found, f"{kind} inputs, {delay:.1f} s apart, ended with {statuses}"


def _one(
    tally: Tally,
    findings: list[dict[str, Any]],
    out: pathlib.Path | None,
    tell: Tell,
    number: int,
    name: str,
    run: Callable[[pathlib.Path], tuple[list[Breach], str]],
) -> None:
    with tempfile.TemporaryDirectory(prefix="fuzz-", ignore_cleanup_errors=True) as scratch:
        folder = pathlib.Path(scratch, "fuzz-here")
        folder.mkdir()
        breaches, how = run(folder)
        tally.count += 1
        tally.used[f"{tally.kind}\t{name}"] += 1
        tally.breaches.update({breach.severity for breach in breaches})
        if not breaches:
            return
        finding = {
            "class": tally.kind, "number": number, "severity": breaches[0].severity,
            "operator": name, "key": how, "expected": "same", "status": "",
            "breaches": [f"{b.severity}: {b.how}" for b in breaches], "stderr": "",
        }  # fmt: skip
        findings.append(finding)
        tell(json.dumps(finding, ensure_ascii=False))
        if out is not None:
            place = out / f"{tally.kind}-{number:04d}"
            shutil.rmtree(place, ignore_errors=True)
            shutil.copytree(folder, place, symlinks=True)


def _left_over(group: int) -> list[Breach]:
    """Processes of a group that are there ten seconds after its first one was killed."""
    for _ in range(20):
        try:
            os.killpg(group, 0)
        except (ProcessLookupError, PermissionError):
            return []
        time.sleep(0.5)
    os.killpg(group, signal.SIGKILL)
    return [Breach("cost", "a child is at work ten seconds after its parent was killed")]


def documents(folder: pathlib.Path) -> list[Any]:
    """All JSON documents below a folder."""
    found = []
    for path in folder.rglob("*.json"):
        try:
            found.append(json.loads(path.read_text()))
        except ValueError:
            continue
    return found


def unreadable(folder: pathlib.Path) -> list[Breach]:
    """JSON files below a folder that do not parse."""
    bad = []
    for path in folder.rglob("*.json"):
        try:
            json.loads(path.read_text())
        except ValueError:
            bad.append(Breach("lost", f"{path.name} does not parse"))
    return bad


def differing(good: Any, other: Any) -> list[str]:
    """Keys in which two documents differ, seconds and paths aside."""
    skipped = (
        "second", "wall_time", "files", "folder", "path", "written", "steps_per", "memory", "kept",
        "date", "resumed",
    )  # fmt: skip
    found = differences(numbers(good), numbers(other))
    return [text for text in found if not any(word in text.split(":")[0] for word in skipped)]


def holds(folder: pathlib.Path, document: dict[str, Any]) -> bool:
    """Whether a document with the same numbers lies anywhere below a folder."""
    return any(
        isinstance(other, dict)
        and other.get("kind") == document.get("kind")
        and not differing(document, other)
        for other in documents(folder)
    )
