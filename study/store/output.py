"""Output files: a folder checked before any work, and files that appear whole or not at all."""

import contextlib
import os
import pathlib
import shutil
import signal
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping

TEMPORARY_SUFFIX = ".part"
"""Ending of a file that is still being written."""


Before = Callable[[Collection[str]], None]
"""Called when everything is written, before it takes its place, with the names that it takes."""


class OutputRefused(ValueError):
    """The output folder cannot be used; nothing was computed and nothing was written."""


def check_folder(folder: pathlib.Path) -> pathlib.Path:
    """Refuse a folder that cannot be made or written to; nothing is made yet.

    Raises:
        OutputRefused: cause and cure.
    """
    if folder.exists() and not folder.is_dir():
        raise OutputRefused(
            f"{folder}: the output would lie here, but this is a file. Name another folder: --out."
        )
    nearest = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not nearest.is_dir() or not os.access(nearest, os.W_OK):
        raise OutputRefused(
            f"{folder}: no permission to write below {nearest}. Name another folder: --out."
        )
    return folder


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Let a signal that would end the process wait for the end of the block."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    signals = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def write_files(
    folder: pathlib.Path, files: Mapping[str, str], *, before: Before | None = None
) -> list[pathlib.Path]:
    """Write texts into a folder, all of them or none.

    Every file is first written in full under a temporary name in the same folder, then all are
    renamed; the last one named is renamed last, so that it marks a complete set. When anything
    fails before that, older files stay as they were and the temporary ones (and the folder, if
    it was made here) are removed.

    Args:
        folder: where to write; made if needed.
        files: text of each file by name.
        before: makes way for them, see `study.store.earlier_run`.

    Returns:
        The paths written.
    """
    missing = [place for place in (folder, *folder.absolute().parents) if not place.exists()]
    staged: dict[pathlib.Path, pathlib.Path] = {}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            staged[_stage(folder, name, text)] = folder / name
        with uninterrupted():
            if before is not None:
                before(list(files))
            for part, path in staged.items():
                os.replace(part, path)
    except BaseException:
        for part in staged:
            part.unlink(missing_ok=True)
        for place in missing:
            if place.is_dir() and not any(place.iterdir()):
                place.rmdir()
        raise
    return list(staged.values())


def write_tree(
    folder: pathlib.Path,
    fill: Callable[[pathlib.Path], None],
    files: Mapping[str, str],
    *,
    before: Before | None = None,
) -> list[pathlib.Path]:
    """Write files and folders, all of them or none.

    Everything is first written into a temporary folder beside its place, then moved; what was
    there under the same names is replaced. When anything fails before that, older files stay as
    they were and the temporary folder (and the folder, if it was made here) is removed.

    Args:
        folder: where to write; made if needed.
        fill: writes files and folders into the folder that it is given.
        files: texts by name, written after `fill`; the last one is moved last, so that it marks a
            complete set.
        before: makes way for them, see `study.store.earlier_run`.

    Returns:
        The paths written, the last of `files` last.
    """
    missing = [place for place in (folder, *folder.absolute().parents) if not place.exists()]
    stage: pathlib.Path | None = None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        stage = pathlib.Path(tempfile.mkdtemp(suffix=TEMPORARY_SUFFIX, prefix=".", dir=folder))
        fill(stage)
        for name, text in files.items():
            (stage / name).write_text(text, encoding="utf-8", newline="\n")
        order = list(files)
        made = sorted(stage.iterdir(), key=lambda path: (path.name in order, path.name))
        made.sort(key=lambda path: order.index(path.name) if path.name in order else -1)
        with uninterrupted():
            if before is not None:
                before([path.name for path in made])
            return [_moved(path, folder / path.name, stage) for path in made]
    finally:
        if stage is not None:
            shutil.rmtree(stage, ignore_errors=True)
        for place in missing:
            if place.is_dir() and not any(place.iterdir()):
                place.rmdir()


def _moved(path: pathlib.Path, place: pathlib.Path, stage: pathlib.Path) -> pathlib.Path:
    """Move a finished file or folder to its place; an old folder there makes way first."""
    if place.is_dir() or (path.is_dir() and place.exists()):
        os.replace(place, stage / f".old-{place.name}")
    os.replace(path, place)
    return place


def _stage(folder: pathlib.Path, name: str, text: str) -> pathlib.Path:
    """Write a text under a temporary name; it is on disk when this returns."""
    handle, part = tempfile.mkstemp(prefix=f".{name}.", suffix=TEMPORARY_SUFFIX, dir=folder)
    path = pathlib.Path(part)
    try:
        with open(handle, "w", encoding="utf-8", newline="\n") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        mask = os.umask(0)
        os.umask(mask)
        path.chmod(0o666 & ~mask)
    except BaseException:
        path.unlink(missing_ok=True)
        raise
    return path
