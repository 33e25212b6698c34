"""Arguments of the command line, with their help."""

import argparse
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

from diagnosis.richness import RICHNESS
from study.case.catheter.units import PRESSURE_UNITS, TIME_UNITS
from study.case.parameters import MeshOptions, SolverOptions
from study.case.schema import Quantity, Word, keys_of
from study.cli.argument_values import (
    alpha_range,
    columns,
    count,
    document_kind,
    formats,
    names,
    positive,
    span,
)
from study.cli.help_texts import DESCRIPTION, EPILOG, HELP
from study.cli.request import ImportOptions, Request, ShowOptions, TemplateOptions
from study.report.documents import document_kinds
from study.run.limits import MOST_DRAWN
from study.store.numerics import installed
from study.store.options import (
    KINDS,
    CohortOptions,
    DiagnoseOptions,
    Options,
    PlanOptions,
)
from study.store.result_files import MESH_FORMATS as FORMATS

_ON_RECORDS = ("diagnose", "plan-measurement")
_ON_CASES = ("run", "calibrate", "calibrate-wall", "sweep", "mesh", "simulate", "study")

_OPTIONS: dict[str, type[Options]] = {
    **{name: KINDS["wall" if name == "calibrate-wall" else name] for name in _ON_CASES},
    "cohort": CohortOptions,
    "diagnose": DiagnoseOptions,
    "plan-measurement": PlanOptions,
    "import-record": ImportOptions,
    "show": ShowOptions,
    "template": TemplateOptions,
}


def parse(argv: Sequence[str]) -> Request[Options]:
    """Parse the arguments of one command.

    Args:
        argv: arguments without the program's name.

    Returns:
        The command with its options.

    Raises:
        SystemExit: help was asked for (0), or the arguments make no sense (2).
    """
    given = list(argv)
    rest: list[str] | None = None
    if "--" in given and given[:1] == ["cohort"]:
        at = given.index("--")
        given, rest = given[:at], given[at + 1 :]
    found = vars(command_parser().parse_args(given))
    values: dict[str, Any] = {n: tuple(v) if isinstance(v, list) else v for n, v in found.items()}
    values["options"] = None if rest is None else tuple(rest)
    options = _OPTIONS[values["command"]].of(values)
    return Request(values["command"], options, ("jaxfsi", *argv), values["out"], values["json"])


