"""A folder in which one process at a time is at work, by `filelock`.

The lock is the operating system's (`flock`), on a file in the folder: it is gone with the process,
however that ends. On a shared file system it holds as far as that carries such locks: between hosts
on NFS, but within one host alone where it is mounted with local locks. Where the file system has no
locks at all, a file that names host and process stands for one: one whose process is gone is
replaced on the same host; one of another host cannot be judged from here.
"""

import contextlib
import errno
import os
import pathlib
import time
from collections.abc import Callable, Iterator

from filelock import FileLock, SoftFileLock, Timeout

from study.case.faults import CaseError, Fault
from study.store.result_files import HOLDER_FILE, LOCK_FILE

_WITHOUT_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP)
_TRIES = 20
_PATIENCE = 0.2  # seconds in which a lock that is just being given back becomes free
_ALL_MAY_LOCK = 0o666  # the folder's other users too
_BUSY = "another jaxfsi is at work in this folder"
_WAIT = "wait until it ends, end it, or name another folder with --out"
_OURS = "where jaxfsi keeps the lock of its folder"
_ELSEWHERE = "remove it, or name another folder with --out"
_DISK = "check the disk, the network and the folder's permissions, or name another one with --out"

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
        _check_kind(path)
        held: list[os.stat_result] = []
        lock = FileLock(
            path,
            timeout=_PATIENCE,
            mode=_ALL_MAY_LOCK,
            thread_local=False,
            fallback_to_soft=False,
            on_acquired=lambda handle, held=held: held.append(os.fstat(handle)),
        )
        try:
            lock.acquire()
        except (FileNotFoundError, InterruptedError):
            continue  # another process has just removed the folder that it had made, or a signal
        except Timeout:
            raise _refusal(folder, _BUSY, _WAIT) from None
        except OSError as error:
            reason = error.strerror or str(error)
            if error.errno in _WITHOUT_LOCKS:
                _remove_empty(path)
                return _marked(folder, reason, tell)
            _check_kind(path)
            raise _refusal(path, f"the folder cannot be locked: {reason}", _DISK) from None
        return lambda: _give_back(lock, path, held[0])
    raise _refusal(path, "vanishes again and again", "name another folder with --out")


def _give_back(lock: FileLock, path: pathlib.Path, held: os.stat_result) -> None:
    """Remove the file while it is locked: whoever has opened it sees that it lies there no more."""
    with contextlib.suppress(OSError):
        if os.path.samestat(path.lstat(), held):
            _remove_empty(path)
    lock.release()


def _remove_empty(path: pathlib.Path) -> None:
    """Remove a file without content: what holds something is none of ours."""
    with contextlib.suppress(OSError):
        if path.lstat().st_size == 0:
            path.unlink()


def _marked(folder: pathlib.Path, why: str, tell: Callable[[str], None] | None) -> Release:
    """A file stands for the lock."""
    path = folder / HOLDER_FILE
    _check_kind(path)
    lock = SoftFileLock(path, timeout=_PATIENCE, mode=_ALL_MAY_LOCK, thread_local=False)
    try:
        lock.acquire()
    except Timeout:
        cure = f"{_WAIT}; if it has ended, remove {path}"
        raise _refusal(folder, f"{_BUSY} ({_holder(path)})", cure) from None
    except OSError as error:
        reason = error.strerror or str(error)
        raise _refusal(path, f"the folder cannot be locked: {reason}", _DISK) from None
    if tell is not None:
        tell(
            f"no locks in {folder} ({why}): the file {HOLDER_FILE} stands for one; should this "
            "process be killed, another host cannot know that it has ended"
        )
    return lock.release


def _holder(path: pathlib.Path) -> str:
    """Who holds a file that stands for a lock, as `filelock` puts it down: process, host, ..."""
    process, host, since = "unknown", "unknown", "unknown"
    with contextlib.suppress(OSError, ValueError):
        since = time.strftime("%Y-%m-%d %H:%M:%S %z", time.localtime(path.lstat().st_mtime))
        process, host, *_ = path.read_text(encoding="utf-8").splitlines()
    return f"process {process} on {host} since {since}"


def _check_kind(path: pathlib.Path) -> None:
    """Refuse what is no file in the place of a lock's file; links are not followed.

    Raises:
        CaseError: says what lies there.
    """
    kinds = ((path.is_symlink(), "a link"), (path.is_dir(), "a folder"))
    kind = next((name for holds, name in kinds if holds), "")
    if not kind and path.exists() and not path.is_file():
        kind = "no regular file"
    if kind:
        raise _refusal(path, f"{kind}, {_OURS}", _ELSEWHERE)


def _refusal(path: pathlib.Path, problem: str, cure: str) -> CaseError:
    return CaseError([Fault(path, "", None, problem, "", cure)])
