"""The tables of a case file: which there are, what each takes, and how its values must agree."""

import dataclasses
import re
from collections.abc import Mapping, Sequence, Sized
from typing import Any, get_args, get_type_hints

from study.case.advice import nearest
from study.case.anatomy import KINDS
from study.case.anatomy_tables import read_anatomy
from study.case.beat_file import read_beat
from study.case.blood import BloodParameters
from study.case.body import BodyParameters
from study.case.combinations import check_case
from study.case.condition import CONDITION, CONDITION_NAME, MOST_CONDITIONS
from study.case.faults import printable, shown_key
from study.case.from_body import Usual, complete, fill_rest, supplied_at_rest
from study.case.laws import CARREAU_YASUDA, FIBRES
from study.case.losses_table import read_losses
from study.case.ostium import K
from study.case.parameters import (
    STRESS_FACTORS,
    CoronaryParameters,
    MeshOptions,
    PatientParameters,
    SolverOptions,
    StressParameters,
    SurrogateParameters,
    ThicknessBounds,
    TissueParameters,
    WallParameters,
    WindkesselParameters,
)
from study.case.schema import FREE_TEXT, Key, Quantity, Value, keys_of, spellings
from study.case.table_reader import Context, check_order, read_free_texts, read_table
from study.case.uncertainty import UncertaintyParameters

PLAIN: dict[str, type] = {
    "patient": PatientParameters,
    "body": BodyParameters,
    "blood": BloodParameters,
    "tissue": TissueParameters,
    "coronary": CoronaryParameters,
    "surrogate": SurrogateParameters,
    "windkessel": WindkesselParameters,
    "mesh": MeshOptions,
    "solver": SolverOptions,
    "uncertainty": UncertaintyParameters,
}
"""Class of each table without sub-tables or words that exclude each other."""

WALL, THICKNESS, STRESS = (
    keys_of(WallParameters),
    keys_of(ThicknessBounds),
    keys_of(StressParameters),
)
_LAWS = get_args(get_type_hints(WallParameters)["material"])
_FIBRE_KEYS = tuple(
    key
    for key in WALL
    if isinstance(key, Quantity) and key.field in ("k1", "k2", "fibre_angle", "dispersion")
)
TABLES = ("patient", "anatomy", "blood", "wall", "condition", *PLAIN, "stress")
_OUTPUT_SLACK = 0.1
"""Stroke volume and cardiac output are rounded, and of neighbouring minutes."""


def key_homes() -> dict[str, str]:
    """For each key, the heading of its tables; of the kinds of anatomy, of the first."""
    tables: list[tuple[str, Sequence[Key]]] = [
        ("[condition.NAME]", CONDITION),
        *((f"[{name}]", keys_of(model)) for name, model in PLAIN.items()),
        ("[wall]", WALL),
        ("[stress]", STRESS),
        *((f'[anatomy] with kind = "{kind}"', keys) for kind, keys in KINDS.items()),
    ]
    homes: dict[str, str] = {}
    for heading, keys in tables:
        for key in (spelled for one in keys for spelled in spellings(one)):
            if len(key.key) == 1:  # a letter is no name to recognise
                continue
            other = homes.setdefault(key.key, heading)
            if heading not in other and "kind" not in heading:
                homes[key.key] = f"{other} or {heading}"
    return homes | {"kind": "[anatomy]"}


def read_tables(document: Mapping[str, Any], context: Context) -> dict[str, Any]:
    """Read all tables of a case; faults go to the context.

    Args:
        document: the parsed file.
        context: where faults and free texts are collected.

    Returns:
        Values by name for each table, numbers in CGS; `condition` holds one such mapping for each
        condition, `anatomy` the anatomy or None.
    """
    read_free_texts(document, "file", context)
    meant = _refuse_unknown_tables(document, context)
    values: dict[str, Any] = {}
    for name, model in PLAIN.items():
        if name in document or name not in meant:
            reading = read_losses if name == "surrogate" else read_table
            values[name] = reading(document.get(name, {}), name, keys_of(model), context)
    values["anatomy"] = (
        read_anatomy(document["anatomy"], context) if "anatomy" in document else None
    )
    values["wall"] = _read_wall(document.get("wall", {}), context)
    usual = Usual(BodyParameters(**values.get("body", {})))
    values["condition"] = _read_conditions(document.get("condition", {}), usual, context)
    values["stress"] = _read_stress(document.get("stress", {}), context)
    values["from_body"] = complete(usual, values, document, context)
    check_case(values, document, context)
    _check_laws(document, context)
    _check_fibres(document.get("wall"), context)
    _check_thinning(values.get("blood"), context)
    return values


