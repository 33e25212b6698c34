"""Files and folders that appear complete or not at all.

Both are written under a hidden name beside their place and then renamed, which file systems do in
one piece: a reader never sees half of either, and whoever is interrupted leaves the older one.
"""

import contextlib
import os
import pathlib
import shutil
import tempfile
import threading
from collections.abc import Iterator

STAGING_PREFIX = ".writing-"
"""How the name of a folder begins that is still being filled."""


def write_whole(
    path: pathlib.Path, content: bytes | str, *, lasting: bool = False, shared: bool = False
) -> None:
    """Write a file under a temporary name in its folder, then rename it.

    Args:
        path: file to write; an old one is replaced.
        content: what to write; text becomes UTF-8.
        lasting: wait until it is on disk, so that it also survives a loss of power.
        shared: other processes or threads may write the same file now, as in a cache.
    """
    own = f".{os.getpid()}-{threading.get_ident()}" if shared else ""
    part = path.with_name(f".{path.name}{own}.part")
    try:
        with part.open("wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
            if lasting:
                file.flush()
                os.fsync(file.fileno())
        os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    if lasting and os.name == "posix":
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


@contextlib.contextmanager
def staging(parent: pathlib.Path, prefix: str = STAGING_PREFIX) -> Iterator[pathlib.Path]:
    """A hidden folder to write in; what is complete moves from there to its place beside it.

    Args:
        parent: the folder in which it is made, and which the results move to.
        prefix: how its name begins.

    Yields:
        The folder; what has not moved at the end is removed with it.
    """
    stage = pathlib.Path(tempfile.mkdtemp(prefix=prefix, dir=parent))
    try:
        yield stage
    finally:
        shutil.rmtree(stage, ignore_errors=True)
