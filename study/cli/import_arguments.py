"""Arguments of `import-record`."""

import argparse

from study.case.catheter.units import PRESSURE_UNITS, TIME_UNITS
from study.cli.argument_values import columns, positive, span


def import_arguments(command: argparse.ArgumentParser) -> None:
    """Add files, columns and units of an export.

    Args:
        command: the parser of the command.
    """
    command.add_argument(
        "files",
        nargs="+",
        metavar="FILE",
        help="export of one condition, text or DICOM, in the order of measurement; NAME=FILE where "
        "its name does not say it",
    )
    command.add_argument(
        "--columns",
        type=columns,
        metavar="MAP",
        help="columns by number, from 0 (DICOM: channels from 1), or name: "
        "time=0,aortic=2,distal=4 (and flow, in mL/min); default: by their names",
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
