"""A command as it was given: its options, and what holds for every command."""

import dataclasses
import pathlib
from collections.abc import Mapping
from typing import Generic, TypeVar

from study.store.options import Options

_Options = TypeVar("_Options", bound=Options, covariant=True)


@dataclasses.dataclass(frozen=True)
class Request(Generic[_Options]):
    """A command as it was given.

    Attributes:
        command: its name.
        options: its own options.
        words: the command line.
        out: folder for the output; None: the default of the command.
        json: whether one JSON object is printed, and nothing else.
        quiet: whether nothing but results and complaints is printed.
        dry_run: whether it only says what would be done.
    """

    command: str
    options: _Options
    words: tuple[str, ...]
    out: pathlib.Path | None
    json: bool
    quiet: bool = False
    dry_run: bool = False


@dataclasses.dataclass(frozen=True, kw_only=True)
class ShowOptions(Options):
    """Options of `show`.

    Attributes:
        result: file or folder of a stored result; None where a schema is shown.
        schema: kind of document whose JSON Schema is shown instead of a result.
        beside: folders of results that the interactive page can be switched to.
    """

    result: pathlib.Path | None
    schema: str | None = None
    beside: tuple[pathlib.Path, ...] = ()


@dataclasses.dataclass(frozen=True, kw_only=True)
class ImportOptions(Options):
    """Options of `import-record`.

    Attributes:
        files: `FILE` or `NAME=FILE` of each condition, in the order of measurement.
        columns: column of each role; None: recognised by name.
        unit: of the pressures; None: as the header says, else mmHg.
        time_unit: of the times; None: as the header says, else s.
        rate: samples a second where no column gives times [1/s].
        span: name of a condition, and the times that are used of it [s].
        id: of the patient; None: what the names of the files say.
    """

    files: tuple[str, ...]
    columns: Mapping[str, str] | None = None
    unit: str | None = None
    time_unit: str | None = None
    rate: float | None = None
    span: tuple[tuple[str, float, float], ...] | None = None
    id: str | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class TemplateOptions(Options):
    """Options of `template`.

    Attributes:
        record: whether a record is printed instead of a case.
        schema: whether the JSON Schema of the file is printed instead.
        csv: whether a table of many patients is printed instead of a case.
    """

    record: bool = False
    schema: bool = False
    csv: bool = False


@dataclasses.dataclass(frozen=True, kw_only=True)
class CheckOptions(Options):
    """Options of `check`.

    Attributes:
        cases: case files, records, or folders of records.
    """

    cases: tuple[pathlib.Path, ...]


@dataclasses.dataclass(frozen=True, kw_only=True)
class CacheOptions(Options):
    """Options of `cache`.

    Attributes:
        action: `info` or `clear`.
        yes: whether `clear` removes without asking.
    """

    action: str
    yes: bool = False


@dataclasses.dataclass(frozen=True, kw_only=True)
class DoctorOptions(Options):
    """Options of `doctor`; there are none.

    The class tells that the command takes no input.
    """


@dataclasses.dataclass(frozen=True, kw_only=True)
class CompletionOptions(Options):
    """Options of `completion`.

    Attributes:
        shell: for which the script is.
    """

    shell: str
