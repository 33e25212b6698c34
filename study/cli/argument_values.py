"""Values of the command line, read from their texts; what makes no sense is refused."""

import argparse
import importlib.util
import math
from collections.abc import Callable

from study.case import json_schema
from study.case.advice import nearest
from study.case.catheter.columns import column_map
from study.report.documents import document_kinds
from study.run.executor_choice import executor_choice
from study.store.options import AlphaRange
from study.store.result_files import MESH_FORMATS as FORMATS

LARGEST_COUNT = 1_000_000


def names(text: str) -> tuple[str, ...]:
    """`a,b` as names, each once."""
    return tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))


def positive(high: float) -> Callable[[str], float]:
    """Reads a number above zero and at most `high`."""

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None
        if not 0.0 < value <= high:
            raise argparse.ArgumentTypeError(f"{text} must be above 0 and at most {high:g}")
        return value

    return read


def count(low: int, high: int) -> Callable[[str], int]:
    """Reads a whole number of a range."""

    def read(text: str) -> int:
        if not text.isdecimal() or not low <= int(text) <= high:
            raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from {low} to {high}")
        return int(text)

    return read


def formats(text: str) -> tuple[str, ...]:
    """`vtu,msh` as names of formats, each once."""
    names = tuple(dict.fromkeys(name.strip().lower() for name in text.split(",")))
    unknown = [name for name in names if name not in FORMATS]
    if unknown:
        raise argparse.ArgumentTypeError(f"{unknown[0]!r}: choose from {', '.join(FORMATS)}")
    if "xdmf" in names and importlib.util.find_spec("h5py") is None:
        raise argparse.ArgumentTypeError("xdmf needs h5py; try pip install 'jaxfsi[xdmf]', or vtu")
    return names


def executor(text: str) -> str:
    """Where cases run, as `study.run.executor_choice` reads it; what it needs is installed."""
    try:
        kind = executor_choice(text).kind
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    package = {"dask": "distributed", "slurm": "submitit"}.get(kind)
    if package is not None and importlib.util.find_spec(package) is None:
        raise argparse.ArgumentTypeError(
            f"{kind} needs {package}; try pip install 'jaxfsi[cluster]', or --executor local"
        )
    return text


def document_kind(text: str) -> str:
    """A kind of stored result, as its document says it under `kind`, or the command's name."""
    kind = text.removesuffix("-measurement")
    if kind in schema_kinds():
        return kind
    close = nearest(text, schema_kinds())
    known = f"choose from {', '.join(schema_kinds())}"
    cure = known if close is None else f"try {close}, or {known}"
    raise argparse.ArgumentTypeError(f"there is no kind of result {text!r}; {cure}")


def schema_kinds() -> list[str]:
    """Kinds of results and of input files that have a JSON Schema."""
    return [*document_kinds(), *json_schema.KINDS]


def columns(text: str) -> dict[str, str]:
    """`time=0,aortic=2,distal=4` as the column of each role."""
    try:
        return column_map(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{error}; try time=0,aortic=2,distal=4") from None


def span(text: str) -> tuple[str, float, float]:
    """`NAME=FROM:TO` as a name and two times."""
    name, _, times = text.partition("=")
    try:
        low, high = (float(part) for part in times.split(":"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=FROM:TO; try rest=10:40") from None
    if not (name and math.isfinite(low) and low < high < math.inf):
        raise argparse.ArgumentTypeError(f"{text!r} must name a condition and rising times")
    return name, low, high


def alpha_range(text: str) -> AlphaRange:
    """`FROM:TO:N` as N values in equal ratios."""
    parts = text.split(":")
    try:
        if len(parts) != 3:
            raise ValueError
        low, high, count = float(parts[0]), float(parts[1]), int(parts[2])
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not FROM:TO:N; try 0.01:10:200") from None
    if not (0.0 < low < high and math.isfinite(high)):
        raise argparse.ArgumentTypeError(f"{text!r} must rise from above zero; try 0.01:10:200")
    if not 2 <= count <= LARGEST_COUNT:
        raise argparse.ArgumentTypeError(
            f"{count} values cannot be swept; try 2 to {LARGEST_COUNT}"
        )
    return AlphaRange(low, high, count)
