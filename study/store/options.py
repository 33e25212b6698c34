"""Options of the commands whose results are stored, one frozen dataclass a command.

A document holds the options that it was made with (`provenance.options`). They say, together with
the content of its input files, whether two results may take each other's place
(`study.store.identity`), and a finished study is opened again with them.
"""

import dataclasses
import pathlib
from collections.abc import Mapping
from typing import Any, Literal, NamedTuple, TypeVar

from study.case.demo import demo_case_path

_INPUT = {"role": "input"}
"""Of an option that names an input: the content of the file counts, not its name."""

_NO_EFFECT = {"role": "no effect"}
"""Of an option that changes no number of the result."""

Mode = Literal["curve", "3d"]

_Options = TypeVar("_Options", bound="Options")


class AlphaRange(NamedTuple):
    """Values of α in equal ratios.

    Attributes:
        low: first value [-].
        high: last value [-].
        n: number of values.
    """

    low: float
    high: float
    n: int


@dataclasses.dataclass(frozen=True, kw_only=True)
class Options:
    """Options of a command."""

    @classmethod
    def of(cls: type[_Options], values: Mapping[str, Any]) -> _Options:
        """Take the options of a command from values by name; others are left out.

        Raises:
            KeyError: an option is missing.
        """
        return cls(**{f.name: values[f.name] for f in dataclasses.fields(cls)})

    @classmethod
    def read(cls: type[_Options], stored: Mapping[str, Any]) -> _Options:
        """Options as a document holds them; those that it does not know have their default.

        Raises:
            TypeError: an option without a default is missing, or a value is of another kind.
        """
        known = {f.name: f for f in dataclasses.fields(cls) if f.name in stored}
        return cls(**{name: _read(stored[name], f) for name, f in known.items()})

    def stored(self) -> dict[str, Any]:
        """The options as a document holds them."""
        return {f.name: _plain(getattr(self, f.name)) for f in dataclasses.fields(self)}

    @classmethod
    def deciding(cls) -> frozenset[str]:
        """Names of the options that can change the result, inputs left out."""
        return frozenset(f.name for f in dataclasses.fields(cls) if not f.metadata.get("role"))


def _plain(value: Any) -> Any:
    if isinstance(value, pathlib.PurePath):
        return str(value)
    return list(value) if isinstance(value, list | tuple) else value


def _read(value: Any, field: dataclasses.Field[Any]) -> Any:
    if value is not None and field.metadata == _INPUT:
        if not isinstance(value, str):
            raise TypeError(f"{value!r} is not the path of a file")
        return pathlib.Path(value)
    value = tuple(value) if isinstance(value, list) else value
    return field.metadata.get("read", lambda known: known)(value)


@dataclasses.dataclass(frozen=True, kw_only=True)
class CaseOptions(Options):
    """Options of every command on a case.

    Attributes:
        case: the case file; None: the bundled one.
        demo: whether the bundled case is used.
    """

    case: pathlib.Path | None = dataclasses.field(default=None, metadata=_INPUT)
    demo: bool = False


def case_path(options: CaseOptions) -> pathlib.Path:
    """The case file that options name."""
    return demo_case_path() if options.case is None else options.case


@dataclasses.dataclass(frozen=True, kw_only=True)
class RunOptions(CaseOptions):
    """Options of `run`.

    Attributes:
        mesh: whether a coarse mesh is made as well; None: for the bundled case alone.
        uncertainty: whether each FFR gets an interval.
    """

    mesh: bool | None = None
    uncertainty: bool = False


