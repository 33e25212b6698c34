"""Arguments of each command, as the classes of its options and the keys of a case declare them."""

import argparse
import pathlib
from collections.abc import Callable

from diagnosis.richness import RICHNESS
from study.case.operation import WORDS
from study.case.parameters import MeshOptions, SolverOptions
from study.case.schema import Quantity, Word, keys_of
from study.cli.argument_values import (
    alpha_range,
    count,
    document_kind,
    executor,
    formats,
    names,
    positive,
    schema_kinds,
)
from study.cli.command_names import ON_CASES
from study.cli.import_arguments import import_arguments
from study.cli.request import (
    CacheOptions,
    CheckOptions,
    CompletionOptions,
    DoctorOptions,
    ImportOptions,
    ShowOptions,
    TemplateOptions,
)
from study.run.executor_choice import SLURM_OPTIONS
from study.run.limits import MOST_DRAWN
from study.store.options import (
    KINDS,
    CohortOptions,
    DiagnoseOptions,
    Options,
    PlanOptions,
)
from study.store.result_files import MESH_FORMATS as FORMATS

SHELLS = ("bash", "zsh", "fish")
"""Shells that a completion script is made for."""

OPTIONS: dict[str, type[Options]] = {
    **{name: KINDS["wall" if name == "calibrate-wall" else name] for name in ON_CASES},
    "cohort": CohortOptions,
    "diagnose": DiagnoseOptions,
    "plan-measurement": PlanOptions,
    "import-record": ImportOptions,
    "show": ShowOptions,
    "template": TemplateOptions,
    "check": CheckOptions,
    "doctor": DoctorOptions,
    "cache": CacheOptions,
    "completion": CompletionOptions,
}
"""Class of the options of each command."""


def add_arguments(name: str, command: argparse.ArgumentParser) -> None:
    """Add the arguments of a command to its parser.

    Args:
        name: of the command.
        command: its parser.
    """
    if name in ON_CASES:
        what = command.add_mutually_exclusive_group(required=True)
        what.add_argument("case", nargs="?", type=pathlib.Path, help="case file", metavar="CASE")
        what.add_argument("--demo", action="store_true", help="use the bundled patient")
    if name in _ADD:
        _ADD[name](command)


def _sweep_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--alpha",
        type=alpha_range,
        required=True,
        metavar="FROM:TO:N",
        help="N values of alpha from FROM to TO, in equal ratios; e.g. 0.01:10:200",
    )
    command.add_argument("--condition", default="rest", metavar="NAME", help="default: rest")
    command.add_argument("--rule", help="stress rule: printed, all, or factors of the case")


def _template_arguments(command: argparse.ArgumentParser) -> None:
    kinds = command.add_mutually_exclusive_group()
    kinds.add_argument(
        "--record", action="store_true", help="a measured record, with an example of its traces"
    )
    kinds.add_argument("--csv", action="store_true", help="a table of many patients, for cohort")
    command.add_argument(
        "--schema", action="store_true", help="the JSON Schema of the file instead, for editors"
    )


def _check_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "cases", nargs="+", type=pathlib.Path, metavar="CASE", help="case file, or record's folder"
    )


def _cache_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument("action", choices=("info", "clear"), help="say what is kept, or remove it")
    command.add_argument("--yes", action="store_true", help="remove without asking")


def _completion_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument("shell", choices=SHELLS, help="for which the script is")


def _record_arguments(command: argparse.ArgumentParser) -> None:
    case = "case file or finished study that R0 is taken from"
    command.add_argument("record", type=pathlib.Path, metavar="RECORD", help="folder of the record")
    command.add_argument("--case", type=pathlib.Path, metavar="CASE", help=case)


def _diagnose_arguments(command: argparse.ArgumentParser) -> None:
    _record_arguments(command)
    command.add_argument(
        "--richness", choices=RICHNESS, help="use no more of the record; default: all"
    )
    command.add_argument(
        "--in-3d",
        nargs="*",
        metavar="CONDITION",
        help="measure the gap in 3D as well, in these conditions (default: all), with the mesh of "
        "the finished study of --case",
    )