def _check_laws(document: Mapping[str, Any], context: Context) -> None:
    """Refuse numbers of a law that is not chosen."""
    tables = {
        name: table if isinstance(table := document.get(name), dict) else {}
        for name in ("surrogate", "blood", "wall")
    }
    surrogate, blood, wall = tables.values()
    if "law" not in surrogate and any(key.key in surrogate for key in spellings(K)):
        context.add(
            "surrogate.law",
            None,
            "a quadratic loss K is given, but not whether to use it",
            'add law = "quadratic" to use it, or law = "linear" to leave it out',
            '"linear" | "quadratic"',
        )
    thinning = [key.key for key in keys_of(BloodParameters)[3:] if key.key in blood]
    if "law" not in blood and thinning:
        context.add(
            "blood.law",
            None,
            f"{thinning[0]} is given, but not whether to use it",
            f'add law = "{CARREAU_YASUDA}" to use it, or law = "newtonian" to leave it out',
            f'"newtonian" | "{CARREAU_YASUDA}"',
        )
    penalty, stiff = "volumetric_penalty_dyn_per_cm2", "saint_venant_kirchhoff"
    if penalty in wall and wall.get("material", stiff) != stiff:
        problem = f"the law {wall['material']} has no such penalty"
        cure = f'remove it, or write material = "{stiff}"'
        context.add(f"wall.{penalty}", wall[penalty], problem, cure)


def _check_fibres(wall: object, context: Context) -> None:
    """Refuse numbers of fibres in a wall that has none, and fibres of no stiffness."""
    table = wall if isinstance(wall, dict) else {}
    law = table.get("material", WallParameters.material)
    given = [key.key for key in _FIBRE_KEYS if table.get(key.key, key.usual) != key.usual]
    if law not in _LAWS:
        return  # refused already
    if given and law != FIBRES:
        problem = f"the law {law} has no fibres"
        cure = f'remove {" and ".join(given)}, or write material = "{FIBRES}"'
        context.add(f"wall.{given[0]}", table[given[0]], problem, cure)
    elif law == FIBRES and not any(table[name] for name in table if name.startswith("k1")):
        problem = "the fibres have no stiffness"
        cure = "give k1; typical are 2e4 for the media of a carotid, 1e7 for an adventitia"
        context.add("wall.k1_dyn_per_cm2", table.get("k1_dyn_per_cm2"), problem, cure, "above 0")


def _check_thinning(blood: Mapping[str, Any] | None, context: Context) -> None:
    """Refuse blood that is thinner at rest than in motion."""
    at_rest, fast = (blood or {}).get("mu_zero"), (blood or {}).get("mu_infinite")
    if at_rest is not None and fast is not None and at_rest <= fast:
        problem = f"not above mu_inf_poise = {fast:g}: blood thins with the shear rate"
        cure = "check both values; swap them if they were exchanged"
        context.add("blood.mu_0_poise", at_rest, problem, cure, "above mu_inf_poise")


def _refuse_unknown_tables(document: Mapping[str, Any], context: Context) -> set[str]:
    """Refuse tables that do not exist; returns those that were probably meant."""
    meant: set[str] = set()
    condition_keys = {key.key for key in CONDITION}
    valid = "tables " + ", ".join(f"[{table}]" for table in dict.fromkeys(TABLES))
    for name, value in document.items():
        if name in TABLES or name in FREE_TEXT:
            continue
        close = nearest(name, TABLES)
        if isinstance(value, dict) and condition_keys & set(value):
            cure = f"a condition is written [condition.{shown_key(name)}]"
        elif name in context.homes:
            cure = f"move it below {context.homes[name]}"
        elif close:
            cure = f"the nearest valid table is [{close}]"
            meant.add(close)
        else:
            cure = "remove it, or use a valid table"
        what = "table" if isinstance(value, dict) else "key"
        shown = None if isinstance(value, dict) else value
        context.add(shown_key(name), shown, f"unknown {what}", cure, valid)
    return meant


def _read_wall(table: object, context: Context) -> dict[str, Value]:
    thickness: dict[str, Value] = {"min": None, "max": None}
    heading = "wall.thickness_per_radius"
    rest = table
    if isinstance(table, dict) and isinstance(table.get("thickness_per_radius"), dict):
        local = table["thickness_per_radius"]
        rest = {name: value for name, value in table.items() if name != "thickness_per_radius"}
        thickness = read_table(local, heading, THICKNESS, context)
        check_order(thickness, "min", "max", heading, THICKNESS, local, context)
    values = read_table(rest, "wall", WALL, context)
    values["thickness_per_radius"] = thickness.get("factor", values["thickness_per_radius"])
    return values | {"thickness_min": thickness["min"], "thickness_max": thickness["max"]}


