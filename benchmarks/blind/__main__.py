"""Make, diagnose, score: `python -m benchmarks.blind make|diagnose|score DIR [options]`.

`make` needs --seed and --count; `diagnose` reads the record folders alone and writes
`diagnoses-RICHNESS-NOISE.json` with its hash; `score` opens the labels only then.
"""

import argparse
import hashlib
import json
import pathlib
import sys
import time

import numpy as np

from benchmarks.blind.cases import Cases, seal
from benchmarks.blind.diagnoses import diagnose_folder
from benchmarks.blind.score import load, misses, score


def main() -> int:
    """Run one of the three commands."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blind", description=__doc__)
    parser.add_argument("command", choices=("make", "diagnose", "score"))
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--kind", choices=("single", "none", "pair", "outside"))
    parser.add_argument("--noise", nargs="+", type=float, default=[0.5])
    parser.add_argument("--richness", nargs="+", default=["waveforms+flow"])
    parser.add_argument("--prior-scale", type=float, default=1.0)
    options = parser.parse_args()
    {"make": _make, "diagnose": _diagnose, "score": _score}[options.command](options)
    return 0


def _make(options: argparse.Namespace) -> None:
    started = time.perf_counter()
    cases = Cases(options.seed, options.count, options.kind)
    for sd in options.noise:
        cases.write(options.folder / f"noise-{sd:g}", sd)
    truth = np.stack([cases.clean(k) for k in range(options.count)])
    np.save(options.folder / "held_out_truth.npy", truth)
    seal(options.folder, cases.labels)
    print(f"{options.count} cases in {time.perf_counter() - started:.0f} s", file=sys.stderr)


def _diagnose(options: argparse.Namespace) -> None:
    for sd in options.noise:
        for richness in options.richness:
            started = time.perf_counter()
            rows = diagnose_folder(
                options.folder / f"noise-{sd:g}", richness, prior_scale=options.prior_scale
            )
            _add_truth(rows, options.folder)
            text = json.dumps(rows)
            path = options.folder / f"diagnoses-{_level(options, richness, sd)}.json"
            path.write_text(text, encoding="utf-8")
            digest = hashlib.sha256(text.encode()).hexdigest()
            spent = time.perf_counter() - started
            print(f"{path.name}: {len(rows)} cases in {spent:.0f} s, sha256 {digest}", flush=True)


def _level(options: argparse.Namespace, richness: str, sd: float) -> str:
    scaled = "" if options.prior_scale == 1.0 else f"-prior{options.prior_scale:g}"
    return f"{richness}-{sd:g}{scaled}"


def _add_truth(rows: list[dict], folder: pathlib.Path) -> None:
    """Held-out errors against the pressure without noise, in place of the predicted waves."""
    truth = np.load(folder / "held_out_truth.npy")
    for row in rows:
        clean = truth[row["case"]]
        waves = row.pop("held_out_waves")

        def error(wave: list[float], clean: np.ndarray = clean) -> float:
            step = len(wave) // clean.size
            return float(np.sqrt(np.mean((np.array(wave)[::step] - clean) ** 2)))

        row["held_out"] = {"before": error(waves["before"]), "after": error(waves["after"])}
        row["single_errors"] = {name: error(wave) for name, wave in waves["single"].items()}


def _score(options: argparse.Namespace) -> None:
    for sd in options.noise:
        for richness in options.richness:
            rows = load(options.folder, _level(options, richness, sd))
            for row in rows:
                sizes = list(row["label"]["sizes"])
                oracle = row["single_errors"].get(sizes[0]) if len(sizes) == 1 else None
                row["held_out"]["oracle"] = row["held_out"]["after"] if oracle is None else oracle
            print(f"## {richness}, {sd:g} mmHg, {len(rows)} cases\n\n| figure | value |\n|---|---|")
            for name, value in score(rows).items():
                print(f"| {name} | {value} |")
            print()
            for line in misses(rows):
                print(f"- {line}")
            print(flush=True)


if __name__ == "__main__":
    sys.exit(main())
