"""The tables of a case file and of a record in the order of their templates, with their keys.

Template, JSON Schema and reference page are made from these.
"""

import inspect
from typing import NamedTuple

from study.case.anatomy import KINDS, MODELS
from study.case.blood import BloodParameters
from study.case.body import BodyParameters
from study.case.condition import Condition
from study.case.ostium import OstiumLosses
from study.case.parameters import (
    CoronaryParameters,
    MeshOptions,
    PatientParameters,
    SolverOptions,
    StressParameters,
    SurrogateParameters,
    TissueParameters,
    WallParameters,
    WindkesselParameters,
)
from study.case.recorded import NoiseParameters, Recorded
from study.case.schema import Key, keys_of
from study.case.uncertainty import UncertaintyParameters

CONDITION_SLOT = "condition.NAME"


class FileTable(NamedTuple):
    """A table of a file.

    Attributes:
        heading: its dotted name; NAME stands for any name.
        keys: that it takes, besides the free texts.
        text: what the table is, in paragraphs.
        kind: the kind of anatomy that it describes; empty for other tables.
    """

    heading: str
    keys: tuple[Key, ...]
    text: str
    kind: str = ""


def _section(heading: str, model: type, *, without: str = "") -> FileTable:
    keys = tuple(key for key in keys_of(model) if key.name != without)
    return FileTable(heading, keys, inspect.cleandoc(model.__doc__ or ""))


CASE = (
    _section("patient", PatientParameters),
    _section("body", BodyParameters),
    *(
        FileTable("anatomy", keys, inspect.cleandoc(MODELS[kind].__doc__ or ""), kind)
        for kind, keys in KINDS.items()
    ),
    _section("blood", BloodParameters),
    _section("wall", WallParameters),
    _section("tissue", TissueParameters),
    _section(CONDITION_SLOT, Condition),
    _section("coronary", CoronaryParameters),
    _section("surrogate", SurrogateParameters),
    _section("stress", StressParameters),
    _section("windkessel", WindkesselParameters),
    _section("mesh", MeshOptions),
    _section("solver", SolverOptions),
    _section("uncertainty", UncertaintyParameters),
)
"""Tables of a case file."""

RECORD = (
    _section("patient", PatientParameters),
    _section("surrogate", OstiumLosses),
    _section("noise", NoiseParameters),
    _section(CONDITION_SLOT, Recorded, without="name"),
)
"""Tables of a record."""