def command_parser() -> argparse.ArgumentParser:
    """Parser of the command line, with every command; the reference page is made from it."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(
        "jaxfsi", description=DESCRIPTION, epilog=EPILOG, formatter_class=raw
    )
    parser.add_argument("--version", action=_Version, help="print the version and end")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    parsers = {
        name: commands.add_parser(
            name,
            help=help_,
            description=f"{help_[0].upper()}{help_[1:]}.",
            epilog=epilog,
            formatter_class=raw,
        )
        for name, (help_, epilog) in HELP.items()
    }
    for name in _ON_CASES:
        what = parsers[name].add_mutually_exclusive_group(required=True)
        what.add_argument("case", nargs="?", type=pathlib.Path, help="case file", metavar="CASE")
        what.add_argument("--demo", action="store_true", help="use the bundled patient")
    _cohort_arguments(parsers["cohort"])
    _wall_arguments(parsers["calibrate-wall"])
    sweep = parsers["sweep"]
    sweep.add_argument("--alpha", type=alpha_range, required=True, metavar="FROM:TO:N")
    sweep.add_argument("--condition", default="rest", metavar="NAME", help="default: rest")
    sweep.add_argument("--rule", help="stress rule: printed, all, or factors of the case")
    _mesh_arguments(parsers["mesh"])
    _simulation_arguments(parsers["simulate"])
    _study_arguments(parsers["study"])
    _run_arguments(parsers["run"])
    _record_arguments(parsers)
    _import_arguments(parsers["import-record"])
    parsers["template"].add_argument(
        "--record", action="store_true", help="a measured record, with an example of its traces"
    )
    parsers["template"].add_argument(
        "--schema", action="store_true", help="the JSON Schema of the file instead, for editors"
    )
    _show_arguments(parsers["show"])
    for name, command in parsers.items():
        where = "folder for the output"
        if name in _ON_CASES:
            where += " (default: CASE-results beside the case; ./results for --demo)"
        if name in _ON_RECORDS:
            where += " (default: RECORD-results beside the record)"
        if name == "import-record":
            where += " (default: ID-record beside the first file)"
        command.add_argument("--out", type=pathlib.Path, metavar="DIR", help=where)
        command.add_argument("--json", action="store_true", help="print one JSON object, only")
    return parser


class _Version(argparse.Action):
    """Prints the version of the package, which is looked up only when it is asked for."""

    def __init__(self, option_strings: Sequence[str], dest: str, **kwargs: Any):
        super().__init__(option_strings, argparse.SUPPRESS, nargs=0, **kwargs)

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print(f"jaxfsi {installed('jaxfsi') or 'not installed'}")
        parser.exit()


def _record_arguments(parsers: Mapping[str, argparse.ArgumentParser]) -> None:
    case = "case file or finished study that R0 is taken from"
    for name in _ON_RECORDS:
        parsers[name].add_argument("record", type=pathlib.Path, metavar="RECORD", help="its folder")
        parsers[name].add_argument("--case", type=pathlib.Path, metavar="CASE", help=case)
    parsers["diagnose"].add_argument(
        "--richness", choices=RICHNESS, help="use no more of the record; default: all"
    )
    parsers["diagnose"].add_argument(
        "--in-3d",
        nargs="*",
        metavar="CONDITION",
        help="measure the gap in 3D as well, in these conditions (default: all), with the mesh of "
        "the finished study of --case",
    )


def _import_arguments(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "files",
        nargs="+",
        metavar="FILE",
        help="export of one condition, in the order of measurement; NAME=FILE where its name does "
        "not say it",
    )
    command.add_argument(
        "--columns",
        type=columns,
        metavar="MAP",
        help="columns by number, from 0, or name: time=0,aortic=2,distal=4 (and flow, in mL/min); "
        "default: by their names",
    )
    command.add_argument(
        "--unit", choices=tuple(PRESSURE_UNITS), help="of pressures; default: as the header says"
    )
    command.add_argument(
        "--time-unit", choices=tuple(TIME_UNITS), help="of times; default: as the header says"
    )
    command.add_argument(
        "--rate", type=positive(2e4), metavar="HZ", help="samples a second, without a time column"
    )
    command.add_argument(
        "--span",
        nargs="+",
        type=span,
        metavar="NAME=FROM:TO",
        help="use these seconds of a condition alone",
    )
    command.add_argument("--id", metavar="NAME", help="of the patient; default: from the files")


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
        "--cycles", type=positive(1000.0), metavar="N", help="may be a part of one; default: 4"
    )
    command.add_argument(
        "--alpha",
        type=positive(1e6),
        metavar="X",
        help="of the anomalous outlet; by default tuned",
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
        "--cycles", type=count(1, 100), metavar="N", help="of each run; default: 1"
    )
    command.add_argument(
        "--continued", action="store_true", help="stress goes on from the end of rest"
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
        help="conditions whose ratio in 3D is differentiated by parameters and lumen, such as "
        "dobutamine; with rest among them, also with alpha tuned again; five to ten runs each",
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


def _show_arguments(command: argparse.ArgumentParser) -> None:
    what = command.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "result", nargs="?", type=pathlib.Path, metavar="RESULT", help="its file or folder"
    )
    what.add_argument(
        "--schema",
        type=document_kind,
        metavar="KIND",
        help=f"the JSON Schema of a kind of result instead: {', '.join(document_kinds())}",
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
    what.add_argument("folder", nargs="?", type=pathlib.Path, help="folder of cases", metavar="DIR")
    what.add_argument("--demo", action="store_true", help="use the bundled virtual cohort")
    command.add_argument(
        "--mode", choices=("curve", "3d"), default="curve", help="0D or 3D; default: curve"
    )
    command.add_argument(
        "--workers", type=count(1, 1024), metavar="N", help="cases at a time; default: one a core"
    )
