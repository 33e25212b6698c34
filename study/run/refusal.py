"""What a source of `jaxfsi` refuses, as a fault of the file that it is about."""

import pathlib
from collections.abc import Iterator
from contextlib import contextmanager

from study.case.faults import CaseError, Fault


@contextmanager
def refusing(file: pathlib.Path, *others: pathlib.Path) -> Iterator[None]:
    """Turn the refusal of a source into a fault of the file that it names, else of the first.

    Args:
        file: of the source.
        others: further files that a refusal may begin with.
    """
    try:
        yield
    except CaseError:
        raise
    except ValueError as error:
        named = [other for other in others if str(error).startswith(f"{other}: ")]
        raise CaseError([file_fault((*named, file)[0], error)]) from error


def file_fault(file: pathlib.Path, error: Exception) -> Fault:
    """An error in two parts, "what happened. What to try.", as a fault of a file."""
    text = " ".join(str(error).split())
    for place in (f"{file}: ", f"{file} "):
        text = text.removeprefix(place)
    problem, _, cure = text.rstrip(".").rpartition(". ")
    if not problem:
        problem, cure = cure, "correct the file, or what the case says of it"
    return Fault(file, "", None, problem, "", cure[:1].lower() + cure[1:])
