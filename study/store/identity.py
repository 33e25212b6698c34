"""What a result follows from: the content of its inputs, and the options that can change it."""

import contextlib
import hashlib
import io
from collections.abc import Mapping
from typing import Any

import numpy as np

from study.cli.arguments import parse

_WITHOUT_EFFECT = ("out", "json", "restart", "workers")
_INPUTS = ("case", "record", "folder", "result")
"""Options that name inputs, whose content counts instead."""


def identity(document: Mapping[str, Any]) -> str | None:
    """Hash of what a document follows from; None where it does not say.

    Two results with the same hash come from the same command on the same input: one may take the
    place of the other.

    Args:
        document: with its `provenance`, see `study.store.provenance`.
    """
    try:
        origin = document["provenance"]
        inputs = sorted((str(entry["file"]), str(entry["sha256"])) for entry in origin["inputs"])
        with contextlib.redirect_stderr(io.StringIO()):
            options = vars(parse([str(word) for word in origin["command"][1:]]))
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, SystemExit):
        return None
    plain = {
        name: value.tolist() if isinstance(value, np.ndarray) else value
        for name, value in options.items()
        if name not in (*_WITHOUT_EFFECT, *_INPUTS)
    }
    return hashlib.sha256(repr((inputs, sorted(plain.items()))).encode()).hexdigest()
