"""Which column of an export holds what, and in which unit: recognised by name, or told by a map."""

import dataclasses
import pathlib
import re
from collections.abc import Mapping, Sequence

from study.case.catheter.table import ConsoleTable, refusal
from study.case.catheter.units import PRESSURE_UNITS, TIME_UNITS

ROLES = ("time", "aortic", "distal", "flow")
"""What a column may hold; flow in mL/min."""

_NAMES = {
    "time": {"time", "t", "zeit", "temps", "tiempo", "sec", "seconds", "timestamp", "s"},
    "aortic": {
        "p_aortic", "p_aorta", "aortic", "aorta", "pa", "p_a", "pao", "p_ao", "ao",
        "paorta", "paortic", "aortic_pressure", "pressure_aortic", "aop",
    },
    "distal": {
        "p_distal", "distal", "pd", "p_d", "distal_pressure", "pressure_distal", "wire",
        "p_wire", "pw", "pdistal", "pdist", "p_dist", "pwire",
    },
    "flow": {"q_coronary", "coronary_flow"},
}  # fmt: skip
"""Names that are recognised, units and channels taken off."""

_CHANNEL = re.compile(r"^(p|ch|channel|kanal)_?\d+_")
"""Channel of a console before the name, as in `P1 Ao`."""

_WRITTEN = re.compile(r"[\[(]\s*([^\])]*?)\s*[\])]|_(mmhg|kpa|s|ms|ml_per_min)$", re.IGNORECASE)
_SPELT = {
    "mmhg": "mmHg", "mm hg": "mmHg", "kpa": "kPa", "s": "s", "sec": "s", "second": "s",
    "seconds": "s", "ms": "ms", "msec": "ms", "min": "min", "ml/min": "ml/min",
    "ml_per_min": "ml/min",
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class ExportFormat:
    """What a user says about the columns of exports.

    Attributes:
        columns: name or number, from 0, of the column of each role; empty: recognised.
        pressure_unit: of the pressures; None: as the header says, else mmHg.
        time_unit: of the times; None: as the header says, else s.
        rate: samples a second, where no column gives times [1/s].
    """

    columns: Mapping[str, str] = dataclasses.field(default_factory=dict)
    pressure_unit: str | None = None
    time_unit: str | None = None
    rate: float | None = None


@dataclasses.dataclass(frozen=True)
class ChosenColumns:
    """Columns of a table.

    Attributes:
        index: column of each role that the table has.
        pressure_mmHg: one unit of its pressures, in mmHg.
        time_s: one unit of its times, in s.
        names: names of these columns in the table, without those that have none.
    """

    index: Mapping[str, int]
    pressure_mmHg: float
    time_s: float
    names: Mapping[str, str]


def column_map(text: str) -> dict[str, str]:
    """`time=0,aortic=2,distal=p_wire` as the column of each role.

    Raises:
        ValueError: it is no such list, or a role is unknown or given twice.
    """
    found: dict[str, str] = {}
    for part in text.split(","):
        role, sign, place = (piece.strip() for piece in part.partition("="))
        if role not in ROLES or not sign or not place:
            raise ValueError(f"{part.strip()!r} is not ROLE=COLUMN; roles: {', '.join(ROLES)}")
        if role in found:
            raise ValueError(f"{role} is given twice")
        found[role] = place
    return found


def choose_columns(table: ConsoleTable, given: ExportFormat) -> ChosenColumns:
    """Find time, aortic and distal pressure among the columns of a table.

    Args:
        table: the export.
        given: what the user says of it.

    Raises:
        CaseError: a column is missing, or there are two for one role, or units contradict.
    """
    index: dict[str, int] = {}
    for role in ROLES:
        if role in given.columns:
            index[role] = _mapped(table, role, given.columns[role])
        elif role != "time" or given.rate is None:
            found = _recognised(table, role)
            if found is not None:
                index[role] = found
    needed = ("aortic", "distal") if given.rate else ("time", "aortic", "distal")
    missing = [role for role in needed if role not in index]
    if missing:
        _refuse_missing(table, missing, index)
    for role, at in index.items():
        twins = [other for other, place in index.items() if place == at and other != role]
        if twins:
            problem = f"one column is taken for {role} and {twins[0]}"
            raise refusal(table.path, problem, "correct --columns", value=at)
    pressures = {_unit(table, index[role], PRESSURE_UNITS) for role in ("aortic", "distal")}
    pressures.discard(None)
    if len(pressures) > 1 and given.pressure_unit is None:
        problem = "the two pressures are in different units"
        raise refusal(table.path, problem, "export both in mmHg")
    stated = given.pressure_unit or next(iter(pressures), None)
    clock = given.time_unit or ("time" in index and _unit(table, index["time"], TIME_UNITS)) or "s"
    names = {role: table.header[at] for role, at in index.items() if table.header[at]}
    return ChosenColumns(index, PRESSURE_UNITS[stated or "mmHg"], TIME_UNITS[clock], names)


def _refuse_missing(table: ConsoleTable, missing: Sequence[str], index: Mapping[str, int]) -> None:
    roles = " or ".join(missing)
    problem = (
        f"no column is recognised as {roles}"
        if any(table.header)
        else f"the columns have no names, so that none is known to be {roles}"
    )
    names = ", ".join(f"{k}: {name or '?'}" for k, name in enumerate(table.header))
    example = ",".join(f"{role}={at}" for role, at in _likely(table, index).items())
    cure = f"say which they are, such as --columns {example}; the columns are {names}"
    if missing == ["time"]:
        cure += "; or give the sampling rate: --rate 100"
    raise refusal(table.path, problem, cure)


def _likely(table: ConsoleTable, index: Mapping[str, int]) -> dict[str, int]:
    """Columns for an example: recognised ones, then pressures by their unit, then the next."""
    free = [k for k in range(len(table.header)) if k not in index.values()]
    pressures = [k for k in free if _unit(table, k, PRESSURE_UNITS)]
    found = dict(index)
    for role in ("time", "aortic", "distal"):
        fitting = free if role == "time" else pressures or free
        if role not in found and fitting:
            found[role] = fitting[0]
            free = [k for k in free if k != found[role]]
            pressures = [k for k in pressures if k != found[role]]
    return {role: found[role] for role in ROLES if role in found}


def _mapped(table: ConsoleTable, role: str, place: str) -> int:
    if place.isdecimal() and int(place) < len(table.header):
        return int(place)
    header = list(enumerate(table.header))
    named = [k for k, name in header if place.lower() in (name.lower(), _bare(name))]
    named = named or [k for k, name in header if _bare(place) and _bare(place) == _bare(name)]
    if len(named) == 1:
        return named[0]
    problem = "two columns have this name" if named else "there is no such column"
    names = ", ".join(f"{k}: {name or '?'}" for k, name in enumerate(table.header))
    cure = f"give its number or name: {names}"
    raise refusal(table.path, problem, cure, key=f"--columns {role}", value=place)


def _recognised(table: ConsoleTable, role: str) -> int | None:
    found = [k for k, said in enumerate(table.roles) if said == role]
    found = found or [k for k, name in enumerate(table.header) if _is_named(name, role)]
    if len(found) > 1:
        names = ", ".join(f"{k}: {table.header[k]}" for k in found)
        cure = f"choose one, such as --columns {role}={found[0]}"
        raise refusal(table.path, f"two columns may be {role} ({names})", cure)
    return found[0] if found else None


def _is_named(name: str, role: str) -> bool:
    bare = _bare(name)
    return not _NAMES[role].isdisjoint({bare, _CHANNEL.sub("", bare)})


def _bare(name: str) -> str:
    """A name in small letters without its unit."""
    plain = _WRITTEN.sub("", name.strip())
    return re.sub(r"[^a-z0-9/]+", "_", plain.lower()).strip("_")


def _unit(table: ConsoleTable, k: int, known: Mapping[str, float]) -> str | None:
    found = _WRITTEN.search(table.header[k].strip())
    written = [part for part in found.groups() if part] if found else []
    for text in (*written, table.units[k].strip("[]() ")):
        unit = _SPELT.get(text.lower())
        if unit in known:
            return unit
    return None


def check_files(paths: Sequence[pathlib.Path]) -> None:
    """Refuse a file that is named twice.

    Raises:
        CaseError: which.
    """
    seen: set[pathlib.Path] = set()
    for path in paths:
        place = path.resolve()
        if place in seen:
            raise refusal(path, "the file is named twice", "name each file once")
        seen.add(place)
