"""A folder in which one process at a time is at work.

The lock is the operating system's, on a file in the folder: it is gone with the process, however
that ends. Where there are no such locks, nothing is locked.
"""

import contextlib
import pathlib
from collections.abc import Iterator

from study.faults import CaseError, Fault

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

LOCK_FILE = ".at-work"


@contextlib.contextmanager
def at_work(folder: pathlib.Path) -> Iterator[None]:
    """Be the only one at work in a folder, which is made if needed.

    Raises:
        CaseError: another process is.
    """
    if fcntl is None:
        yield
        return
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / LOCK_FILE).open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            problem = "another jaxfsi is at work in this folder"
            cure = "wait until it ends, end it, or name another folder with --out"
            raise CaseError([Fault(folder, "", None, problem, "", cure)]) from None
        yield
