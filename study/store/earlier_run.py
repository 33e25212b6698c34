"""What earlier commands left in a folder: moved aside as a whole, or removed.

Files of two results never lie side by side. A result makes way in one step: all its files are first
collected under a temporary name (hard links, so that this takes neither time nor space), which is
then renamed to `earlier-1`, `earlier-2`, ...; only then do they leave the folder, the page first. A
page that stands therefore has its files at every instant.
"""

import contextlib
import os
import pathlib
import shutil
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any

from lumped.whole_files import staging
from study.case.faults import CaseError
from study.store.identity import identity
from study.store.result_files import (
    CHECKPOINT_FILE,
    FIELD_FOLDER,
    HISTORY_FILE,
    KINDS,
    SHEAR_FILE,
    kept_files,
    shown_files,
)
from study.store.stored_document import load_document

EARLIER = "earlier-"
"""How the names of the folders of earlier results begin."""

_PART = ".earlier-"
_COMPUTED = (CHECKPOINT_FILE, HISTORY_FILE, SHEAR_FILE)


def clear_run(folder: pathlib.Path) -> None:
    """Remove what a run computed in a folder."""
    for name in _COMPUTED:
        (folder / name).unlink(missing_ok=True)
    for path in (folder / FIELD_FOLDER).glob("fields*"):
        path.unlink()


def set_run_aside(folder: pathlib.Path) -> pathlib.Path | None:
    """Move all files of a run of `simulate` into a sub-folder of its own.

    Returns:
        The sub-folder; None where there was no run.
    """
    return set_aside(folder, [*shown_files("simulate", {}), *kept_files("simulate", {})])


def can_go_on(folder: pathlib.Path) -> bool:
    """Whether a run lies in a folder that the same command can go on with."""
    return (folder / CHECKPOINT_FILE).exists()


def make_way(
    folder: pathlib.Path,
    document: Mapping[str, Any],
    tell: Callable[[str], None],
    names: Collection[str] = (),
) -> None:
    """Set aside the results of a folder that a new one would overwrite and that are not its own.

    A result of the same command makes way where it follows from other inputs or options
    (`study.store.identity`), one of another command where the two share names of files. What the
    command goes on with stays as well as being set aside.

    Args:
        folder: the folder.
        document: the new result, or its `kind` and `provenance`.
        tell: told where results went, in a sentence.
        names: files and folders that are about to be written.
    """
    for kind, standing in overwritten(folder, document, names):
        shown, kept = shown_files(kind, standing), kept_files(kind, standing)
        place = set_aside(folder, [*shown, *kept], keep=kept)
        if place is not None:
            why = _why(kind, standing, document)
            tell(f"moved the earlier result of {kind}, {why}, to {place}")


def overwritten(
    folder: pathlib.Path, document: Mapping[str, Any], names: Collection[str] = ()
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Kind and document of the results that make way, one by one; see `make_way`."""
    for kind in KINDS:
        standing = _standing(folder, kind)
        if standing is None:
            continue
        if kind == document["kind"]:
            new = identity(document)
            differs = new is None or identity(standing) != new
        else:
            differs = not set(shown_files(kind, standing)).isdisjoint(names)
        if differs:
            yield kind, standing


def _why(kind: str, standing: Mapping[str, Any], document: Mapping[str, Any]) -> str:
    """Why a result makes way, in a few words."""
    if standing and kind == document["kind"] and identity(standing) is None:
        return "by a version of jaxfsi that did not store its options"
    return "of other input or options"


def make_way_for_page(
    folder: pathlib.Path, document: Mapping[str, Any], page: str, tell: Callable[[str], None]
) -> None:
    """Set aside the result of a folder whose page is about to be overwritten, unless it is shown.

    Args:
        folder: the folder.
        document: the result that is shown.
        page: its page.
        tell: told where the result of the folder went, in a sentence.
    """
    kind = document["kind"] if document["kind"] in KINDS else "run"
    standing = _standing(folder, kind)
    if standing is None or standing == document:
        return
    old = folder / next((name for name in KINDS[kind].shown if name.endswith(".html")), "")
    if not standing and old.is_file() and old.read_text(encoding="utf-8") == page:
        return
    kept = kept_files(kind, standing)
    place = set_aside(folder, [*shown_files(kind, standing), *kept], keep=kept)
    if place is not None:
        tell(f"moved another result of {kind} to {place}")


def _standing(folder: pathlib.Path, kind: str) -> dict[str, Any] | None:
    """The document of a result that stands in a folder, empty where it cannot be read.

    None where there is no such result.
    """
    file = folder / KINDS[kind].document
    if not any((folder / name).exists() for name in (file.name, *KINDS[kind].shown)):
        return None
    try:
        found = load_document(file)
        names = [*shown_files(kind, found), *kept_files(kind, found)]
    except (CaseError, ValueError, TypeError, AttributeError, KeyError):
        return {}
    return found if all(_plain(name) for name in names) else {}


def _plain(name: object) -> bool:
    """Whether this is the name of a file of a folder, and of nothing elsewhere."""
    return (
        isinstance(name, str)
        and pathlib.PurePath(name).name == name
        and name.isprintable()
        and 0 < len(name.encode()) < 256
    )


def set_aside(
    folder: pathlib.Path, names: Sequence[str], *, keep: Collection[str] = ()
) -> pathlib.Path | None:
    """Move files and folders into a sub-folder of their own, numbered by age.

    Args:
        folder: where they lie.
        names: what to move, in the order in which it leaves the folder.
        keep: those among them that stay as well.

    Returns:
        The sub-folder; None where nothing was there.
    """
    for left in folder.glob(f"{_PART}*"):  # of a process that was killed here
        shutil.rmtree(left, ignore_errors=True)
    own = [name for name in dict.fromkeys(names) if _plain(name)]
    paths = [folder / name for name in own if (folder / name).exists()]
    if not paths:
        return None
    with staging(folder, _PART) as part:
        for path in paths:
            _collect(path, part / path.name)
        part.chmod(folder.stat().st_mode & 0o777)
        place = folder / f"{EARLIER}{_latest(folder) + 1}"
        os.replace(part, place)
    for path in paths:
        if path.name in keep:
            continue
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()
    return place


def _latest(folder: pathlib.Path) -> int:
    numbers = [path.name.removeprefix(EARLIER) for path in folder.glob(f"{EARLIER}*")]
    return max((int(number) for number in numbers if number.isdecimal()), default=0)


def _collect(path: pathlib.Path, place: pathlib.Path) -> None:
    """Put a file or a folder at a second place, earlier results inside it left out."""
    if path.is_dir() and not path.is_symlink():
        ignore = shutil.ignore_patterns(f"{EARLIER}*", f"{_PART}*")
        shutil.copytree(path, place, copy_function=_link, symlinks=True, ignore=ignore)
    else:
        _link(path, place)


def _link(path: str | pathlib.Path, place: str | pathlib.Path) -> None:
    with contextlib.suppress(OSError, NotImplementedError):
        os.link(path, place, follow_symlinks=False)
        return
    shutil.copy2(path, place, follow_symlinks=False)
