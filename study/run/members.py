"""The cases of a cohort: found in a folder, and read before any is run."""

import dataclasses
import pathlib
from collections.abc import Sequence

from study.case.faults import CaseError, Fault
from study.case.read import read_case


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


def check_members(members: Sequence[Member]) -> None:
    """Read every case before any is run.

    Raises:
        CaseError: the faults of all cases.
    """
    faults: list[Fault] = []
    for member in members:
        try:
            read_case(member.path)
        except CaseError as error:
            faults += error.faults
    if faults:
        raise CaseError(faults)
