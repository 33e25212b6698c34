"""How bad files are refused and good ones written: one clear error, never half a file."""

import contextlib
import lzma
import os
import pathlib
import struct
import warnings
import xml.etree.ElementTree as ET
import xml.parsers.expat
import zlib
from collections.abc import Iterator

from jaxfsi.text_files import why
from lumped.whole_files import staging


class MeshFileError(ValueError):
    """A mesh file that cannot be read or written; says what happened and what to try."""


_LARGEST_FILE = 1 << 28  # bytes: a binary mesh of five million tetrahedra

# What parsers raise on truncated or foreign bytes.
_PARSER_ERRORS = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    DeprecationWarning,
    EOFError,
    LookupError,
    MemoryError,
    OSError,
    RecursionError,
    lzma.LZMAError,
    ET.ParseError,
    TypeError,
    ValueError,
    struct.error,
    xml.parsers.expat.ExpatError,
    zlib.error,
)


def _errors_of_meshio() -> tuple[type[Exception], ...]:
    """What meshio raises; imported here, since many commands read no mesh."""
    import meshio

    return (meshio.ReadError,)


@contextlib.contextmanager
def reading(path: pathlib.Path, kind: str) -> Iterator[None]:
    """Turn whatever a parser raises on a bad file into one error that names the file.

    Args:
        path: file that is read.
        kind: what it should be, for the message.

    Raises:
        MeshFileError: no such file, an empty one, or one that cannot be parsed.
    """
    if not path.is_file():
        raise MeshFileError(f"there is no file {path}. Check the name and the folder.")
    size = path.stat().st_size
    if size == 0:
        raise MeshFileError(f"{path} is empty. Write the {kind} again.")
    if size > _LARGEST_FILE:
        raise MeshFileError(
            f"{path} has {size} bytes; files up to {_LARGEST_FILE} are read. Write a coarser mesh,"
            " or a compressed file."
        )
    try:
        with warnings.catch_warnings():
            # numpy reports numbers that it cannot parse as a deprecation.
            warnings.simplefilter("error", DeprecationWarning)
            yield
    except MeshFileError:
        raise
    except (*_PARSER_ERRORS, *_errors_of_meshio()) as error:
        raise MeshFileError(
            f"{path} cannot be read as {kind}: {why(error)}. It may be truncated or of another"
            " format; write it again."
        ) from error


@contextlib.contextmanager
def staged(target: pathlib.Path) -> Iterator[pathlib.Path]:
    """A folder to write files in; they move beside the target when all of them are complete.

    Args:
        target: the main file; it is moved last, so that what it refers to is there before it.

    Raises:
        MeshFileError: the folder of the target does not exist.
    """
    if not target.parent.is_dir():
        raise MeshFileError(f"there is no folder {target.parent}. Make it first.")
    with staging(target.parent) as folder:
        yield folder
        for path in sorted(folder.iterdir(), key=lambda path: path.name == target.name):
            os.replace(path, target.parent / path.name)
