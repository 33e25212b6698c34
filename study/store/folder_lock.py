"""A folder in which one process at a time is at work.

The lock is the operating system's (`flock`), on a file in the folder: it is gone with the process,
however that ends. On a shared file system it holds as far as that carries such locks: between hosts
on NFS, but within one host alone where it is mounted with local locks. Where the file system has no
locks at all, `study.store.lock_holder` stands a file for one.
"""

import contextlib
import errno
import os
import pathlib
import stat
from collections.abc import Callable, Iterator

from study.case.faults import CaseError
from study.store.lock_holder import BUSY, HOLDER_FILE, WAIT, hold, lock_refusal

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

LOCK_FILE = ".at-work"

_TAKEN = (errno.EWOULDBLOCK, errno.EAGAIN)
_WITHOUT_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP)
_TRIES = 20
_ELSEWHERE = "remove it, or name another folder with --out"

Release = Callable[[], None]
"""Gives a lock back."""


@contextlib.contextmanager
def at_work(folder: pathlib.Path, tell: Callable[[str], None] | None = None) -> Iterator[None]:
    """Be the only one at work in a folder, which is made if needed.

    A folder that was made here and holds nothing at the end is removed again.

    Args:
        folder: the folder.
        tell: told in a sentence where the file system has no locks.

    Raises:
        CaseError: another process is at work there, or the folder cannot be locked.
    """
    missing = [place for place in (folder, *folder.absolute().parents) if not place.exists()]
    try:
        release = _locked(folder, tell)
        try:
            yield
        finally:
            release()
    finally:
        for place in missing:
            with contextlib.suppress(OSError):  # it holds something
                place.rmdir()


def _locked(folder: pathlib.Path, tell: Callable[[str], None] | None) -> Release:
    path = folder / LOCK_FILE
    for _ in range(_TRIES):
        folder.mkdir(parents=True, exist_ok=True)
        if fcntl is None:
            return _held(folder, "this system has no such locks", tell)
        try:
            handle = _opened(path)
        except FileNotFoundError:  # another process has just removed the folder that it had made
            continue
        try:
            without = _flock(path, handle)
            current = _lies_at(path, handle)
        except BaseException:
            os.close(handle)
            raise
        if not without and current:
            return lambda: _give_back(path, handle)
        if without:
            _give_back(path, handle)
            return _held(folder, without, tell)
        os.close(handle)
    raise lock_refusal(path, "vanishes again and again", "name another folder with --out")


def _opened(path: pathlib.Path) -> int:
    """The lock's file, made if needed, never through a link; its content stays as it is.

    Raises:
        CaseError: it is no regular file, or cannot be opened.
        FileNotFoundError: its folder has gone.
    """
    flags = os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    try:
        try:
            handle = os.open(path, flags | os.O_RDWR, 0o666)
        except PermissionError:  # the file of another user of the folder
            handle = os.open(path, flags | os.O_RDONLY, 0o666)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise _unusable(path, error.strerror or str(error)) from None
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise _unusable(path, "no regular file")
    return handle


def _unusable(path: pathlib.Path, reason: str) -> CaseError:
    kinds = ((path.is_symlink(), "a link"), (path.is_dir(), "a folder"))
    kind = next((name for holds, name in kinds if holds), "")
    if not kind and path.exists() and not path.is_file():
        kind = "no regular file"
    if kind:
        return lock_refusal(path, f"{kind}, where jaxfsi keeps the lock of its folder", _ELSEWHERE)
    cure = "check its permissions, or name another folder with --out"
    return lock_refusal(path, f"the folder cannot be locked: {reason}", cure)


def _flock(path: pathlib.Path, handle: int) -> str:
    """Lock an open file; says why where the file system has no locks, else nothing.

    Raises:
        CaseError: another process holds the lock, or the file system failed.
    """
    assert fcntl is not None
    while True:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return ""
        except InterruptedError:
            continue
        except OSError as error:
            if error.errno in _TAKEN:
                raise lock_refusal(path.parent, BUSY, WAIT) from None
            reason = error.strerror or str(error)
            if error.errno in _WITHOUT_LOCKS:
                return reason
            cure = "check the disk or the network, or name another folder with --out"
            raise lock_refusal(path, f"the folder cannot be locked: {reason}", cure) from None


def _lies_at(path: pathlib.Path, handle: int) -> bool:
    """Whether an open file is the one that lies at a path now."""
    try:
        there = os.stat(path, follow_symlinks=False)
    except FileNotFoundError:
        return False
    return os.path.samestat(there, os.fstat(handle))


def _give_back(path: pathlib.Path, handle: int) -> None:
    """Remove the file while it is locked: whoever has opened it sees that it lies there no more."""
    with contextlib.suppress(OSError):
        if _lies_at(path, handle) and os.fstat(handle).st_size == 0:
            path.unlink()
    os.close(handle)


def _held(folder: pathlib.Path, why: str, tell: Callable[[str], None] | None) -> Release:
    """A file stands for the lock."""
    path = hold(folder)
    if tell is not None:
        tell(
            f"no locks in {folder} ({why}): the file {HOLDER_FILE} stands for one; should this "
            "process be killed, another host cannot know that it has ended"
        )

    return lambda: path.unlink(missing_ok=True)
