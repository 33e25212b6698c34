"""Foreign sets of blind records: make one, answer it, score answers.

    python -m benchmarks.foreign make OUT --generator NAME --records N --seed S
    python -m benchmarks.foreign answer OUT            diagnoses it: OUT/answers-diagnosis.json
    python -m benchmarks.foreign oracle OUT            answers of a method that knows the generator
    python -m benchmarks.foreign score OUT ... --method NAME
    python -m benchmarks.foreign compare OUT ... --methods NAME ...

Baselines answer from the base model's fit alone; two of them learn from own simulations:

    python -m benchmarks.foreign train FOLDER --records N --seed S
    python -m benchmarks.foreign answer OUT --method regime | boosted | amortised --training FOLDER

Another method enters by writing OUT/answers-NAME.json, see docs/benchmarks/foreign.md.
"""

import argparse
import importlib
import json
import pathlib
import sys
from typing import Any

import numpy as np

from benchmarks.foreign import GENERATORS, ForeignRecord
from benchmarks.foreign.answers import answer
from benchmarks.foreign.baselines import METHODS, answer_with, train_methods
from benchmarks.foreign.oracle import oracle
from benchmarks.foreign.score import comparison, joined, misses, table
from lumped.whole_files import write_whole


def make(out: pathlib.Path, generator: str, records: int, seed: int) -> None:
    """Write records, their labels and their noise-free traces.

    Args:
        out: folder that gets `records/NNNN/`, `labels.json` and `truth/NNNN.npz`.
        generator: a name of `GENERATORS`.
        records: how many.
        seed: of the set.

    Raises:
        FileExistsError: the folder holds labels of another set.
    """
    if (out / "labels.json").exists():
        raise FileExistsError(
            f"{out} holds labels of a set already. Name another folder or remove it."
        )
    module = importlib.import_module(f"benchmarks.foreign.{generator}")
    labels: dict[str, dict] = {}
    (out / "truth").mkdir(parents=True, exist_ok=True)
    for number in range(records):
        record: ForeignRecord = module.draw(seed, number)
        name = f"{number:04d}"
        record.write(out / "records" / name)
        _save(out / "truth" / f"{name}.npz", record)
        labels[name] = record.label
        if sys.stderr.isatty():
            print(f"\r{number + 1}/{records}", end="", file=sys.stderr, flush=True)
    content = {"generator": generator, "seed": seed, "records": labels}
    write_whole(out / "labels.json", json.dumps(content, indent=1) + "\n")


def _save(path: pathlib.Path, record: ForeignRecord) -> None:
    found: dict[str, Any] = {}
    for name, traces in record.truth["traces"].items():
        found[f"{name}/t"] = traces["t"].astype(np.float32)
        for which in ("with", "without"):
            for key, value in traces[which].items():
                found[f"{name}/{which}/{key}"] = np.asarray(value, np.float32)
    np.savez_compressed(path, **found)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.foreign",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    actions = parser.add_subparsers(dest="action", required=True)
    action = actions.add_parser("make", help="write records and their sealed labels")
    action.add_argument("out", type=pathlib.Path, help="new folder of the set")
    action.add_argument("--generator", choices=GENERATORS, required=True)
    action.add_argument("--records", type=int, default=150, help="how many (150)")
    action.add_argument("--seed", type=int, default=1, help="another one gives other records (1)")
    action = actions.add_parser("answer", help="diagnose a set, or answer it by a baseline")
    action.add_argument("out", type=pathlib.Path)
    action.add_argument("--records", type=int, help="only the first so many")
    action.add_argument("--method", choices=("diagnosis", *METHODS), default="diagnosis")
    action.add_argument("--training", type=pathlib.Path, help="what `train` has written")
    action = actions.add_parser("train", help="simulate what baselines learn from")
    action.add_argument("out", type=pathlib.Path)
    action.add_argument("--records", type=int, default=1000)
    action.add_argument("--seed", type=int, default=1)
    action = actions.add_parser("oracle", help="answer a set by its own generator")
    action.add_argument("out", type=pathlib.Path)
    action.add_argument("--draws", type=int, help="nodes that each branch of an effect starts with")
    action.add_argument("--records", type=int)
    action = actions.add_parser("score", help="score answers against the labels")
    action.add_argument("out", type=pathlib.Path, nargs="+")
    action.add_argument("--method", default="diagnosis", help="NAME of the answers (diagnosis)")
    action.add_argument("--misses", action="store_true", help="list every wrong answer")
    action = actions.add_parser("compare", help="score several methods, one column each")
    action.add_argument("out", type=pathlib.Path, nargs="+")
    action.add_argument("--methods", nargs="+", default=["diagnosis", "bic", "scan"])
    return parser


def main() -> int:
    """Do what the command line asks for.

    Returns:
        0; 2 where the request was refused.
    """
    options = _parser().parse_args()
    try:
        if options.action == "make":
            make(options.out, options.generator, options.records, options.seed)
        elif options.action == "train":
            train_methods(options.out, options.records, options.seed)
        elif options.action == "compare":
            print(comparison(options.out, options.methods))
        elif options.action == "answer" and options.method == "diagnosis":
            answer(options.out, options.records)
        elif options.action == "answer":
            answer_with(options.out, options.method, options.records, options.training)
        elif options.action == "oracle":
            oracle(options.out, options.draws, options.records)
        else:
            print(table(options.out, options.method))
            for folder in options.out if options.misses else ():
                print(*misses(joined(folder, options.method)), sep="\n")
    except (OSError, ImportError, ValueError) as error:
        print(f"refused: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
