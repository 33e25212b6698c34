"""Files of svZeroDSolver on disk: JSON in, JSON out, and the names that its formats share."""

import json
import os
import pathlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from lumped.whole_files import write_whole

VESSEL_KEYS = {
    "R_viscous": "R_poiseuille",
    "C": "C",
    "L": "L",
    "K_stenosis": "stenosis_coefficient",
}
"""Our names of the vessel parameters and those of svZeroDSolver."""


def load_json(path: str | os.PathLike[str], expected: str) -> Any:
    """Parse a JSON file.

    Args:
        path: the file.
        expected: what the file should have been, for the message.

    Raises:
        ValueError: the file is not JSON.
    """
    try:
        return json.loads(pathlib.Path(path).read_bytes())
    except ValueError as error:
        raise ValueError(f"{path} is not JSON: {error}. Give a {expected}.") from error


def dump_json(path: str | os.PathLike[str], config: Any, *, sort_keys: bool = False) -> None:
    """Write JSON beside the target, then rename: a reader never sees half a file."""
    text = json.dumps(config, indent=2, sort_keys=sort_keys) + "\n"
    write_whole(pathlib.Path(path), text, shared=True)


def is_finite(value: object) -> bool:
    """Whether a JSON value is a finite number."""
    return (
        isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))
    )


def raise_faults(what: str, faults: Sequence[str], cure: str) -> None:
    """Report all faults of a file together.

    Args:
        what: what happened, for example "case.json cannot be read".
        faults: one line each; nothing is raised when there are none.
        cure: what to try.

    Raises:
        ValueError: there are faults.
    """
    if faults:
        listing = "\n".join(f"  - {fault}" for fault in faults)
        raise ValueError(f"{what}:\n{listing}\n{cure}")
