"""The tables of a measured record (`record.toml`): what each takes, how its values must agree.

What a case file knows too is spelt as there: `[patient] id`, `[condition.NAME]`, `[surrogate]`,
`waveform`. An older spelling is read as well: `id` above all tables, `[[condition]]` with `name`,
`[prior]`, `file`.
"""

from typing import Any

from lumped.units import MMHG, MMHG_S_PER_ML
from study.case.losses_table import read_losses
from study.case.ostium import LOSS_KEYS, R0, sd_log_of
from study.case.recorded import CONDITION, DRUGS, NOISE, PATIENT
from study.case.schema import FREE_TEXT, spellings
from study.case.table_reader import Context, check_order, contradict, read_free_texts, read_table
from study.case.tables import condition_tables, too_many

TABLES = ("patient", "noise", "surrogate", "condition")
_OLD = ("id", "prior")


def homes() -> dict[str, str]:
    """For each key, the heading of the table that it belongs to."""
    tables = {
        "[condition.NAME]": CONDITION[1:],
        "[noise]": NOISE,
        "[surrogate]": LOSS_KEYS,
        "[patient]": PATIENT,
    }
    return {
        spelled.key: heading
        for heading, keys in tables.items()
        for key in keys
        for spelled in spellings(key)
    }


def read_record_tables(document: dict[str, Any], context: Context) -> dict[str, Any]:
    """Values of a record by table, in mmHg, mL, s; faults go to the context."""
    read_free_texts(document, "file", context)
    _refuse_unknown(document, context)
    noise = read_table(document.get("noise", {}), "noise", NOISE, context)
    for name in ("pressure_sd", "pressure_offset_sd"):
        noise[name] = _clinical(noise[name], MMHG)
    found = [_read_condition(*entry, context) for entry in _conditions(document, context)]
    names = [c["name"] for c in found if c["name"]]
    for name in {n for n in names if names.count(n) > 1}:
        context.add(f"condition.{name}", name, "two conditions have this name", "rename one")
    _check_order_of_conditions(found, context)
    return {
        "id": _read_id(document, context),
        "noise": noise,
        "prior": _read_losses(document, context),
        "condition": found,
    }


def _check_order_of_conditions(found: list[dict[str, Any]], context: Context) -> None:
    """Each condition was measured at a place of its own: its own waveform is found by it."""
    of_place: dict[int, str] = {}
    for condition in found:
        place, heading = condition["order"], condition["heading"]
        if place in of_place:
            problem = f"{of_place[place]} has this place too"
            cure = "give each condition its own order, from 0; or leave all of them out"
            context.add(f"{heading}.order", place, problem, cure)
        of_place.setdefault(place, heading)


def old_spelling(document: dict[str, Any]) -> list[str]:
    """What of a record is in the older spelling, and how it is written in a case file too."""
    conditions = document.get("condition", {})
    tables = conditions if isinstance(conditions, list) else conditions.values()
    old = {
        "id below [patient], not above all tables": "id" in document,
        "[surrogate], not [prior]": "prior" in document,
        "[condition.NAME], not [[condition]] with name": isinstance(conditions, list),
        "waveform, not file": any(isinstance(c, dict) and "file" in c for c in tables),
    }
    return [text for text, given in old.items() if given]


def _refuse_unknown(document: dict[str, Any], context: Context) -> None:
    valid = "tables " + ", ".join(f"[{name}]" for name in TABLES)
    for name, value in document.items():
        if name in (*TABLES, *_OLD, *FREE_TEXT):
            continue
        cure = "remove it, or use a valid table"
        if isinstance(value, dict) and "id" in value:
            cure = "rename it to [patient]"
        elif name in context.homes:
            cure = f"move it below {context.homes[name]}"
        context.add(name, None, "unknown key or table", cure, valid)


def _read_id(document: dict[str, Any], context: Context) -> Any:
    """The name below [patient], or that above all tables."""
    table = document.get("patient", {})
    if "id" not in document:
        return read_table(table, "patient", PATIENT, context)["id"]
    above = read_table({"id": document["id"]}, "record", PATIENT, context)["id"]
    if not isinstance(table, dict) or "id" in table:
        below = read_table(table, "patient", PATIENT, context)["id"]
        if contradict(below, above):
            problem = f'contradicts id = "{below}" below [patient]'
            context.add("id", above, problem, "remove this one")
    else:
        read_table({**table, "id": document["id"]}, "patient", PATIENT, context)
    return above