def _wall_arguments(command: argparse.ArgumentParser) -> None:
    _key_arguments(command, MeshOptions, "preset")
    command.add_argument(
        "--fit",
        nargs="+",
        metavar="STATE",
        help="states to fit; default: two; others are predicted",
    )
    command.add_argument(
        "--free",
        nargs="+",
        choices=("aorta", "coronary", "septum", "support", "thickness"),
        help="what is fitted; default: all but the thickness",
    )
    command.add_argument(
        "--course",
        type=positive(100.0),
        default=10.0,
        metavar="MM",
        help="length from the ostium that is compared; default: 10",
    )
    command.add_argument(
        "--contour-error",
        type=positive(1.0),
        default=0.05,
        metavar="X",
        help="relative standard deviation of a contour's area and minor axis; default: 0.05",
    )


def _run_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--mesh", action=argparse.BooleanOptionalAction, help="make a coarse mesh as well"
    )
    command.add_argument(
        "--uncertainty", action="store_true", help="give each FFR an interval, with its causes"
    )


def _mesh_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--state", nargs="+", metavar="NAME", help="states to mesh, or all; default: the first"
    )
    _key_arguments(command, MeshOptions)
    command.add_argument(
        "--format",
        type=formats,
        default=("vtu",),
        metavar="NAMES",
        help=f"some of {','.join(FORMATS)}; folder is mesh-complete; default: vtu",
    )


def _key_arguments(command: argparse.ArgumentParser, model: type, *chosen: str) -> None:
    """Options that stand for keys of a case, as these declare them; by default all of a table."""
    for key in keys_of(model):
        flag = f"--{key.name.replace('_', '-')}"
        if chosen and key.name not in chosen:
            continue
        told = key.text if key.default is None else f"{key.text}; default: {key.default}"
        if isinstance(key, Word):
            command.add_argument(flag, choices=key.options, help=told)
        elif isinstance(key, Quantity) and key.whole:
            read = count(int(key.low), int(key.high))
            help_ = f"{told}; {key.low:g} to {key.high:g}"
            command.add_argument(flag, type=read, metavar="N", help=help_)
        elif isinstance(key, Quantity):
            read, unit = positive(key.high), key.unit.upper() or "X"
            command.add_argument(flag, type=read, metavar=unit, help=told)


def _simulation_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument("--rigid", action="store_true", help="a wall that does not move")
    command.add_argument("--condition", default="rest", metavar="NAME", help="default: rest")
    command.add_argument("--state", metavar="NAME", help="state of the anatomy; default: the first")
    _key_arguments(command, MeshOptions, "preset")
    _key_arguments(command, SolverOptions, "dt")
    command.add_argument(
        "--cycles",
        type=positive(1000.0),
        metavar="N",
        help="heart cycles, may be a fraction; default: cycles of [solver], else 4",
    )
    command.add_argument(
        "--alpha",
        type=positive(1e6),
        metavar="X",
        help="scale of the anomalous outlet's resistances; default: tuned to the resting ratio, or"
        " 1 where that is not possible",
    )
    command.add_argument(
        "--restart",
        action="store_true",
        help="start anew; files of an earlier run in the folder move to earlier-1, earlier-2, ...",
    )


def _study_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--uncertainty",
        nargs="?",
        const=0,
        type=count(0, MOST_DRAWN),
        metavar="RUNS",
        help="give each FFR an interval, with its causes; RUNS further runs in 3D of each condition"
        f" say how well 0D follows 3D: 0 to {MOST_DRAWN}, default: 0",
    )
    command.add_argument(
        "--mesh-error",
        action=argparse.BooleanOptionalAction,
        help="make the ramp on a second mesh as well, which says how far the mesh moves R0, flow"
        " and FFR; default: unless --quick",
    )
    _key_arguments(command, MeshOptions, "preset")
    _key_arguments(command, SolverOptions, "dt")
    command.add_argument(
        "--cycles",
        type=count(1, 100),
        metavar="N",
        help="of each run; default: cycles of [solver], else 1, and 1 with --quick",
    )
    command.add_argument(
        "--continued", action="store_true", help="start each stress run from the end of rest"
    )
    command.add_argument(
        "--rules", type=names, metavar="NAMES", help="stress rules, such as printed,all"
    )
    command.add_argument(
        "--conditions", type=names, metavar="NAMES", help="under stress; default: all of the case"
    )
    command.add_argument("--nominal", action="store_true", help="also run with alpha = 1")
    command.add_argument(
        "--sensitivities",
        type=names,
        metavar="NAMES",
        help="conditions whose ratio in 3D is differentiated with respect to parameters and lumen,"
        " such as dobutamine; with rest among them, also with alpha tuned again; five to ten runs"
        " each",
    )
    command.add_argument(
        "--paper",
        action=argparse.BooleanOptionalAction,
        help="also run rest with the alpha of the linear surrogate; default: unless --quick",
    )
    command.add_argument(
        "--ramp-rate", type=positive(1e4), metavar="R", help="mmHg/s; default: 37.5, the paper's"
    )
    command.add_argument(
        "--quick",
        action="store_true",
        help="coarse mesh, steps of 3 ms, a ramp of 150 mmHg/s, dobutamine alone",
    )


