"""The classes of inputs: how many of each a full run takes, and how they are made."""

import itertools
import json
import os
import pathlib
import tempfile
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from tests.fuzz import cases, geometry, processes, records, results, resumed, stored
from tests.fuzz.campaign import Run, Tally
from tests.fuzz.execute import STARTED
from tests.fuzz.trial import Trial

FULL = {"case": 600, "geometry": 250, "record": 150, "stored": 450, "kill": 20, "pair": 30}
RESUMED = 0.08
"""Share of the stored results that a command goes on from; `show` reads the others."""
NAMES = tuple(FULL)

Processes = Callable[
    [int, int, pathlib.Path, pathlib.Path | None, Callable[[str], None]],
    tuple[Tally, list[dict[str, Any]]],
]
PROCESSES: dict[str, Processes] = {"kill": processes.kills, "pair": processes.pairs}


def seed() -> int:
    """The seed of the environment, or the usual one."""
    return int(os.environ.get("JAXFSI_FUZZ_SEED", "19"))


def prepared(
    kind: str,
    count: int,
    number: int,
    folder: pathlib.Path,
    run: Run,
    tell: Callable[[str], None],
) -> tuple[dict[str, dict[str, Any]], Iterable[Trial]]:
    """Documents of the good inputs of a class, by name, and its trials."""
    if kind == "case":
        return documents(cases.good_trials(), run), cases.trials(count, number)
    if kind == "geometry":
        checked(geometry.good_trials(), run)
        return {}, geometry.trials(count, number)
    if kind == "record":
        checked(records.good_trials(), run)
        return {}, records.trials(count, number)
    place = results.good_results(folder, tell)
    again = round(RESUMED * count)
    shown = stored.trials(count - again, number, results.good_documents(place))
    going_on = resumed.trials(again, number, place)
    return resumed.good_documents(place), itertools.chain(shown, going_on)


def checked(trials: Iterator[tuple[str, Trial]], run: Run) -> None:
    """See that good inputs are accepted: that damaged ones are refused means nothing otherwise."""
    for name, trial in trials:
        with tempfile.TemporaryDirectory(prefix="fuzz-") as place:
            folder = pathlib.Path(place, "fuzz-here")
            trial.write(folder)
            outcome = run(trial.arguments(folder), folder, trial.stop, 900.0)
            if outcome.status not in (0, STARTED):
                raise RuntimeError(f"the good input {name} is refused: {outcome.stderr}")


def documents(trials: Iterator[tuple[str, Trial]], run: Run) -> dict[str, dict[str, Any]]:
    """What the command prints for good inputs."""
    found = {}
    for name, trial in trials:
        with tempfile.TemporaryDirectory(prefix="fuzz-") as place:
            folder = pathlib.Path(place, "fuzz-here")
            trial.write(folder)
            outcome = run(trial.arguments(folder), folder, (), 900.0)
            if outcome.status != 0:
                raise RuntimeError(f"the good input {name} is refused: {outcome.stderr}")
            found[name] = json.loads(outcome.stdout)
    return found
