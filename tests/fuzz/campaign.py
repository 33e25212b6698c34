"""Run the trials of a class, judge each, keep what breaks a promise."""

import collections
import dataclasses
import json
import pathlib
import shutil
import tempfile
from collections.abc import Callable, Iterable
from typing import Any

from tests.fuzz.execute import STARTED, Outcome, execute
from tests.fuzz.oracle import SEVERITIES, Breach, judged
from tests.fuzz.trial import Trial, tree

Run = Callable[[list[str], pathlib.Path, tuple[str, ...], float], Outcome]
"""Runs a command: arguments, folder, steps to stop at, seconds allowed."""


@dataclasses.dataclass
class Tally:
    """What became of the trials of a class."""

    kind: str
    count: int = 0
    refused: int = 0
    failed: int = 0
    accepted: int = 0
    slowest: float = 0.0
    largest_mb: float = 0.0
    breaches: collections.Counter[str] = dataclasses.field(default_factory=collections.Counter)
    used: collections.Counter[str] = dataclasses.field(default_factory=collections.Counter)

    def add(self, trial: Trial, outcome: Outcome, breaches: list[Breach]) -> None:
        """Count one trial."""
        self.count += 1
        self.refused += outcome.status == 2
        self.failed += outcome.status == 1
        self.accepted += outcome.status in (0, STARTED)
        if outcome.status in (1, 2):
            self.slowest = max(self.slowest, outcome.seconds)
            self.largest_mb = max(self.largest_mb, outcome.peak_mb)
        self.breaches.update({breach.severity for breach in breaches})
        self.used[f"{trial.operator}\t{trial.key}"] += 1

    def row(self) -> str:
        """One line of the table."""
        broken = "  ".join(f"{name} {self.breaches[name]}" for name in SEVERITIES)
        return (
            f"{self.kind:9s} {self.count:5d} trials  {self.refused:5d} refused  {self.failed:4d} "
            f"failed  {self.accepted:5d} accepted | {broken} | slowest {self.slowest:.1f} s, "
            f"largest {self.largest_mb:.0f} MB"
        )


def here(argv: list[str], cwd: pathlib.Path, stop: tuple[str, ...], limit: float) -> Outcome:
    """Runs a command in this process; for a few trials without a watch."""
    del cwd, limit
    return execute(argv, stop)


def campaign(
    kind: str,
    trials: Iterable[Trial],
    run: Run,
    out: pathlib.Path | None = None,
    good: dict[str, dict[str, Any]] | None = None,
    tell: Callable[[str], None] | None = None,
) -> tuple[Tally, list[dict[str, Any]]]:
    """Run trials one after another.

    Args:
        kind: the class.
        trials: damaged inputs.
        run: runs a command.
        out: folder that keeps the inputs of findings; None keeps none.
        good: documents of the good inputs, by name.
        tell: told each finding.

    Returns:
        The counts, and the findings, the worst first.
    """
    tally, findings = Tally(kind), []
    for number, trial in enumerate(trials):
        with tempfile.TemporaryDirectory(prefix="fuzz-", ignore_cleanup_errors=True) as name:
            folder = pathlib.Path(name, "fuzz-here")
            trial.write(folder)
            before = tree(folder)
            outcome = run(trial.arguments(folder), folder, trial.stop, trial.limit)
            after = tree(folder)
            changes = sorted(k for k in {**before, **after} if before.get(k) != after.get(k))
            expected = (good or {}).get(trial.like)
            breaches = judged(trial, outcome, changes, expected, folder)
            tally.add(trial, outcome, breaches)
            if breaches:
                finding = described(number, trial, outcome, breaches)
                findings.append(finding)
                if tell is not None:
                    tell(json.dumps(finding, ensure_ascii=False))
                if out is not None:
                    keep(out / f"{kind}-{number:04d}", folder, finding, trial, before)
    findings.sort(key=lambda finding: SEVERITIES.index(finding["severity"]))
    return tally, findings


def described(
    number: int, trial: Trial, outcome: Outcome, breaches: list[Breach]
) -> dict[str, Any]:
    """A finding as it is written down."""
    worst = min(breaches, key=lambda breach: SEVERITIES.index(breach.severity))
    return {
        "class": trial.kind,
        "number": number,
        "severity": worst.severity,
        "operator": trial.operator,
        "key": trial.key,
        "expected": trial.expected,
        "status": outcome.status,
        "breaches": [f"{breach.severity}: {breach.how}" for breach in breaches],
        "stderr": outcome.stderr[:600],
        "seconds": round(outcome.seconds, 2),
        "peak_mb": round(outcome.peak_mb),
    }


def keep(
    place: pathlib.Path,
    folder: pathlib.Path,
    finding: dict[str, Any],
    trial: Trial,
    before: dict[str, Any],
) -> None:
    """Keep the input of a finding, with the command that gets it."""
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    again = place / "input"
    trial.write(again)
    del before, folder
    command = " ".join(repr(word) for word in trial.arguments(again))
    text = json.dumps({**finding, "command": f"jaxfsi {command}"}, indent=1, ensure_ascii=False)
    (place / "finding.json").write_text(text, encoding="utf-8", errors="backslashreplace")
