"""Run the fuzz test: `python -m tests.fuzz --class case --count 600 --seed 7 --out DIR`."""

import argparse
import json
import os
import pathlib
import sys
import tempfile
from typing import Any

from tests.fuzz import classes
from tests.fuzz.campaign import Tally, campaign
from tests.fuzz.execute import Outcome
from tests.fuzz.oracle import SEVERITIES
from tests.fuzz.worker import Worker


def main() -> int:
    """Run the classes asked for, print a table; exit status 1 where a promise is broken."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--class", dest="kinds", action="append", choices=classes.NAMES)
    parser.add_argument("--count", type=int, help="default: that of the full run")
    parser.add_argument("--seed", type=int, default=classes.seed())
    parser.add_argument("--out", type=pathlib.Path, help="keeps findings and their inputs")
    parser.add_argument("--only", help="operators that contain this")
    options = parser.parse_args()
    if options.out is not None:
        options.out = options.out.resolve()
        options.out.mkdir(parents=True, exist_ok=True)
    tallies, findings = [], []
    with tempfile.TemporaryDirectory() as scratch:
        folder = pathlib.Path(os.environ.get("JAXFSI_FUZZ_GOOD", scratch))
        for kind in options.kinds or classes.NAMES:
            count = options.count or classes.FULL[kind]
            tally, found = run_class(kind, count, options, folder)
            tallies.append(tally)
            findings += found
            print(tally.row(), flush=True)
    findings.sort(key=lambda finding: SEVERITIES.index(finding["severity"]))
    if options.out is not None:
        lines = [json.dumps(finding, ensure_ascii=False) for finding in findings]
        path = options.out / "findings.jsonl"
        path.write_text("\n".join(lines) + "\n", encoding="utf-8", errors="backslashreplace")
        used = [f"{t.kind}\t{n}\t{what}" for t in tallies for what, n in sorted(t.used.items())]
        text = "\n".join(["class\tcount\toperator\tkey", *used]) + "\n"
        path = options.out / "coverage.tsv"
        path.write_text(text, encoding="utf-8", errors="backslashreplace")
    return 1 if findings else 0


def run_class(
    kind: str, count: int, options: argparse.Namespace, folder: pathlib.Path
) -> tuple[Tally, list[dict[str, Any]]]:
    """One class of inputs."""

    def tell(line: str) -> None:
        print(line.encode("utf-8", "backslashreplace").decode(), file=sys.stderr, flush=True)

    if kind in classes.PROCESSES:
        return classes.PROCESSES[kind](count, options.seed, folder, options.out, tell)
    environment = {"JAXFSI_CACHE_DIR": str(folder / "compiled")}
    with Worker(environment) as worker:

        def run(argv: list[str], cwd: pathlib.Path, stop: tuple[str, ...], limit: float) -> Outcome:
            return worker.run(argv, cwd, stop, limit)

        good, trials = classes.prepared(kind, count, options.seed, folder, run, tell)
        if options.only:
            trials = (trial for trial in trials if options.only in trial.operator)
        return campaign(kind, trials, run, options.out, good, tell)


if __name__ == "__main__":
    sys.exit(main())