def _read_conditions(table: object, usual: Usual, context: Context) -> dict[str, dict[str, Any]]:
    """Every condition; that at rest is there without its table where the body tells it."""
    tables = condition_tables(table, context)
    if usual.has("P_systolic", "P_diastolic", "period"):
        tables = {"rest": tables.get("rest", {}), **tables}
    return {name: _read_condition(name, value, usual, context) for name, value in tables.items()}


def too_many(conditions: Sized, context: Context) -> bool:
    """Whether there are more conditions than a file may have, which is a fault."""
    if len(conditions) <= MOST_CONDITIONS:
        return False
    problem, cure = "more conditions than one patient has", "keep those of one examination"
    context.add("condition", len(conditions), problem, cure, f"at most {MOST_CONDITIONS}")
    return True


def condition_tables(table: object, context: Context) -> dict[str, dict[str, Any]]:
    """The table below each heading [condition.NAME]; faults go to the context."""
    if not isinstance(table, dict):
        cure = "write each condition as a table of its own, [condition.rest]"
        context.add("condition", None, "a table for each condition is expected", cure)
        return {}
    if too_many(table, context):
        return {}
    read_free_texts(table, "condition", context)
    conditions: dict[str, dict[str, Any]] = {}
    for name, value in table.items():
        place = f"condition.{shown_key(name)}"
        if name in FREE_TEXT:
            continue
        if not isinstance(value, dict):
            cure = "put it below the heading of a condition, such as [condition.rest]"
            context.add(place, value, "the key belongs to no condition", cure)
        elif not re.fullmatch(CONDITION_NAME, name):
            cure = f"rename it, e.g. [condition.{re.sub(r'[^A-Za-z0-9]+', '_', name)[:40] or 'a'}]"
            allowed = "a letter, then letters, digits, _ and -, at most 40"
            context.add(place, None, "not a valid name of a condition", cure, allowed)
        elif name.lower() == "rest" and name != "rest":
            cure = "write [condition.rest], in small letters"
            context.add(place, None, "the condition at rest is named rest", cure)
        else:
            conditions[name] = value
    return conditions


def _read_condition(
    name: str, table: Mapping[str, Any], usual: Usual, context: Context
) -> dict[str, Any]:
    heading = f"condition.{name}"
    kind = "rest" if name == "rest" else "stress"
    told = supplied_at_rest(usual, table, context) if kind == "rest" else ()
    keys = [dataclasses.replace(k, required=k.required and k.field not in told) for k in CONDITION]
    n_faults = len(context.faults)
    values: dict[str, Any] = dict(read_table(table, heading, keys, context))
    if kind == "rest" and len(context.faults) == n_faults:
        given = {k.field: any(one.key in table for one in spellings(k)) for k in CONDITION}
        fill_rest(usual, values, given)
    if values["kind"] not in (None, kind):
        cure = f'remove kind, or write kind = "{kind}"; only [condition.rest] is at rest'
        problem = f"a condition named {printable(name)} is of kind {kind}"
        context.add(f"{heading}.kind", table["kind"], problem, cure, f'"{kind}"')
    values["kind"] = kind
    check_order(values, "P_diastolic", "P_systolic", heading, CONDITION, table, context, apart=True)
    _check_output(values, heading, table, context)
    path, period, P_systolic = values["waveform"], values["period"], values["P_systolic"]
    if path is not None and period is not None and P_systolic is not None:
        place = f"{heading}.waveform"
        values["waveform"] = read_beat(path, period, P_systolic, place, context.faults)
    return values


def _check_output(
    values: Mapping[str, Any], heading: str, table: Mapping[str, Any], context: Context
) -> None:
    """Refuse a stroke volume that is not the cardiac output times the period."""
    output, volume, period = (values[n] for n in ("cardiac_output", "stroke_volume", "period"))
    if output is None or volume is None or period is None:
        return
    expected = output * period
    if abs(volume - expected) > _OUTPUT_SLACK * expected:
        key = "stroke_volume_ml"
        problem = f"cardiac_output_l_per_min times period_s is {expected:.3g} ml"
        allowed = f"within {100 * _OUTPUT_SLACK:g} % of that"
        cure = f"correct the one that is wrong, or leave {key} out"
        context.add(f"{heading}.{key}", table[key], problem, cure, allowed)


def _read_stress(table: object, context: Context) -> dict[str, Any]:
    if not isinstance(table, dict) or "factors" not in table:
        return {**read_table(table, "stress", STRESS, context), "factors": None}
    rest = {name: value for name, value in table.items() if name != "factors"}
    values = read_table(rest, "stress", STRESS, context)
    if "rule" in table:
        cure = "keep either rule or [stress.factors]"
        context.add("stress.rule", table["rule"], "[stress.factors] is given as well", cure)
    factors = read_table(table["factors"], "stress.factors", STRESS_FACTORS, context)
    return {**values, "rule": "factors", "factors": factors}
