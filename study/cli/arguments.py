"""Arguments of the command line, with their help."""

import argparse
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

from diagnosis.richness import RICHNESS
from study.case.parameters import MeshOptions, SolverOptions
from study.case.schema import Quantity, Word, keys_of
from study.cli.argument_values import alpha_range, count, formats, names, positive
from study.cli.request import Request, ShowOptions, TemplateOptions
from study.store.cache_folder import VARIABLE
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
_ON_CASES = ("run", "calibrate", "sweep", "mesh", "simulate", "study")

_DESCRIPTION = """\
Pressure ratios (FFR, resting Pd/Pa) of anomalous coronary arteries by reduced models that are
tuned to one patient. Research software, not a medical device.
"""

_EPILOG = f"""\
examples:
  jaxfsi template > case.toml             start a case file; --record a measured record
  jaxfsi run --demo                       the real patient that comes with the package
  jaxfsi run case.toml                    results in case-results/, report.html first
  jaxfsi mesh case.toml                   mesh of blood and wall, with pictures
  jaxfsi show case-results                what was found, in the terminal

exit status: 0 done, 1 the computation failed, 2 the input was refused, 130 interrupted.
Compiled code is kept in the user's cache folder; {VARIABLE} names another folder, or off.
"""

_HELP = {
    "run": (
        "calibrate a patient at rest, predict every condition, write a report",
        """\
examples:
  jaxfsi run case.toml
  jaxfsi run --demo --out results
  jaxfsi run case.toml --json > summary.json

writes result.json and report.html into the output folder. --mesh adds a coarse mesh of the first
state and shows it in the report; --demo does so too unless --no-mesh is given.
""",
    ),
    "calibrate": (
        "find alpha, the scale of the outlet's resistances, from the resting ratio",
        """\
examples:
  jaxfsi calibrate case.toml
  jaxfsi calibrate case.toml --json

needs [condition.rest] with ffr, and R0 or an ivus anatomy; writes calibration.json.
""",
    ),
    "sweep": (
        "ratios and flows over a range of alpha",
        """\
examples:
  jaxfsi sweep case.toml --alpha 0.01:10:200
  jaxfsi sweep case.toml --alpha 0.05:1:50 --condition dobutamine --rule all

alpha runs in equal ratios from FROM to TO; writes sweep.json, sweep.csv and sweep.svg.
""",
    ),
    "mesh": (
        "make a labelled mesh of blood and wall that share their nodes",
        """\
examples:
  jaxfsi mesh case.toml                                     first state, preset of the case
  jaxfsi mesh case.toml --state all --preset medium
  jaxfsi mesh case.toml --elements-across 8 --format vtu,folder
  jaxfsi mesh --demo --out results

writes the mesh in each format, mesh.json with all its numbers, mesh.html and its pictures. A mesh
that was made before comes from the cache.
""",
    ),
    "simulate": (
        "run blood and wall in 3D, with the circulation behind every outlet",
        """\
examples:
  jaxfsi simulate case.toml                          rest, as many cycles as the case says
  jaxfsi simulate case.toml --condition dobutamine --preset coarse
  jaxfsi simulate case.toml --rigid --cycles 1
  jaxfsi simulate --demo --preset coarse --cycles 0.05

needs an anatomy and the cardiac output. Writes fields/fields.pvd (open it in ParaView, also while
the run goes on; Warp By Vector with displacement_cm moves the points), history.csv, shear.vtu,
simulation.json and simulation.html. A run that was ended goes on when the same command is given
again (its input is compared by hash); --restart starts anew and moves the files of the earlier run
to the sub-folder earlier-1 (then earlier-2, ...). Ctrl-C keeps all whole chunks of ten steps.
""",
    ),
    "study": (
        "algorithm 1 in 3D: ramp, calibration in the loop, rest and stress",
        """\
examples:
  jaxfsi study case.toml --preset coarse             everything, one cycle each
  jaxfsi study case.toml --cycles 4 --continued      four cycles at rest, then four under stress
  jaxfsi study case.toml --rules printed,all --nominal
  jaxfsi study case.toml --sensitivities dobutamine  and which piece of the lumen moves FFR
  jaxfsi study --demo --quick --out results          the bundled patient in about five minutes

needs an anatomy, the cardiac output and the measured resting ratio. Writes study.html, study.json,
pictures, stages/ and the fields of every run below runs/. Given again, the command goes on where it
was ended; what does not follow from a changed input is not computed again.
""",
    ),
    "cohort": (
        "many cases side by side, and how predicted and measured ratios agree",
        """\
examples:
  jaxfsi cohort patients/                        in 0D, with the curve of each artery
  jaxfsi cohort patients/ --mode 3d --workers 2 -- --preset coarse --nominal --rules printed,all
  jaxfsi cohort --demo --out results             the ten virtual children that come with the package

DIR holds NAME/case.toml or NAME.toml for each patient. What stands behind -- goes to the command of
each case (run in mode curve, study in mode 3d). Each runs in a process of its own; one that fails
does not stop the others. Given again, the command goes on with those that are not finished. Writes
cohort.html, cohort.json and a folder with the report of each case.
""",
    ),
    "diagnose": (
        "say where simulation and measurement differ, which effect causes it, how far it shrinks",
        """\
examples:
  jaxfsi diagnose record                       a folder with record.toml
  jaxfsi diagnose record --case case.toml      R0 from the patient's case
  jaxfsi diagnose record --case case-results   the ramp's curve from a finished study
  jaxfsi diagnose record --case case-results --in-3d   the gap in the FSI model as well
  jaxfsi diagnose record --richness means      use no more than means of the record

writes diagnosis.json and diagnosis.html. Conditions with held_out = true are predicted and only
then compared. With --in-3d every condition is run in the FSI model too, as calibrated and with the
named effect; the runs are kept in in-3d/, and the command given again goes on where it was ended.
""",
    ),
    "plan-measurement": (
        "say which measurement would tell the likely causes apart",
        """\
examples:
  jaxfsi plan-measurement record

also says which effects each set of sensors could show at all in the conditions of the record; a
record without any data is enough for that. Writes plan.json.
""",
    ),
    "show": (
        "print a stored result; with --out, write its report again",
        """\
examples:
  jaxfsi show case-results
  jaxfsi show case-results/result.json --json
  jaxfsi show case-results --out elsewhere
""",
    ),
    "template": (
        "print a commented case file or record to start from",
        """\
examples:
  jaxfsi template > case.toml
  jaxfsi template --out new-patient             writes new-patient/case.toml
  jaxfsi template --record --out new-record     writes new-record/record.toml and rest.csv
  jaxfsi template --schema > case.schema.json   what an editor checks a case file with

a case is what is known of a patient, for run and study; a record is what was measured, for
diagnose.
""",
    ),
}


