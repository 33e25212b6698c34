"""Reading the case of one patient from its file.

A case file is TOML; `study.case.template` shows every key. All faults of a file are
reported together.
"""

import dataclasses
import os
import pathlib
from collections.abc import Iterable, Mapping
from typing import Any

from study.case.blood import BloodParameters
from study.case.body import BodyParameters
from study.case.condition import Condition
from study.case.faults import CaseError, Fault
from study.case.model import Case
from study.case.parameters import (
    CoronaryParameters,
    MeshOptions,
    SolverOptions,
    StressParameters,
    SurrogateParameters,
    TissueParameters,
    WallParameters,
    WindkesselParameters,
)
from study.case.schema import FREE_TEXT
from study.case.table_reader import Context
from study.case.tables import key_homes, read_tables
from study.case.toml_file import read_document
from study.case.uncertainty import UncertaintyParameters


def read_case(path: str | os.PathLike[str]) -> Case:
    """Read a case file.

    Args:
        path: the TOML file.

    Returns:
        The case, in CGS.

    Raises:
        CaseError: the file cannot be read or holds faults; all of them are listed.
    """
    file = pathlib.Path(path)
    return case_of(read_document(file), file)


def case_of(document: Mapping[str, Any], file: pathlib.Path) -> Case:
    """The case that a parsed document describes.

    Args:
        document: its tables.
        file: where it stands; files that it names lie relative to it.

    Raises:
        CaseError: it holds faults; all of them are listed.
    """
    context = Context(file, [], {key: {} for key in FREE_TEXT}, key_homes())
    values = read_tables(document, context)
    if context.faults:
        raise CaseError(context.faults)
    return _build(file, values, context.texts)


def read_cases(paths: Iterable[pathlib.Path]) -> list[Case]:
    """Read several case files.

    Args:
        paths: the TOML files.

    Raises:
        CaseError: the faults of all files.
    """
    cases: list[Case] = []
    faults: list[Fault] = []
    for path in paths:
        try:
            cases.append(read_case(path))
        except CaseError as error:
            faults += error.faults
    if faults:
        raise CaseError(faults)
    return cases


def _build(file: pathlib.Path, values: Mapping[str, Any], texts: dict[str, dict[str, str]]) -> Case:
    return Case(
        path=file,
        id=values["patient"]["id"],
        anatomy=values["anatomy"],
        wall=WallParameters(**values["wall"], tissue=TissueParameters(**values["tissue"])),
        conditions={n: Condition(name=n, **entry) for n, entry in values["condition"].items()},
        coronary=CoronaryParameters(**values["coronary"]),
        surrogate=SurrogateParameters(**values["surrogate"]),
        solver=SolverOptions(**values["solver"]),
        source=texts["source"],
        blood=BloodParameters(**values["blood"]),
        stress=StressParameters(**values["stress"]),
        windkessel=WindkesselParameters(**values["windkessel"]),
        mesh=_mesh_options(values),
        uncertainty=UncertaintyParameters(**values["uncertainty"]),
        notes=texts["notes"],
        body=BodyParameters(**values["body"]),
        from_body=values["from_body"],
    )


def _mesh_options(values: Mapping[str, Any]) -> MeshOptions:
    """Options of the mesh; a wall that bends stands in columns of at least one layer.

    One layer of quadratic tetrahedra bends as one of wedges does, so both get the same nodes.
    """
    given = MeshOptions(**values["mesh"])
    if values["wall"]["element"] == "linear":
        return given
    return dataclasses.replace(given, wedge_layers=max(1, given.wedge_layers))