@dataclasses.dataclass(frozen=True, kw_only=True)
class CalibrateOptions(CaseOptions):
    """Options of `calibrate`."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class WallOptions(CaseOptions):
    """Options of `calibrate-wall`.

    Attributes:
        fit: states to fit; None: the first two after that of the mesh.
        free: what is fitted; None: all moduli and the support.
        preset: size of the mesh; None: as the case says.
        course: length from the ostium that is compared [mm].
        contour_error: relative standard deviation of a contour's area and minor axis [-].
    """

    fit: tuple[str, ...] | None = None
    free: tuple[str, ...] | None = None
    preset: str | None = None
    course: float = 10.0
    contour_error: float = 0.05


@dataclasses.dataclass(frozen=True, kw_only=True)
class SweepOptions(CaseOptions):
    """Options of `sweep`.

    Attributes:
        alpha: values of α.
        condition: name of the condition.
        rule: stress rule; None: that of the case.
    """

    alpha: AlphaRange = dataclasses.field(metadata={"read": AlphaRange._make})
    condition: str = "rest"
    rule: str | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class MeshCommandOptions(CaseOptions):
    """Options of `mesh`; None: as the case says.

    Attributes:
        state: states to mesh, or `all`; None: the first.
        preset: size of the mesh.
        elements_across: at least so many over the lumen.
        wall_layers: layers of the wall.
        backend: mesher of the volume.
        unit: of the mesh files.
        format: kinds of mesh files.
    """

    state: tuple[str, ...] | None = None
    preset: str | None = None
    elements_across: int | None = None
    wall_layers: int | None = None
    backend: str | None = None
    unit: str | None = None
    format: tuple[str, ...] = ("vtu",)


@dataclasses.dataclass(frozen=True, kw_only=True)
class SimulateOptions(CaseOptions):
    """Options of `simulate`; None: as the case says.

    Attributes:
        rigid: whether the wall is left out.
        condition: name of the condition.
        state: state of the anatomy; None: the first.
        preset: size of the mesh.
        dt: longest step [s].
        cycles: cycles, or a part of one.
        alpha: scale of the anomalous outlet [-]; None: as calibrated.
        restart: whether a run in the folder is left aside.
    """

    rigid: bool = False
    condition: str = "rest"
    state: str | None = None
    preset: str | None = None
    dt: float | None = None
    cycles: float | None = None
    alpha: float | None = None
    restart: bool = dataclasses.field(default=False, metadata=_NO_EFFECT)


@dataclasses.dataclass(frozen=True, kw_only=True)
class StudyOptions(CaseOptions):
    """Options of `study`; None: as the case says, or the default.

    Attributes:
        preset: size of the mesh.
        dt: longest step [s].
        cycles: cycles of each run.
        continued: whether stress goes on from the end of rest.
        rules: stress rules to run.
        conditions: conditions under stress to run; None: all.
        nominal: whether every condition is also run with α = 1.
        sensitivities: conditions whose ratio in 3D is differentiated.
        paper: whether rest is also run with the α of the linear surrogate.
        ramp_rate: rate of the ramp [mmHg/s].
        quick: coarse mesh, long steps, a fast ramp, one stress condition.
        uncertainty: runs in 3D with drawn numbers of each condition, for an interval of each FFR;
            None: no interval.
        mesh_error: whether the ramp is also made on a second mesh; None: unless `quick`.
    """

    preset: str | None = None
    dt: float | None = None
    cycles: int | None = None
    continued: bool = False
    rules: tuple[str, ...] | None = None
    conditions: tuple[str, ...] | None = None
    nominal: bool = False
    sensitivities: tuple[str, ...] | None = None
    paper: bool | None = None
    ramp_rate: float | None = None
    quick: bool = False
    uncertainty: int | None = None
    mesh_error: bool | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class WhatIfOptions(CaseOptions):
    """Options of `what-if`.

    Attributes:
        operation: `unroof` or `reimplant`; None: a stent.
        stent: its diameter [mm]; 0: that of the artery beyond its intramural course.
        mode: `0d` or `3d`.
        study: finished study before the operation; None: it is made.
        preset: size of the mesh in 3D; None: as the case says.
        quick: in 3D, as for `study`.
    """

    operation: Literal["unroof", "reimplant"] | None = None
    stent: float | None = None
    mode: Literal["0d", "3d"] = "0d"
    study: pathlib.Path | None = dataclasses.field(default=None, metadata=_INPUT)
    preset: str | None = None
    quick: bool = False


@dataclasses.dataclass(frozen=True, kw_only=True)
class CohortOptions(Options):
    """Options of `cohort`.

    Attributes:
        folder: of the cases, or their CSV file; None: the bundled ones.
        demo: whether the bundled cases are used.
        mode: `curve` in 0D, `3d` the whole algorithm.
        workers: cases at a time; None: one a core.
        executor: where they run, see `study.run.executor_choice`.
        emit_jobs: folder for an array of jobs that runs them; None: they are run now.
        gather: whether none is run, and those that are finished are shown.
        options: further options of the command of each case.
    """

    folder: pathlib.Path | None = dataclasses.field(default=None, metadata=_INPUT)
    demo: bool = False
    mode: Mode = "curve"
    workers: int | None = dataclasses.field(default=None, metadata=_NO_EFFECT)
    executor: str = dataclasses.field(default="local", metadata=_NO_EFFECT)
    emit_jobs: pathlib.Path | None = dataclasses.field(default=None, metadata=_NO_EFFECT)
    gather: bool = dataclasses.field(default=False, metadata=_NO_EFFECT)
    options: tuple[str, ...] | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class RecordOptions(Options):
    """Options of every command on a record.

    Attributes:
        record: folder or file of the record.
        case: case file or finished study that R0 is taken from.
    """

    record: pathlib.Path = dataclasses.field(metadata=_INPUT)
    case: pathlib.Path | None = dataclasses.field(default=None, metadata=_INPUT)


@dataclasses.dataclass(frozen=True, kw_only=True)
class DiagnoseOptions(RecordOptions):
    """Options of `diagnose`.

    Attributes:
        richness: no more of the record is used; None: all.
        in_3d: conditions to run in 3D as well, none for all; None: 0D alone.
    """

    richness: str | None = None
    in_3d: tuple[str, ...] | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlanOptions(RecordOptions):
    """Options of `plan-measurement`."""


KINDS: dict[str, type[Options]] = {
    "run": RunOptions,
    "calibrate": CalibrateOptions,
    "wall": WallOptions,
    "sweep": SweepOptions,
    "mesh": MeshCommandOptions,
    "simulate": SimulateOptions,
    "study": StudyOptions,
    "what-if": WhatIfOptions,
    "cohort": CohortOptions,
    "diagnose": DiagnoseOptions,
    "plan": PlanOptions,
}
"""By what a document says under `kind`."""