_OPTIONS: dict[str, type[Options]] = {
    **{name: KINDS[name] for name in _ON_CASES},
    "cohort": CohortOptions,
    "diagnose": DiagnoseOptions,
    "plan-measurement": PlanOptions,
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
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(
        "jaxfsi", description=_DESCRIPTION, epilog=_EPILOG, formatter_class=raw
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
        for name, (help_, epilog) in _HELP.items()
    }
    for name in _ON_CASES:
        what = parsers[name].add_mutually_exclusive_group(required=True)
        what.add_argument("case", nargs="?", type=pathlib.Path, help="case file", metavar="CASE")
        what.add_argument("--demo", action="store_true", help="use the bundled patient")
    _cohort_arguments(parsers["cohort"])
    sweep = parsers["sweep"]
    sweep.add_argument("--alpha", type=alpha_range, required=True, metavar="FROM:TO:N")
    sweep.add_argument("--condition", default="rest", metavar="NAME", help="default: rest")
    sweep.add_argument("--rule", help="stress rule: printed, all, or factors of the case")
    _mesh_arguments(parsers["mesh"])
    _simulation_arguments(parsers["simulate"])
    _study_arguments(parsers["study"])
    parsers["run"].add_argument(
        "--mesh", action=argparse.BooleanOptionalAction, help="make a coarse mesh as well"
    )
    _record_arguments(parsers)
    parsers["template"].add_argument(
        "--record", action="store_true", help="a measured record, with an example of its traces"
    )
    parsers["template"].add_argument(
        "--schema", action="store_true", help="the JSON Schema of the file instead, for editors"
    )
    parsers["show"].add_argument("result", type=pathlib.Path, metavar="RESULT", help="its folder")
    for name, command in parsers.items():
        where = "folder for the output"
        if name in _ON_CASES:
            where += " (default: CASE-results beside the case; ./results for --demo)"
        if name in _ON_RECORDS:
            where += " (default: RECORD-results beside the record)"
        command.add_argument("--out", type=pathlib.Path, metavar="DIR", help=where)
        command.add_argument("--json", action="store_true", help="print one JSON object, only")
    given = list(argv)
    rest: list[str] | None = None
    if "--" in given and given[:1] == ["cohort"]:
        at = given.index("--")
        given, rest = given[:at], given[at + 1 :]
    found = vars(parser.parse_args(given))
    values: dict[str, Any] = {n: tuple(v) if isinstance(v, list) else v for n, v in found.items()}
    values["options"] = None if rest is None else tuple(rest)
    options = _OPTIONS[values["command"]].of(values)
    return Request(values["command"], options, ("jaxfsi", *argv), values["out"], values["json"])


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
        help="coarse mesh, steps of 2 ms, a ramp of 150 mmHg/s, dobutamine alone",
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
