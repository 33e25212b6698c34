"""The cases of a cohort, found in a folder, and what became of them."""

import dataclasses
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

from lumped.whole_files import write_whole
from study.case.faults import CaseError, Fault

CASE_FILE = "case.toml"
"""Case file of a patient of a table, in the folder of its results."""


@dataclasses.dataclass(frozen=True)
class Member:
    """A case of a cohort.

    Attributes:
        name: of its folder.
        path: its case file.
        folder: where its results go.
        text: of its case file where that is yet to be written; None: it is there.
    """

    name: str
    path: pathlib.Path
    folder: pathlib.Path
    text: str | None = None


@dataclasses.dataclass(frozen=True)
class MemberResult:
    """What became of a case.

    Attributes:
        member: the case.
        status: exit status of its command; 0 is done.
        seconds: that its last command took; with Dask since it was submitted.
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


def table_members(texts: Mapping[str, str], out: pathlib.Path) -> list[Member]:
    """Cases of a table of patients; the file of each is yet to be written into its folder.

    Args:
        texts: of the case file of each patient, by name.
        out: folder of the results.
    """
    return [Member(n, out / n / CASE_FILE, out / n, text) for n, text in texts.items()]


def write_cases(members: Sequence[Member]) -> None:
    """Write the case files that are yet to be written."""
    for member in members:
        if member.text is not None:
            member.folder.mkdir(parents=True, exist_ok=True)
            write_whole(member.path, member.text)


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
            if path.stem in found:
                problem = f"{path.name} and {path.stem}/{CASE_FILE} are both the case {path.stem}"
                raise CaseError([Fault(folder, "", None, problem, "", "rename one of the two")])
            found[path.stem] = path
    if not found:
        cure = "give a folder with NAME/case.toml or NAME.toml, one for each patient"
        problem = "no case in it" if folder.is_dir() else "no such folder"
        raise CaseError([Fault(folder, "", None, problem, "", cure)])
    return [Member(name, path, out / name) for name, path in found.items()]
