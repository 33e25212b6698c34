"""Where the cases of a cohort run, as it is written on the command line.

| text | where |
|---|---|
| `local` | processes of this machine |
| `dask` | a Dask cluster of this machine, as many workers as cases at a time |
| `dask:ADDRESS` | a Dask scheduler that is at work, such as `dask:tcp://head:8786` |
| `slurm` | a job of SLURM for each case |
| `slurm:NAME=VALUE,...` | the same, with options of sbatch: those of `SLURM_OPTIONS` |
"""

import dataclasses
import re
from collections.abc import Mapping

KINDS = ("local", "dask", "slurm")
"""Kinds of executors."""

SLURM_OPTIONS = {
    "partition": "partition",
    "time": "time",
    "mem": "mem",
    "cpus": "cpus-per-task",
    "gpus": "gpus",
    "account": "account",
    "qos": "qos",
    "constraint": "constraint",
}
"""Options of a job as they are written here, and their names in sbatch."""

_VALUE = re.compile(r"[\w.:&|*@/+-]+")
_TIME = re.compile(r"(?:(?P<days>\d+)-)?(?P<first>\d+)(?::(?P<second>\d+))?(?::(?P<third>\d+))?")


@dataclasses.dataclass(frozen=True)
class ExecutorChoice:
    """Where cases run.

    Attributes:
        kind: one of `KINDS`.
        address: of the Dask scheduler; empty: one is started.
        slurm: options of a job by their names in `SLURM_OPTIONS`.
    """

    kind: str
    address: str = ""
    slurm: Mapping[str, str] = dataclasses.field(default_factory=dict)


def executor_choice(text: str) -> ExecutorChoice:
    """Read where cases run.

    Raises:
        ValueError: what is wrong with the text.
    """
    kind, colon, rest = text.partition(":")
    if kind not in KINDS or (colon and (kind == "local" or not rest)):
        raise ValueError(
            f"{text!r} is none of local, dask, dask:ADDRESS, slurm, slurm:partition=NAME,time=..."
        )
    if kind == "dask":
        return ExecutorChoice(kind, address=rest)
    options: dict[str, str] = {}
    for part in filter(None, rest.split(",")):
        name, _, value = part.partition("=")
        if name not in SLURM_OPTIONS:
            raise ValueError(
                f"slurm has no option {name!r}; choose from {', '.join(SLURM_OPTIONS)}"
            )
        if not _VALUE.fullmatch(value):
            raise ValueError(f"{part!r} is not NAME=VALUE; try {name}=...")
        options[name] = value
    if "time" in options:
        slurm_minutes(options["time"])
    return ExecutorChoice(kind, slurm=options)


def slurm_minutes(text: str) -> int:
    """Minutes of a time as sbatch reads it: `90`, `30:00`, `2:00:00`, `1-12`, `1-12:30`, ...

    Raises:
        ValueError: it is none, or no time at all.
    """
    found = _TIME.fullmatch(text)
    if found is None:
        raise ValueError(f"{text!r} is no time; try 90 (minutes), 2:00:00 or 1-12:00:00")
    numbers = [int(found[name] or 0) for name in ("first", "second", "third")]
    if found["days"] is not None:
        hours, minutes, seconds = numbers
    elif found["third"] is not None:
        hours, minutes, seconds = numbers
    else:
        hours, (minutes, seconds, _) = 0, numbers
    whole = 1440 * int(found["days"] or 0) + 60 * hours + minutes + -(-seconds // 60)
    if whole < 1:
        raise ValueError(f"{text!r} leaves no time; try 90 (minutes), 2:00:00 or 1-12:00:00")
    return whole
