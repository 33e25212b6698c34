"""Damage in a folder of results, and then the command that made them once more."""

import json
import pathlib
import random
from collections.abc import Iterator
from typing import Any

from study.store.stored_document import without_waveforms
from tests.fuzz.octets import BYTE_OPERATORS
from tests.fuzz.results import BEHIND, COMMANDS
from tests.fuzz.stored import structured
from tests.fuzz.trial import Content, Fifo, Files, Trial

KIND = "stored"
COMMANDS_THAT_GO_ON = ("simulate", "cohort", "study")
SMALL = 400_000


def folder_files(place: pathlib.Path) -> Files:
    return {
        str(path.relative_to(place)): path.read_bytes()
        for path in sorted(place.rglob("*"))
        if path.is_file() and path.stat().st_size < SMALL
    }


def trials(count: int, seed: int, place: pathlib.Path) -> Iterator[Trial]:
    """Damaged folders of results, commands and files in turn.

    Args:
        count: how many.
        seed: of the damage.
        place: folder of the good results.
    """
    rng = random.Random(f"resumed {seed}")
    inputs = {
        name: data for name, data in folder_files(place).items() if not name.startswith("out/")
    }
    names = [name for name in COMMANDS_THAT_GO_ON if (place / "out" / name).is_dir()]
    for k in range(count if names else 0):
        name = names[k % len(names)]
        made = folder_files(place / "out" / name)
        targets = sorted(file for file in made if wanted(file))
        target = rng.choice(targets)
        operator = rng.choice([*BYTE_OPERATORS, "missing", "another type", "another kind"])
        data = made[target]
        assert isinstance(data, bytes)
        content = _damaged(rng, operator, data)
        everything: Files = {**inputs, **{f"out/{file}": old for file, old in made.items()}}
        if content is None:
            del everything[f"out/{target}"]
        else:
            everything[f"out/{target}"] = content
        argv = tuple(f"{{}}/{x}" if x.endswith(".toml") or (x == "cohort" and i) else x
                     for i, x in enumerate(COMMANDS[name]))  # fmt: skip
        yield Trial(
            KIND, f"resume after {operator}", f"{name}: {target}", "either", everything,
            (*argv, "--json", "--out", "{}/out", *BEHIND.get(name, ())), like=f"{name} again",
            limit=300.0,
        )  # fmt: skip


def wanted(file: str) -> bool:
    """Whether a file is one that a later command reads."""
    return file.endswith((".json", ".npz", ".csv", ".pvd", ".at-work")) or file.startswith(
        "stages/"
    )


def _damaged(rng: random.Random, operator: str, data: bytes) -> Content | None:
    if operator == "missing":
        return None
    if operator in BYTE_OPERATORS:
        found = BYTE_OPERATORS[operator](rng, data or b"x")[0]
        return b"" if isinstance(found, Fifo) else found
    try:
        document = json.loads(data)
        changed = structured(rng, document, "word for a number", {})
    except (ValueError, IndexError, TypeError, AttributeError):
        changed = None
    return changed[0].encode() if changed else b"[]"


def good_documents(place: pathlib.Path) -> dict[str, Any]:
    """What the commands print in the end, by the name that trials refer to."""
    files = {"simulate": "simulation.json", "cohort": "cohort.json", "study": "study.json"}
    paths = {f"{name} again": place / "out" / name / file for name, file in files.items()}
    return {
        name: without_waveforms(json.loads(path.read_text()))
        for name, path in paths.items()
        if path.is_file()
    }
