"""Which condition each file of an import holds: told as NAME=FILE, or by the file's own name."""

import pathlib
import re
from collections.abc import Sequence
from typing import NamedTuple

from study.case.catheter.table import refusal
from study.case.condition import CONDITION_NAME

CHECK = "check"
"""In place of a drug: the wire lay beside the aortic catheter."""

_WORDS = {
    "none": (
        "rest", "baseline", "base", "resting", "ruhe", "repos", "reposo", "riposo", "basal",
    ),
    "adenosine": ("ade", "adeno", "adenosine", "adenosin", "hyperaemia", "hyperemia"),
    "dobutamine": ("dobu", "dobutamine", "dobutamin", "dob"),
    CHECK: ("equal", "equalised", "equalized", "equalisation", "drift", "pullback", "check"),
}  # fmt: skip
_NAMES = {"none": "rest", "adenosine": "adenosine", "dobutamine": "dobutamine", CHECK: CHECK}


class NamedFile(NamedTuple):
    """A file and what it holds.

    Attributes:
        path: the file.
        name: of the condition, each once.
        drug: `none`, `adenosine`, `dobutamine`, or `CHECK`.
    """

    path: pathlib.Path
    name: str
    drug: str


def named_files(given: Sequence[str]) -> list[NamedFile]:
    """The files of an import with the names of their conditions.

    Args:
        given: `FILE` whose name says the condition, as `case_rest.csv`, or `NAME=FILE`.

    Raises:
        CaseError: a name says nothing, or is that of two files.
    """
    found: list[NamedFile] = []
    for text in given:
        name, path = _split(text)
        drug = _drug(path.stem if name is None else name)
        if drug is None:
            known = "rest, ade, dobu, or equal (wire beside the aortic catheter)"
            cure = f"write NAME=FILE, such as rest={path.name}, or rename it to ..._rest.csv"
            raise refusal(path, f"its name says no condition ({known})", cure)
        name = name or _free(_NAMES[drug], found)
        if any(other.name == name for other in found):
            problem = f"two files are named {name}"
            raise refusal(path, problem, f"name one of them {name}_2={path.name}")
        found.append(NamedFile(path, name, drug))
    if all(one.drug == CHECK for one in found):
        cure = "give a file of rest or of a drug as well"
        raise refusal(found[0].path, "no file holds a condition", cure)
    return found


def common_stem(files: Sequence[NamedFile]) -> str:
    """What the names of the files have in common before the condition, to name the patient."""
    words = {word for group in _WORDS.values() for word in group}
    first, *others = [re.split(r"[_\-. ]+", one.path.stem) for one in files]
    own = [token for token in first if token.lower() not in words]
    kept = [token for token in own if all(token in tokens for tokens in others)] or own
    name = re.sub(r"[^A-Za-z0-9-]+", "-", "-".join(kept)).strip("-")
    return name[:40] or "patient"


def _split(text: str) -> tuple[str | None, pathlib.Path]:
    name, sign, rest = text.partition("=")
    if not sign or pathlib.Path(text).exists():
        return None, pathlib.Path(text)
    if not re.fullmatch(CONDITION_NAME, name):
        cure = "use a letter, then letters, digits, _ and -, at most 40"
        raise refusal(pathlib.Path(rest), f"{name!r} is no name of a condition", cure)
    return name, pathlib.Path(rest)


def _drug(name: str) -> str | None:
    """What a name says, by its last word that says anything."""
    for token in reversed(re.split(r"[_\-. ]+|(?<=\D)(?=\d)", name.lower())):
        for drug, words in _WORDS.items():
            if token in words:
                return drug
    return None


def _free(name: str, found: Sequence[NamedFile]) -> str:
    """The name, with a number where it is taken."""
    taken = {one.name for one in found}
    number = 2
    free = name
    while free in taken:
        free, number = f"{name}_{number}", number + 1
    return free
