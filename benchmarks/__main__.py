"""Run all benchmarks: `python -m benchmarks [--out DIR] [--only NAME ...] [--rounds N]`."""

import argparse
import importlib
import pathlib
import sys
from typing import Any

from benchmarks.tables import machine, table, write_result
from lumped.whole_files import write_whole

BENCHMARKS = (
    "surrogate",
    "alpha",
    "vascular",
    "fits",
    "coverage",
    "posterior",
    "meshing",
    "verification",
    "wall",
    "slit",
    "steps",
    "published",
    "mesh_error",
)
LONG = (
    "devices",
    "sensitivity",
    "convergence",
    "wall_steps",
    "beats",
    "coverage_3d",
    "nozzle",
    "gpu",
    "patient_steps",
    "growth",
)
"""Run only where they are named: minutes to hours on two cores."""


def main() -> int:
    """Run the benchmarks, print their tables and write `NAME.json` and `benchmarks.md`.

    Returns:
        0; or 1 where an answer did not pass its gates.
    """
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("results/benchmarks"))
    parser.add_argument("--only", nargs="+", choices=(*BENCHMARKS, *LONG), default=BENCHMARKS)
    parser.add_argument("--rounds", type=int, default=5, help="timed calls of each function")
    parser.add_argument(
        "--preset", choices=("coarse", "medium", "fine"), default="medium", help="of meshing"
    )
    parser.add_argument("--problems", nargs="+", metavar="NAME", help="of verification; all")
    options = parser.parse_args()
    if options.problems:
        known = importlib.import_module("benchmarks.verification").PROBLEMS
        unknown = [name for name in options.problems if name not in known]
        if unknown:
            parser.error(f"--problems: {unknown[0]!r} is none of {', '.join(known)}")
    facts, results = machine(), []
    for name in options.only:
        print(f"running {name} ...", file=sys.stderr, flush=True)
        module, chosen = importlib.import_module(f"benchmarks.{name}"), _chosen(name, options)
        results.append(module.run(rounds=options.rounds, **chosen))
        write_result(options.out, name, results[-1], facts, _command(name, options.rounds, chosen))
    text = "\n\n".join([_heading(facts), *(table(result) for result in results)]) + "\n"
    print(text)
    write_whole(options.out / "benchmarks.md", text)
    return 0 if all(result.get("passed", True) for result in results) else 1


def _chosen(name: str, options: argparse.Namespace) -> dict[str, Any]:
    """Arguments that one benchmark alone takes."""
    if name == "meshing":
        return {"preset": options.preset}
    return {"problems": options.problems} if name == "verification" and options.problems else {}


def _command(name: str, rounds: int, chosen: dict[str, Any]) -> str:
    words = ["python -m benchmarks --only", name, "--rounds", str(rounds)]
    for option, value in chosen.items():
        words += [f"--{option}", *([value] if isinstance(value, str) else value)]
    return " ".join(words)


def _heading(facts: dict[str, Any]) -> str:
    told = ", ".join(f"{key} {value}" for key, value in facts.items())
    return (
        f"# Benchmarks\n\n{told}\n\nTimes in seconds; first_s includes compilation, the others "
        "are warm calls in turn. The machine may be shared: trust medians and ratios."
    )


if __name__ == "__main__":
    sys.exit(main())