def _conditions(document: dict[str, Any], context: Context) -> list[tuple[object, int, str, str]]:
    """Table, place, heading and the words for it of each condition."""
    tables = document.get("condition", {})
    if isinstance(tables, list) and tables:
        found = []
        if too_many(tables, context):
            return found
        for place, table in enumerate(tables):
            name = table.get("name", place) if isinstance(table, dict) else place
            heading = f"condition.{name}" if isinstance(name, str) else f"condition[{place}]"
            words = f"in the [[condition]] with name = {name}"
            if name == place:
                words = f"below [[condition]], the {place + 1}. of the file"
            found.append((table, place, heading, words))
        return found
    before = len(context.faults)
    named = {} if tables == [] else condition_tables(tables, context)
    if not named and len(context.faults) == before:
        cure = "write [condition.rest] with period_s, P_systolic_mmHg, P_diastolic_mmHg and ffr"
        context.add("condition", None, "the record has no condition", cure)
    found = []
    for place, (name, table) in enumerate(named.items()):
        heading = f"condition.{name}"
        if contradict(table.get("name", name), name):
            problem = f"the heading says {name}"
            context.add(f"{heading}.name", table["name"], problem, "remove name")
        found.append(({**table, "name": name}, place, heading, f"below [{heading}]"))
    return found


def _clinical(value: Any, factor: float) -> float | None:
    return None if value is None else float(value) / factor


def _read_losses(document: dict[str, Any], context: Context) -> dict[str, Any]:
    """What [surrogate], or in older records [prior], says of the ostium, in mmHg, mL, s."""
    given = [name for name in ("surrogate", "prior") if name in document]
    if not given:
        return {}
    entries = {name: read_losses(document[name], name, LOSS_KEYS, context) for name in given}
    values = entries[given[0]]
    for name in given[1:]:
        for key, value in entries[name].items():
            if contradict(value, values[key]):
                problem = f"contradicts {key} below [{given[0]}]"
                context.add(f"{name}.{key}", None, problem, f"remove it below [{name}]")
            values[key] = value if values[key] is None else values[key]
    if values["R0"] is None:
        if any(value is not None for value in values.values()):
            problem = "K and L are the rest of a curve whose R0 is missing"
            cure = f"add {R0.key} = ... below [{given[0]}] as well"
            context.add(f"{given[0]}.{R0.key}", None, problem, cure, R0.allowed)
        return {}
    return {
        "R0": _clinical(values["R0"], MMHG_S_PER_ML),
        "R0_sd_log": sd_log_of(values["R0_sd_log"]),
        "K": _clinical(values["K"], MMHG),
        "L": _clinical(values["L"], MMHG),
    }


def _read_condition(
    table: object, place: int, heading: str, words: str, context: Context
) -> dict[str, Any]:
    if isinstance(table, dict):
        table = _default_drug(table) | table
    values: dict[str, Any] = read_table(table, heading, CONDITION, context, written=words)
    if isinstance(table, dict):
        order = ("P_diastolic", "P_systolic")
        check_order(values, *order, heading, CONDITION, table, context, apart=True)
    if values["name"] == "rest" and values["drug"] not in (None, "none"):
        problem = "the condition named rest is at rest"
        context.add(f"{heading}.drug", values["drug"], problem, "rename the condition", '"none"')
    for name in ("P_systolic", "P_diastolic", "mean_P_aorta", "mean_P_distal"):
        values[name] = _clinical(values[name], MMHG)
    if values["order"] is None:
        values["order"] = place
    named = "file" if isinstance(table, dict) and "file" in table else "waveform"
    return {**values, "heading": heading, "traces": f"{heading}.{named}"}


def _default_drug(table: dict[str, Any]) -> dict[str, str]:
    """The drug that the name of a condition says: none at rest, else the drug it is named after."""
    name = str(table.get("name"))
    drug = "none" if name == "rest" else name
    return {"drug": drug} if drug in DRUGS else {}
