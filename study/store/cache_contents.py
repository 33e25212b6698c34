"""What lies in the cache folder: compiled code, meshes, durations; counted, or removed.

Only what jaxfsi and the compiler write there is known by its name; other files stay, whatever
folder was named. Links are not followed.
"""

import contextlib
import dataclasses
import os
import pathlib
import re
import shutil
import stat
import tempfile
from collections.abc import Iterator

from study.store.cache_folder import VARIABLE, cache_folder

_COMPILED = re.compile(r"[^/]+-[0-9a-f]{64}-(cache|atime|program)")
_MESH = re.compile(r"[0-9a-f]{32}")
_SMALL = ("durations.json", "numerics.json")
_MESHES = "meshes"
KINDS = ("compiled code", "meshes", "durations and digests")
"""What a cache holds."""


@dataclasses.dataclass
class Content:
    """Entries of a kind.

    Attributes:
        paths: files, or the folder of each mesh.
        files: number of files.
        size: of all [bytes].
    """

    paths: list[pathlib.Path] = dataclasses.field(default_factory=list)
    files: int = 0
    size: int = 0


def cache_contents(folder: pathlib.Path) -> dict[str, Content]:
    """What of a cache folder is ours, by kind; empty where there is no folder.

    Args:
        folder: the cache folder.
    """
    found = {kind: Content() for kind in KINDS}
    for path in _entries(folder):
        if _COMPILED.fullmatch(path.name):
            _count(found["compiled code"], path)
        elif path.name in _SMALL:
            _count(found["durations and digests"], path)
    meshes = folder / _MESHES
    if not meshes.is_symlink():
        for path in _entries(meshes):
            if _MESH.fullmatch(path.name):
                _count(found["meshes"], path)
    return found


def clear_cache(folder: pathlib.Path) -> tuple[int, list[str]]:
    """Remove what of a cache folder is ours.

    Args:
        folder: the cache folder.

    Returns:
        Number of files that were removed, and the names of entries that could not be.
    """
    removed, failed = 0, []
    for content in cache_contents(folder).values():
        for path in content.paths:
            inside = _files(path)
            try:
                if path.is_dir():
                    shutil.rmtree(path)
                else:
                    path.unlink(missing_ok=True)
                removed += len(inside)
            except OSError as error:
                failed.append(f"{path}: {error.strerror or error}")
    for place in (folder / _MESHES, folder):
        with contextlib.suppress(OSError):  # it holds something, or there is none
            if not place.is_symlink():
                place.rmdir()
    return removed, failed


def cache_problem() -> tuple[str, str] | None:
    """Why nothing can be kept in the cache folder, and what to try; None where all is well."""
    folder = cache_folder()
    if folder is None:
        if os.environ.get(VARIABLE) is not None:
            return None  # as asked for
        return "there is no home folder to keep it in", f"name a folder: {VARIABLE}=DIR"
    cure = f"make it writable, or name another folder: {VARIABLE}=DIR"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return None
    except OSError as error:
        return f"nothing can be written to {folder}: {error.strerror or error}", cure


def size_words(size: int) -> str:
    """A size in words: 14.2 MiB."""
    for unit in ("bytes", "KiB", "MiB"):
        if size < 1024:
            return f"{size:.3g} {unit}"
        size /= 1024  # pyright: ignore[reportAssignmentType]
    return f"{size:.3g} GiB"


def _entries(folder: pathlib.Path) -> Iterator[pathlib.Path]:
    with contextlib.suppress(OSError):
        yield from sorted(folder.iterdir())


def _count(content: Content, path: pathlib.Path) -> None:
    inside = _files(path)
    if inside or (path.is_dir() and not path.is_symlink()):
        content.paths.append(path)
        content.files += len(inside)
        content.size += sum(inside)


def _files(path: pathlib.Path) -> list[int]:
    """Sizes of the files of an entry; nothing for a link or what is gone."""
    sizes = []
    with contextlib.suppress(OSError):
        mode = path.lstat().st_mode
        if stat.S_ISREG(mode):
            return [path.lstat().st_size]
        if stat.S_ISDIR(mode):
            for file in path.rglob("*"):
                if file.is_file() and not file.is_symlink():
                    sizes.append(file.stat().st_size)
    return sizes
