"""Whether an installation works: packages, machine, caches, folders; each fault with its cure.

What must be tried out to be known, compiling and meshing, is in `study.run.health_trials`.
"""

import dataclasses
import importlib.metadata
import os
import pathlib
import platform
import shutil
import tempfile
from collections.abc import Iterator

from filelock import FileLock, Timeout
from packaging.requirements import Requirement

from study.store.cache_contents import cache_contents, cache_problem, size_words
from study.store.cache_folder import VARIABLE, cache_folder
from study.store.provenance import commit
from study.store.result_files import HOLDER_FILE, LOCK_FILE

_LEAST_MEMORY = 4 * 2**30
"""Memory below which a run in 3D may not fit [bytes]."""

_LEAST_SPACE = 2**30
"""Free space below which results may not fit [bytes]."""

_SHOWN = ("numpy", "scipy", "jax", "jaxlib", "equinox", "diffrax", "optimistix", "lineax")
_MESHING = ("netgen-mesher", "mmgpy", "meshio", "pyvista", "trimesh")
_CGROUP = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")
_DEEPEST = 3
"""Levels of folders below the working folder in which locks are looked for."""


@dataclasses.dataclass(frozen=True)
class Finding:
    """What was found of one thing.

    Attributes:
        name: of the thing.
        found: what it is.
        problem: what is wrong with it; empty: nothing.
        cure: what to try.
    """

    name: str
    found: str
    problem: str = ""
    cure: str = ""


def packages() -> Iterator[Finding]:
    """Versions, and packages that are missing or too old."""
    yield Finding("Python", f"{platform.python_version()}, {platform.platform()}")
    known = commit()
    own = _version("jaxfsi") or "not installed"
    yield Finding("jaxfsi", own + (f", commit {known}" if known else ""))
    for title, names in (("packages", _SHOWN), ("meshers", _MESHING)):
        found = ", ".join(f"{name} {_version(name) or '-'}" for name in names)
        yield Finding(title, found)
    for text in _required():
        needed = Requirement(text)
        if needed.marker is not None and not needed.marker.evaluate({"extra": ""}):
            continue
        version, cure = _version(needed.name), f"pip install '{needed.name}{needed.specifier}'"
        if version is None:
            yield Finding(needed.name, "not installed", "a package that jaxfsi needs", cure)
        elif not needed.specifier.contains(version, prereleases=True):
            yield Finding(needed.name, version, f"not {needed.specifier}", cure)


def _required() -> list[str]:
    try:
        return importlib.metadata.requires("jaxfsi") or []
    except importlib.metadata.PackageNotFoundError:
        return []


def _version(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def machine() -> Iterator[Finding]:
    """Cores and memory."""
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    yield Finding("cores", f"{usable} of {os.cpu_count()} may be used{load}")
    memory = _memory()
    if memory is None:
        yield Finding("memory", "the system does not say")
        return
    problem = "" if memory >= _LEAST_MEMORY else "little for a run in 3D"
    cure = "use --preset coarse, or a larger machine; 0D needs less than 1 GiB" if problem else ""
    yield Finding("memory", size_words(memory), problem, cure)


def _memory() -> int | None:
    """Memory of the machine, or what this process may use of it [bytes]."""
    found = []
    try:
        found.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, ValueError, OSError):
        return None
    for name in _CGROUP:
        try:
            found.append(int(pathlib.Path(name).read_text()))
        except (OSError, ValueError):
            continue
    return min(found)


def folders() -> Iterator[Finding]:
    """Cache, temporary folder and working folder: whether they can be written, and their space."""
    cache = cache_folder()
    problem, cure = cache_problem() or ("", "")
    if cache is None:
        yield Finding("cache", f"off: {VARIABLE}" if not problem else "none", problem, cure)
    else:
        contents = cache_contents(cache)
        size = size_words(sum(content.size for content in contents.values()))
        files = sum(content.files for content in contents.values())
        yield Finding("cache", f"{cache}, {files} files, {size}", problem, cure)
    temporary, here = pathlib.Path(tempfile.gettempdir()), pathlib.Path.cwd()
    yield _place("temporary files", temporary, "name another folder: TMPDIR=DIR")
    yield _place("working folder", here, "go to another folder, or name one with --out")


def _place(name: str, folder: pathlib.Path, cure: str) -> Finding:
    try:
        free = shutil.disk_usage(folder).free
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        return Finding(name, str(folder), f"cannot be written: {error.strerror or error}", cure)
    found = f"{folder}, {size_words(free)} free"
    if free < _LEAST_SPACE:
        return Finding(name, found, "little space", f"free some space, or {cure}")
    return Finding(name, found)


def locks() -> Iterator[Finding]:
    """Locks in the working folder and below: at work, or left by a process that was killed."""
    count = 0
    for path in _lock_files(pathlib.Path.cwd(), _DEEPEST):
        count += 1
        yield _lock(path)
    if not count:
        yield Finding("locks", f"none in {pathlib.Path.cwd()} and below")


def _lock_files(folder: pathlib.Path, levels: int) -> Iterator[pathlib.Path]:
    try:
        entries = sorted(folder.iterdir())
    except OSError:
        return
    for path in entries:
        if path.name in (LOCK_FILE, HOLDER_FILE) and path.is_file() and not path.is_symlink():
            yield path
        elif levels > 0 and path.is_dir() and not path.is_symlink():
            yield from _lock_files(path, levels - 1)


def _lock(path: pathlib.Path) -> Finding:
    if path.name == HOLDER_FILE:
        problem = "stands for a lock where the file system has none"
        return Finding("lock", str(path), problem, f"if no jaxfsi is at work there, remove {path}")
    lock = FileLock(path, timeout=0, thread_local=False)
    try:
        lock.acquire()
    except (Timeout, OSError):
        return Finding("lock", f"{path}: a jaxfsi is at work there")
    lock.release()
    return Finding("lock", f"{path}: left by a process that was killed; the next one takes it")
