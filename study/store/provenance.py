"""Where a result comes from: inputs by hash, versions, command, machine, commit, date."""

import dataclasses
import datetime
import functools
import hashlib
import os
import pathlib
import platform
import subprocess
from collections.abc import Sequence
from typing import Any

from study.store.json_form import ABSENT, Absent
from study.store.numerics import PARTS, installed, version
from study.store.options import Options

PACKAGES = (
    "jaxfsi", "jax", "jaxlib", "equinox", "diffrax", "optimistix", "lineax", "numpy", "matplotlib",
    "scipy", "mmgpy", "netgen-mesher", "meshio",
)  # fmt: skip
"""Packages whose versions can move a number."""


@dataclasses.dataclass(frozen=True)
class InputFile:
    """A file that a result follows from.

    Attributes:
        file: its name, relative to the folder of the case or record where it lies below that.
        sha256: hash of its content.
        bytes: its size.
    """

    file: str
    sha256: str
    bytes: int


@dataclasses.dataclass(frozen=True, kw_only=True)
class Provenance:
    """What must be known to compute a result again.

    Attributes:
        inputs: the input files.
        command: the command line.
        options: of the command, see `study.store.options`; layout 1 does not say them.
        date: when.
        versions: of Python and packages; None: not installed.
        platform: system, machine and number of cores.
        commit: of the checkout; None for an installed package.
        seconds: that each step of the command took until this was written; parts kept from an
            earlier command take none. Earlier versions do not say it.
    """

    inputs: list[InputFile]
    command: list[str]
    options: dict[str, Any] | Absent = ABSENT
    date: str
    versions: dict[str, str | None]
    platform: str
    commit: str | None
    seconds: dict[str, float] | Absent = ABSENT

    def took(self, seconds: dict[str, float]) -> "Provenance":
        """The same with the seconds of each step."""
        return dataclasses.replace(self, seconds=seconds)


def origin(
    files: Sequence[pathlib.Path], folder: pathlib.Path, command: Sequence[str], options: Options
) -> Provenance:
    """What must be known to compute a result from some files again.

    Args:
        files: the input; all are hashed.
        folder: paths are given relative to it.
        command: the command as it was given.
        options: of the command.
    """
    return made_by([input_file(path, folder) for path in files], command, options)


def made_by(inputs: list[InputFile], command: Sequence[str], options: Options) -> Provenance:
    """Where a result of some inputs comes from that is made now.

    Args:
        inputs: the inputs.
        command: the command as it was given.
        options: of the command.
    """
    return Provenance(
        inputs=inputs,
        command=list(command),
        options=options.stored(),
        date=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        versions=versions(),
        platform=f"{platform.system()} {platform.machine()}, {os.cpu_count()} CPUs",
        commit=commit(),
    )


def input_file(path: pathlib.Path, folder: pathlib.Path) -> InputFile:
    """A file with its hash, named relative to a folder where it lies below that."""
    inside = path.is_relative_to(folder)
    name = path.relative_to(folder).as_posix() if inside else path.name
    return InputFile(name, sha256(path), path.stat().st_size)


def sha256(path: pathlib.Path) -> str:
    """Hash of a file's content, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def made_now() -> dict[str, Any]:
    """When something is made, and by which code: what every kept result carries."""
    return {
        "date": now(),
        "version": versions()["jaxfsi"],
        "commit": _commit_at_start(),
        "libraries": versions(),
        "numerics": {part: version(part) for part in PARTS},
    }


def now() -> str:
    """The time, to be compared as text."""
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="milliseconds")


@functools.cache
def _commit_at_start() -> str | None:
    """Commit when first asked: the code that is at work, whatever is checked out meanwhile."""
    return commit()


def commit() -> str | None:
    """Commit of the checkout that this package runs from, marked where it was changed.

    None for an installed package, or without git.
    """
    folder = pathlib.Path(__file__).resolve().parents[2]
    top = _git(folder, "rev-parse", "--show-toplevel")
    if top is None or pathlib.Path(top).resolve() != folder:
        return None
    name = _git(folder, "rev-parse", "HEAD")
    changed = _git(folder, "status", "--porcelain", "--untracked-files=no")
    return f"{name} (with local changes)" if name and changed else name


def _git(folder: pathlib.Path, *arguments: str) -> str | None:
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *arguments],
            capture_output=True,
            text=True,
            timeout=10.0,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()


def versions() -> dict[str, str | None]:
    """Versions of Python and of the packages that can move a number; None: not installed."""
    return {"python": platform.python_version(), **{name: installed(name) for name in PACKAGES}}
