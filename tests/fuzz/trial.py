"""One damaged input: its files, the command that gets it, and what must become of it."""

import dataclasses
import os
import pathlib
from typing import Literal

Expected = Literal["refused", "same", "either"]
"""`refused`: exit status 2; `same`: the numbers of the good input; `either`: both are right."""


@dataclasses.dataclass(frozen=True)
class Link:
    """A symbolic link in place of a file."""

    target: str


@dataclasses.dataclass(frozen=True)
class Folder:
    """A folder in place of a file."""


@dataclasses.dataclass(frozen=True)
class Fifo:
    """A named pipe that nobody writes to, in place of a file."""


Content = bytes | Link | Folder | Fifo
Files = dict[str, Content]


@dataclasses.dataclass(frozen=True)
class Trial:
    """A damaged input.

    Attributes:
        kind: class of input, such as `case`.
        operator: what was done to it.
        key: where.
        expected: what must become of it, by the construction of the damage.
        files: its files by path below the folder of the trial.
        argv: arguments of the command; `{}` is the folder of the trial.
        stop: steps at whose beginning the input counts as accepted; `*` is any step.
        blame: files, with | between, of which a refusal must name one.
        like: name of the good result whose numbers must come out, where those are expected.
        limit: seconds that the command may take.
        keep: files whose content must be the same afterwards, whatever the command says.
    """

    kind: str
    operator: str
    key: str
    expected: Expected
    files: Files
    argv: tuple[str, ...]
    stop: tuple[str, ...] = ()
    blame: str = ""
    like: str = ""
    limit: float = 60.0
    keep: tuple[str, ...] = ()

    def arguments(self, folder: pathlib.Path) -> list[str]:
        """The arguments of the command for a folder."""
        return [text.replace("{}", str(folder)) for text in self.argv]

    def write(self, folder: pathlib.Path) -> None:
        """Write the files into a folder, which is made."""
        folder.mkdir(parents=True)
        for name, content in self.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            match content:
                case Link(target):
                    path.symlink_to(target)
                case Folder():
                    path.mkdir()
                case Fifo():
                    os.mkfifo(path)
                case _:
                    path.write_bytes(content)


def tree(folder: pathlib.Path) -> dict[str, tuple[int, int]]:
    """Size and time of change of everything below a folder, by path."""
    found = {}
    for root, folders, files in os.walk(folder):
        for name in (*folders, *files):
            path = pathlib.Path(root, name)
            entry = path.lstat()
            is_file = name in files
            found[str(path.relative_to(folder))] = (
                (entry.st_size, entry.st_mtime_ns) if is_file else (-1, 0)
            )
    return found