def _what_if_arguments(command: argparse.ArgumentParser) -> None:
    what = command.add_mutually_exclusive_group(required=True)
    for kind in ("unroof", "reimplant"):
        told = WORDS[kind].partition(": ")[2]
        what.add_argument(
            f"--{kind}", dest="operation", action="store_const", const=kind, help=told
        )
    what.add_argument(
        "--stent",
        nargs="?",
        const=0.0,
        type=positive(10.0),
        metavar="DIAMETER_MM",
        help="the intramural course round; default: as wide as the artery beyond it",
    )
    command.add_argument("--mode", choices=("0d", "3d"), default="0d", help="0D or 3D; default: 0d")
    command.add_argument(
        "--from",
        dest="study",
        type=pathlib.Path,
        metavar="DIR",
        help="in 3D, the finished study of the case before the operation; default: it is made",
    )
    _key_arguments(command, MeshOptions, "preset")
    command.add_argument(
        "--quick", action="store_true", help="in 3D, coarse mesh and long steps, as for study"
    )


def _show_arguments(command: argparse.ArgumentParser) -> None:
    what = command.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "result", nargs="?", type=pathlib.Path, metavar="RESULT", help="its file or folder"
    )
    what.add_argument(
        "--schema",
        type=document_kind,
        metavar="KIND",
        help=f"a JSON Schema instead: of a result, case or record; {', '.join(schema_kinds())}",
    )
    command.add_argument(
        "--beside",
        nargs="+",
        default=(),
        type=pathlib.Path,
        metavar="DIR",
        help="results of study or simulate for the same patient, such as with another wall, that"
        " the interactive page can be switched to; with --out",
    )


def _cohort_arguments(command: argparse.ArgumentParser) -> None:
    what = command.add_mutually_exclusive_group(required=True)
    told = "folder of cases, or a CSV file with a row for each patient"
    what.add_argument("folder", nargs="?", type=pathlib.Path, help=told, metavar="DIR")
    what.add_argument("--demo", action="store_true", help="use the bundled virtual cohort")
    command.add_argument(
        "--mode", choices=("curve", "3d"), default="curve", help="curve: 0D, 3d: 3D; default: curve"
    )
    command.add_argument(
        "--workers", type=count(1, 1024), metavar="N", help="cases at a time; default: one per core"
    )
    command.add_argument(
        "--executor",
        type=executor,
        default="local",
        metavar="WHERE",
        help="where cases run: local, dask, dask:ADDRESS, slurm, or slurm:NAME=VALUE,... with"
        f" {', '.join(SLURM_OPTIONS)}; default: local",
    )
    how = command.add_mutually_exclusive_group()
    how.add_argument(
        "--emit-jobs",
        type=pathlib.Path,
        metavar="FOLDER",
        help="run nothing, but write an array of jobs for sbatch, a task for each case; options of"
        " slurm:NAME=VALUE,... go into it",
    )
    how.add_argument(
        "--gather", action="store_true", help="run nothing: results of the cases that are finished"
    )


_ADD: dict[str, Callable[[argparse.ArgumentParser], None]] = {
    "run": _run_arguments,
    "calibrate-wall": _wall_arguments,
    "sweep": _sweep_arguments,
    "mesh": _mesh_arguments,
    "simulate": _simulation_arguments,
    "study": _study_arguments,
    "what-if": _what_if_arguments,
    "cohort": _cohort_arguments,
    "diagnose": _diagnose_arguments,
    "plan-measurement": _record_arguments,
    "import-record": import_arguments,
    "show": _show_arguments,
    "template": _template_arguments,
    "check": _check_arguments,
    "cache": _cache_arguments,
    "completion": _completion_arguments,
}
