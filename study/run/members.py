"""The cases of a cohort, found in a folder, and what became of them."""

import dataclasses
import pathlib
from typing import Any

from study.case.faults import CaseError, Fault


@dataclasses.dataclass(frozen=True)
class Member:
    """A case of a cohort.

    Attributes:
        name: of its folder.
        path: its case file.
        folder: where its results go.
    """

    name: str
    path: pathlib.Path
    folder: pathlib.Path


@dataclasses.dataclass(frozen=True)
class MemberResult:
    """What became of a case.

    Attributes:
        member: the case.
        status: exit status of its command; 0 is done.
        seconds: that its last command took.
        document: its result; None where there is none.
        reason: why there is none.
        kept: whether an earlier command computed it.
    """

    member: Member
    status: int
    seconds: float
    document: dict[str, Any] | None
    reason: str
    kept: bool = False


def find_members(folder: pathlib.Path, out: pathlib.Path) -> list[Member]:
    """Cases of a folder: its case files, or one in each of its folders, by name.

    Raises:
        CaseError: there is none, or the folder does not exist.
    """
    found: dict[str, pathlib.Path] = {}
    if folder.is_dir():
        for path in sorted(folder.glob("*/case.toml")):
            found[path.parent.name] = path
        for path in sorted(folder.glob("*.toml")):
            found.setdefault(path.stem, path)
    if not found:
        cure = "give a folder with NAME/case.toml or NAME.toml, one for each patient"
        problem = "no case in it" if folder.is_dir() else "no such folder"
        raise CaseError([Fault(folder, "", None, problem, "", cure)])
    return [Member(name, path, out / name) for name, path in found.items()]
