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

from study.case.anatomy import IvusAnatomy, MeshAnatomy, SurfaceAnatomy
from study.case.model import Case
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


@dataclasses.dataclass(frozen=True)
class Provenance:
    """What must be known to compute a result again.

    Attributes:
        inputs: the input files.
        command: the command line.
        options: of the command, see `study.store.options`.
        date: when.
        versions: of Python and packages; None: not installed.
        platform: system, machine and number of cores.
        commit: of the checkout; None for an installed package.
    """

    inputs: list[InputFile]
    command: list[str]
    options: dict[str, Any]
    date: str
    versions: dict[str, str | None]
    platform: str
    commit: str | None


def provenance(case: Case, command: Sequence[str], options: Options) -> Provenance:
    """What must be known to compute a result again.

    Args:
        case: the case; its file and all files that it names are hashed.
        command: the command as it was given.
        options: of the command.
    """
    return origin(input_files(case), case.path.parent, command, options)


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
    return made_by([_input(path, folder) for path in files], command, options)


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


def inputs_of(case: Case) -> list[InputFile]:
    """Name, hash and size of the case file and of every file that it names."""
    return [_input(path, case.path.parent) for path in input_files(case)]


def input_files(case: Case) -> list[pathlib.Path]:
    """The case file and every file that it names, each once."""
    files = [case.path]
    match case.anatomy:
        case IvusAnatomy(states=states, centerline=centerline):
            files += [file for state in states.values() for file in state.files]
            files += [centerline] if centerline is not None else []
        case SurfaceAnatomy(surface=surface):
            files.append(surface)
        case MeshAnatomy(places=places):
            files += [file for place in places for file in files_of(place)]
        case _:
            pass
    files += [c.waveform.path for c in case.conditions.values() if c.waveform is not None]
    return list(dict.fromkeys(files))


def files_of(place: pathlib.Path) -> list[pathlib.Path]:
    """Files of a mesh: those below its folder, or the file and the JSON beside it."""
    if not place.is_dir():
        beside = place.with_suffix(".json")
        return [place, *([beside] if beside.is_file() else [])]
    return sorted(path for path in place.rglob("*") if path.is_file())


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


def _input(path: pathlib.Path, folder: pathlib.Path) -> InputFile:
    inside = path.is_relative_to(folder)
    name = path.relative_to(folder).as_posix() if inside else path.name
    return InputFile(name, sha256(path), path.stat().st_size)


def versions() -> dict[str, str | None]:
    """Versions of Python and of the packages that can move a number; None: not installed."""
    return {"python": platform.python_version(), **{name: installed(name) for name in PACKAGES}}
