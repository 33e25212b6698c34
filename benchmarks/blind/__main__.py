"""Make, diagnose, score: `python -m benchmarks.blind COMMAND DIR [options]`.

make      draw cases (--seed, --count, --kind, --tier, --offset, --noise) and seal what is wrong
diagnose  read the record folders alone, write `diagnoses-RICHNESS-NOISE.json` with its hash
score     open the labels and print every figure of one level, and every miss
grid      print one table over all levels that were diagnosed, write `grid.md` and `grid.png`
pool      for every effect, pool the ratios of --count patients who share it
rates     false alarms and causes named where a clock's rate does not divide the beat
follow    let the generator make the measurement that each diagnosis advises
sample    check probabilities of --count cases by sequential Monte Carlo
"""

import argparse
import hashlib
import json
import pathlib
import sys
import time

import numpy as np

from benchmarks.blind.advice import FLOWS
from benchmarks.blind.cases import OFFSET_SD_MMHG, TIERS, Cases, seal
from benchmarks.blind.cohorts import pool_cohorts
from benchmarks.blind.diagnoses import diagnose_folder
from benchmarks.blind.follow import followed
from benchmarks.blind.follow_table import follow_table
from benchmarks.blind.grid import grid_figure, grid_table
from benchmarks.blind.rates import rates_table
from benchmarks.blind.sample import sample_folder
from benchmarks.blind.score import Row, load, misses, score


def main() -> int:
    """Run one of the commands."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.blind",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = {"make": _make, "diagnose": _diagnose, "score": _score, "grid": _grid,
                "pool": _pool, "rates": _rates, "sample": _sample, "follow": _follow}  # fmt: skip
    parser.add_argument("command", choices=tuple(commands))
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--kind", choices=("single", "none", "pair", "outside"))
    parser.add_argument("--tier", type=int, choices=tuple(TIERS), default=1)
    parser.add_argument("--offset", type=float, default=OFFSET_SD_MMHG, help="slow offset [mmHg]")
    parser.add_argument("--noise", nargs="+", type=float, default=[0.5])
    parser.add_argument("--richness", nargs="+", default=["waveforms+flow"])
    parser.add_argument("--prior-scale", type=float, default=1.0)
    parser.add_argument("--first", type=int, help="diagnose or follow only so many cases")
    options = parser.parse_args()
    commands[options.command](options)
    return 0


def _make(options: argparse.Namespace) -> None:
    started = time.perf_counter()
    cases = Cases(
        options.seed, options.count, options.kind, tier=options.tier, offset=options.offset
    )
    for sd in options.noise:
        cases.write(options.folder / f"noise-{sd:g}", sd)
    truth = np.stack([cases.clean(k) for k in range(options.count)])
    np.save(options.folder / "held_out_truth.npy", truth)
    np.save(options.folder / FLOWS, cases.traces["Q"])
    seal(options.folder, cases.labels)
    print(f"{options.count} cases in {time.perf_counter() - started:.0f} s", file=sys.stderr)


def _diagnose(options: argparse.Namespace) -> None:
    for sd in options.noise:
        for richness in options.richness:
            started = time.perf_counter()
            rows = diagnose_folder(
                options.folder / f"noise-{sd:g}",
                richness,
                prior_scale=options.prior_scale,
                first=options.first,
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


def _opened(folder: pathlib.Path, level: str) -> list[Row]:
    rows = load(folder, level)
    for row in rows:
        sizes = list(row["label"]["sizes"])
        oracle = row["single_errors"].get(sizes[0]) if len(sizes) == 1 else None
        row["held_out"]["oracle"] = row["held_out"]["after"] if oracle is None else oracle
    return rows


def _score(options: argparse.Namespace) -> None:
    for sd in options.noise:
        for richness in options.richness:
            rows = _opened(options.folder, _level(options, richness, sd))
            print(f"## {richness}, {sd:g} mmHg, {len(rows)} cases\n\n| figure | value |\n|---|---|")
            for name, value in score(rows).items():
                print(f"| {name} | {value} |")
            print()
            for line in misses(rows):
                print(f"- {line}")
            print(flush=True)


def _grid(options: argparse.Namespace) -> None:
    found = sorted(options.folder.glob("diagnoses-*.json"))
    names = [path.stem.removeprefix("diagnoses-") for path in found]
    levels = {name: _opened(options.folder, name) for name in names}
    if not levels:
        raise SystemExit(f"{options.folder} holds no diagnoses. Run the command diagnose first.")
    table = grid_table(levels)
    print(table)
    (options.folder / "grid.md").write_text(table + "\n", encoding="utf-8")
    grid_figure(levels, options.folder / "grid.png")


def _pool(options: argparse.Namespace) -> None:
    print(pool_cohorts(options.folder, options.seed, options.count, options.richness[0]))


def _rates(options: argparse.Namespace) -> None:
    table = rates_table(options.folder, options.seed, options.count)
    print(table)
    (options.folder / "rates.md").write_text(table + "\n", encoding="utf-8")


def _follow(options: argparse.Namespace) -> None:
    found = followed(
        options.folder, options.richness, options.noise[0], options.first, options.seed
    )
    text = json.dumps(found)
    (options.folder / "follow.json").write_text(text, encoding="utf-8")
    table = follow_table(found)
    print(table)
    (options.folder / "follow.md").write_text(table + "\n", encoding="utf-8")


def _sample(options: argparse.Namespace) -> None:
    print(
        sample_folder(
            options.folder / f"noise-{options.noise[0]:g}", options.richness[0], options.count
        )
    )


if __name__ == "__main__":
    sys.exit(main())
