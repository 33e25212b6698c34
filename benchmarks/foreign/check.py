"""Whether a file of answers is in the form that the challenge asks for.

The scorer reads files that others have written: a misspelt effect or a probability above one would
otherwise be scored as if it were meant.
"""

import json
import math
import pathlib
from collections.abc import Collection
from typing import Any

from benchmarks.foreign.schedule import EFFECTS

NAMES = (*EFFECTS, "sensor_gain", "distal_damping")
"""Effects that an answer may name; the last two are causes that the generators call outside."""

VERDICTS = ("no_gap", "named", "ambiguous", "unknown")

WAVEFORM = "aortic_waveform"
"""The effect that an aortic waveform of another family is."""

JOINED = 2
"""Effects of one hypothesis, besides `WAVEFORM`."""

ROUNDED = 0.01
"""How far from one the sum of probabilities may be, which were rounded."""

Entry = dict[str, Any]


def read_answers(file: pathlib.Path, records: Collection[str]) -> dict[str, Entry]:
    """Answers in a file, checked.

    Args:
        file: JSON, see the page of the challenge.
        records: names of the records of the set.

    Raises:
        ValueError: the file is no JSON object, or an answer is not as it has to be; the message
            names the file, the record and what is allowed.
        OSError: the file cannot be read.
    """
    try:
        answers = json.loads(file.read_text(encoding="utf-8"), object_pairs_hook=_no_name_twice)
    except ValueError as error:
        raise ValueError(f"{file.name} is not JSON as it has to be: {error}") from None
    if not isinstance(answers, dict) or not answers:
        raise ValueError(f"{file.name} has to be one JSON object with an entry for each record.")
    strange = sorted(set(answers) - set(records))
    if strange:
        raise ValueError(
            f"{file.name} holds {', '.join(strange[:5])}, which the set does not have. "
            "Name records as their folders."
        )
    for record, entry in answers.items():
        fault = _fault(entry)
        if fault:
            raise ValueError(f"{file.name}, record {record}: {fault}")
    return {record: {"named": [], **entry} for record, entry in answers.items()}


def _no_name_twice(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"'{twice}' occurs twice")
    return found


def _fault(entry: Any) -> str:
    """What is wrong with an entry; empty if nothing is."""
    if not isinstance(entry, dict):
        return "the entry has to be an object."
    for key in ("verdict", "probabilities"):
        if key not in entry:
            return f"'{key}' is missing."
    if entry["verdict"] not in VERDICTS:
        return f"verdict {entry['verdict']!r} (allowed: {', '.join(VERDICTS)})."
    if entry["verdict"] == "named" and "named" not in entry:
        return "the verdict is 'named', and 'named' is missing."
    return (
        _fault_of_names(entry["verdict"], entry.get("named", []))
        or _fault_of_probabilities(entry["probabilities"])
        or ("held_out_rms_mmHg" in entry and _fault_of_errors(entry["held_out_rms_mmHg"]))
        or ""
    )


def _fault_of_names(verdict: str, named: Any) -> str:
    if not isinstance(named, list):
        return "'named' has to be a list of effects."
    if verdict == "named" and not named:
        return "the verdict is 'named', and 'named' is empty."
    return _fault_of_effects(named, "named") if verdict == "named" else ""


def _fault_of_effects(names: list[Any], where: str) -> str:
    strange = [name for name in names if name not in NAMES]
    if strange:
        return f"'{where}' holds {strange[0]!r} (allowed: {', '.join(NAMES)})."
    if len(set(names)) < len(names) or len(set(names) - {WAVEFORM}) > JOINED:
        return f"'{where}' joins {'+'.join(names)} (allowed: two effects, and {WAVEFORM})."
    return ""


def _fault_of_probabilities(p: Any) -> str:
    if not isinstance(p, dict) or not p:
        return "'probabilities' has to be an object with a number for each hypothesis."
    known: dict[frozenset[str], str] = {}
    for hypothesis, value in p.items():
        if not _number(value) or not 0.0 <= value <= 1.0 + ROUNDED:
            return f"probability {value!r} of '{hypothesis}' (allowed: 0 to 1)."
        if hypothesis not in ("none", "unknown"):
            fault = _fault_of_effects(hypothesis.split("+"), "probabilities")
            if fault:
                return fault
        same = known.setdefault(frozenset(hypothesis.split("+")), hypothesis)
        if same != hypothesis:
            return f"'{same}' and '{hypothesis}' are one hypothesis (allowed: one of them)."
    if abs(sum(p.values()) - 1.0) > ROUNDED:
        return f"the probabilities sum to {sum(p.values()):.4g} (allowed: 1)."
    return ""


def _fault_of_errors(pair: Any) -> str:
    if isinstance(pair, list) and len(pair) == 2 and all(_number(v) and v >= 0.0 for v in pair):
        return ""
    return f"held_out_rms_mmHg is {pair!r} (allowed: two errors, before and after)."


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
