# ruff: noqa: E501  tables of damage read best in long rows
"""What a command promises of any input, and which promise an outcome breaks."""

import dataclasses
import json
import math
import pathlib
import re
from typing import Any

from tests.fuzz.execute import LIMIT_OF_TEXT, STARTED, Outcome
from tests.fuzz.trial import Trial

SECONDS, MEMORY_MB = 60.0, 2048.0

FOREIGN = (
    r"Traceback \(most recent", r"\b[A-Z]\w*(Error|Exception|Warning)\b", r"\bErrno\b",
    r"\b(numpy|jax|jaxlib|scipy|meshio|trimesh|vtk|pyvista|h5py|equinox|beartype|tomllib|lxml|"
    r"optimistix|lineax|diffrax|matplotlib|zipfile|struct|zlib)\b(?! (file|surface))",
    r"\.py\b", r"site-packages", r"<class ", r"\bNoneType\b", r"\bdtype\b", r"\bndarray\b",
    r"codec can't", r"could not convert", r"invalid literal", r"out of range for", r"out of bounds",
    r"object is not", r"has no attribute", r"not subscriptable", r"unsupported operand",
    r"broadcast", r"division by zero", r"overflow encountered", r"bins must", r"Expecting (value|',')",
    r"Extra data", r"Unterminated string", r"Invalid control character", r"keyword argument",
    r"positional argument", r"unhashable", r"string indices", r"list index", r"must be real number",
    r"not supported between", r"\bXLA\b", r"slow compile", r"not enough values", r"too many values",
    r"index \d+ is", r"cannot reshape", r"zip file", r"Bad magic", r"\(char \d+\)", r"np\.",
    r"unpack requires", r"\bsyntax error", r"not well-formed", r"mismatched tag", r"0x[0-9a-f]{8}",
    r"allow_pickle", r"pickled", r"float\(\)", r"int\(\)", r"array\(", r"\bKeyError\b",
)  # fmt: skip
_FOREIGN = re.compile("|".join(f"(?:{pattern})" for pattern in FOREIGN))

SEVERITIES = ("silent", "numbers", "lost", "traceback", "cost", "written", "status", "words")
"""Promises broken, the worst first."""


@dataclasses.dataclass(frozen=True)
class Breach:
    """A promise that was broken: its name out of `SEVERITIES`, and how."""

    severity: str
    how: str


def judged(
    trial: Trial,
    outcome: Outcome,
    changes: list[str],
    good: dict[str, Any] | None,
    folder: pathlib.Path,
) -> list[Breach]:
    """Which promises an outcome breaks.

    Args:
        trial: the damaged input.
        outcome: what became of it.
        changes: paths that were added, changed or removed.
        good: numbers of the good input, where the same are expected.
        folder: of the trial.
    """
    found = _of_status(trial, outcome)
    if outcome.status in (1, 2, "died"):
        found += _of_words(trial, outcome, folder)
    if outcome.status == 2 and changes:
        found.append(Breach("written", f"refused, but changed {', '.join(changes[:4])}"))
    lost = [name for name in trial.keep if name in changes]
    if lost:
        found.append(Breach("lost", f"changed or removed {', '.join(lost)}"))
    if outcome.status == 0:
        found += _of_numbers(trial, outcome, good)
    if outcome.status in (1, 2) and outcome.seconds > SECONDS:
        found.append(Breach("cost", f"refused after {outcome.seconds:.0f} s"))
    if outcome.peak_mb > MEMORY_MB:
        found.append(Breach("cost", f"takes {outcome.peak_mb:.0f} MB"))
    return found


def _of_status(trial: Trial, outcome: Outcome) -> list[Breach]:
    status, expected = outcome.status, trial.expected
    if status == "died":
        return [Breach("traceback", "the process ended by itself")]
    if status == "memory":
        return [Breach("cost", "memory without bound")]
    if status == "timeout":
        return [Breach("cost", f"still at work after {outcome.seconds:.0f} s")]
    if status not in (0, 1, 2, STARTED):
        return [Breach("status", f"exit status {status} is not documented")]
    if expected == "refused" and status in (0, STARTED):
        return [Breach("silent", "accepted, though it must be refused")]
    if expected == "refused" and status == 1:
        return [Breach("status", "failed with 1, though the input must be refused with 2")]
    if expected == "same" and status in (1, 2):
        return [Breach("status", f"ends with {status}, though the damage is harmless")]
    return []


