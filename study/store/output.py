"""Output files: a folder checked before any work, and files that appear whole or not at all."""

import contextlib
import os
import pathlib
import signal
from collections.abc import Callable, Collection, Iterator, Mapping

from lumped.whole_files import staging, write_whole

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
    folder: pathlib.Path,
    files: Mapping[str, str],
    *,
    fill: Callable[[pathlib.Path], None] | None = None,
    before: Before | None = None,
) -> list[pathlib.Path]:
    """Write files and folders, all of them or none.

    Everything is first written into a temporary folder beside its place, then moved; what was
    there under the same names is replaced. When anything fails before that, older files stay as
    they were and the temporary folder (and the folder, if it was made here) is removed.

    Args:
        folder: where to write; made if needed.
        files: texts by name; on disk before any takes its place. The last one is moved last, so
            that it marks a complete set.
        fill: writes more files and folders into the folder that it is given, before the texts.
        before: makes way for them, see `study.store.earlier_run`.

    Returns:
        The paths written, the last of `files` last.
    """
    missing = [place for place in (folder, *folder.absolute().parents) if not place.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with staging(folder) as stage:
            if fill is not None:
                fill(stage)
            for name, text in files.items():
                write_whole(stage / name, text, lasting=True)
            others = sorted(path.name for path in stage.iterdir() if path.name not in files)
            names = [*others, *files]
            with uninterrupted():
                if before is not None:
                    before(names)
                return [_moved(stage / name, folder / name) for name in names]
    finally:
        for place in missing:
            if place.is_dir() and not any(place.iterdir()):
                place.rmdir()


def _moved(path: pathlib.Path, place: pathlib.Path) -> pathlib.Path:
    """Move a finished file or folder to its place; an old folder there makes way first."""
    if place.is_dir() or (path.is_dir() and place.exists()):
        os.replace(place, path.with_name(f".old-{place.name}"))
    os.replace(path, place)
    return place