def _of_words(trial: Trial, outcome: Outcome, folder: pathlib.Path) -> list[Breach]:
    text = outcome.stderr.replace(str(folder), "FOLDER")
    if "Traceback (most recent call last)" in text:
        return [Breach("traceback", "a traceback")]
    found = []
    foreign = _FOREIGN.search(text)
    if foreign and foreign[0] not in trial.key:  # a key may be named after a library
        found.append(Breach("words", f"says {foreign[0]!r}"))
    if not text.strip():
        found.append(Breach("words", "says nothing"))
    elif "try:" not in text and "usage:" not in text and "Name another" not in text:
        found.append(Breach("words", "names no cure"))
    if outcome.status == 2 and outcome.stdout.strip():
        found.append(Breach("words", "prints something on standard output"))
    if outcome.status == 2 and not any(name in text for name in trial.blame.split("|")):
        found.append(Breach("words", f"does not name {trial.blame}"))
    if len(text) > 12_000:
        found.append(Breach("words", f"says {len(text)} characters"))
    return found


def _of_numbers(trial: Trial, outcome: Outcome, good: dict[str, Any] | None) -> list[Breach]:
    if "--json" not in trial.argv:
        return []
    bad: list[str] = []
    try:
        document = json.loads(outcome.stdout, parse_constant=bad.append)
    except ValueError:
        cut = len(outcome.stdout.encode()) > LIMIT_OF_TEXT - 8
        return [] if cut else [Breach("numbers", "prints no JSON")]
    if bad:
        return [Breach("numbers", f"prints {bad[0]} in JSON")]
    found = [Breach("numbers", text) for text in impossible(document)][:1]
    if good is not None:
        differing = differences(numbers(good), numbers(document))
        if differing:
            found.append(Breach("numbers", f"other numbers than the good input: {differing[:3]}"))
    return found


_RATIO = re.compile(r"(^|\.)(ffr|rest_ratio|target)$")
_POSITIVE = re.compile(r"(^|\.)(alpha|R0|period_s|mean_P_aorta_mmHg|mean_P_distal_mmHg)$")
DERIVATIVE = re.compile(r"_by_|sensitivit|derivative|gradient")
"""Keys below which quantities are derivatives, of any sign and size."""
_SKIPPED = (
    "provenance", "files", "wall_time_s", "sources", "remarks", "patient", "id", "origin",
    "seconds", "seconds_per_step", "resumed_from", "kept", "date",
)  # fmt: skip


def numbers(document: Any, at: str = "") -> dict[str, float | str]:
    """Numbers and words of a document by dotted key, without what tells of time and place."""
    if isinstance(document, dict):
        found: dict[str, float | str] = {}
        for key, part in document.items():
            if key not in _SKIPPED:
                found |= numbers(part, f"{at}.{key}".lstrip("."))
        return found
    if isinstance(document, list):
        found = {}
        for k, part in enumerate(document):
            found |= numbers(part, f"{at}.{k}")
        return found
    return {at: document}


def differences(good: dict[str, float | str], other: dict[str, float | str]) -> list[str]:
    """Keys whose values differ by more than one in 1e9."""
    keys = [key for key in {**good, **other} if not _close(good.get(key), other.get(key))]
    return [f"{key}: {good.get(key)} and {other.get(key)}" for key in keys]


def _close(a: Any, b: Any) -> bool:
    if isinstance(a, int | float) and isinstance(b, int | float):
        return math.isclose(a, b, rel_tol=1e-9, abs_tol=1e-12)
    return a == b


def impossible(document: Any) -> list[str]:
    """Quantities of a document that no patient can have."""
    found = []
    for key, value in numbers(document).items():
        if DERIVATIVE.search(key):
            continue
        if isinstance(value, bool) or not isinstance(value, int | float):
            continue
        if _RATIO.search(key) and not 0.0 < value < 1.3:
            found.append(f"{key} = {value}")
        if _POSITIVE.search(key) and not 0.0 < value < 1e9:
            found.append(f"{key} = {value}")
    return found
