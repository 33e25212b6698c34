"""Reading the [anatomy] table of a case file: its kind, its sub-tables, and how they must agree."""

import math
import pathlib
import re
from collections.abc import Mapping
from typing import Any

from study.case.anatomy import (
    FIRST_STATE,
    KINDS,
    MODELS,
    STATE,
    Anatomy,
    IvusState,
    Point,
    SurfaceCut,
)
from study.case.faults import shown_key
from study.case.schema import Value, Word
from study.case.table_reader import Context, check_order, read_table

_STATE = re.compile(r"[A-Za-z][A-Za-z0-9-]*_(diastole|systole)")
_OPENING = re.compile(r"(?!interface$|outer_wall$)[A-Za-z][A-Za-z0-9_-]{0,39}(?<!_ring)")


SUB_TABLES = {
    "ivus": ("states",),
    "synthetic": (),
    "surface": ("openings", "cuts"),
    "mesh": ("labels",),
}


def read_anatomy(table: object, context: Context) -> Anatomy | None:
    """Read the [anatomy] table; faults go to the context.

    Returns:
        The anatomy; None where it is at fault.
    """
    before = len(context.faults)
    if not isinstance(table, dict):
        read_table(table, "anatomy", (), context)
        return None
    choice = Word(name="kind", field="kind", options=tuple(KINDS), required=True)
    kind = table.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        read_table({"kind": kind} if "kind" in table else {}, "anatomy", (choice,), context)
        return None
    below = {name: table[name] for name in SUB_TABLES[kind] if name in table}
    own = {name: value for name, value in table.items() if name not in below}
    values = read_table(own, "anatomy", (choice, *KINDS[kind]), context)
    del values["kind"]
    parts = _READERS[kind](values, own, below, context)
    return MODELS[kind](**parts) if len(context.faults) == before else None


def _ivus(
    values: dict[str, Value], table: dict[str, Any], below: dict[str, Any], context: Context
) -> dict[str, Any]:
    states: dict[str, IvusState] = {}
    first = {key.field: values.pop(key.field) for key in STATE}
    if isinstance(first["contours"], pathlib.Path):
        states[FIRST_STATE] = IvusState(**first)  # pyright: ignore[reportArgumentType]
    for name, value in _entries(below, "states", context):
        place = f"anatomy.states.{shown_key(name)}"
        if not _STATE.fullmatch(name):
            allowed = "CONDITION_diastole or CONDITION_systole, such as dobutamine_systole"
            context.add(place, None, "not a valid name of a state", f"write {allowed}", allowed)
        elif name == FIRST_STATE and "contours" in table:
            cure = "keep either contours below [anatomy] or this table"
            context.add(place, None, "the state is given directly below [anatomy] as well", cure)
        else:
            found = read_table(value, place, STATE, context)
            if found["contours"] is not None:
                states[name] = IvusState(**found)  # pyright: ignore[reportArgumentType]
    if "contours" not in table and not below.get("states"):
        context.add(
            "anatomy.contours",
            None,
            "required, but missing",
            "add contours = ... below [anatomy], or a table [anatomy.states.rest_diastole]",
            STATE[0].allowed,
        )
    _check_lines(values, table, context)
    ordered = sorted(states.items(), key=lambda entry: entry[0] != FIRST_STATE)
    return {"states": dict(ordered), **values}


def _check_lines(values: dict[str, Value], table: dict[str, Any], context: Context) -> None:
    """Faults of centre lines that lack one another, or contradict a number."""
    for name, needed in (
        ("aorta_centerline", "centerline"),
        ("normal_centerline", "aorta_centerline"),
        ("normal_length", "normal_centerline"),
    ):
        if values[name] is not None and needed not in table:
            key = next(k.key for k in KINDS["ivus"] if k.field == name)
            problem = f"it needs {needed}, which is missing"
            cure = f"add {needed} = ... below [anatomy], or leave {key} out"
            context.add(f"anatomy.{key}", table.get(key), problem, cure)
    if values["aorta_centerline"] is not None and values["aorta_radius"] is not None:
        cure = "keep either aorta_centerline, which holds the radii, or aorta_radius_mm"
        place = "anatomy.aorta_radius_mm"
        context.add(
            place, table.get("aorta_radius_mm"), "the aorta's radii are given as well", cure
        )


def _synthetic(
    values: dict[str, Value], table: dict[str, Any], below: dict[str, Any], context: Context
) -> dict[str, Any]:
    check_order(
        values, "ostium_minor", "ostium_major", "anatomy", KINDS["synthetic"], table, context
    )
    side, size = values.pop("side"), values.pop("body_surface_area_m2")
    given = {name: value for name, value in values.items() if isinstance(value, float)}
    return {"side": side, "body_surface_area_m2": size, "given": given}


def _surface(
    values: dict[str, Value], table: dict[str, Any], below: dict[str, Any], context: Context
) -> dict[str, Any]:
    openings = {
        name: point
        for name, value in _named(below, "openings", context)
        if (point := _point(f"anatomy.openings.{name}", value, context)) is not None
    }
    cuts: dict[str, SurfaceCut] = {}
    for name, value in _named(below, "cuts", context):
        cut = _cut(f"anatomy.cuts.{name}", value, context)
        if cut is not None:
            cuts[name] = cut
    if openings and values["openings_file"] is not None:
        cure = "keep either openings_file or the table [anatomy.openings]"
        place = "anatomy.openings_file"
        context.add(place, table["openings_file"], "the openings are given as well", cure)
    return {**values, "openings": openings, "cuts": cuts}


def _mesh(
    values: dict[str, Value], table: dict[str, Any], below: dict[str, Any], context: Context
) -> dict[str, Any]:
    folders = [name for name in ("fluid", "solid") if name in table]
    if "path" in table and folders:
        cure = f"keep either path or {' and '.join(folders)}"
        context.add("anatomy.path", table["path"], "folders are given as well", cure)
    elif "path" not in table and not folders:
        cure = "add path = ..., or fluid = ... and solid = ... below [anatomy]"
        context.add("anatomy.path", None, "required, but missing", cure, "a mesh file or folder")
    for name in ("path", "fluid", "solid"):
        place = values.get(name)
        if isinstance(place, pathlib.Path) and place.is_dir() and not _holds_a_mesh(place):
            problem = "this folder holds no mesh"
            cure = (
                "name a mesh file, or a folder with fluid and solid in it, or a mesh-complete one"
            )
            context.add(f"anatomy.{name}", table[name], problem, cure)
    labels = {}
    for name, value in _entries(below, "labels", context):
        place = f"anatomy.labels.{shown_key(name)}"
        if isinstance(value, str) and value:
            labels[name] = value
        else:
            context.add(place, value, "a text is expected here", f'write {name} = "outer_wall"')
    return {**values, "labels": labels}


def _holds_a_mesh(folder: pathlib.Path) -> bool:
    """Whether a folder is a mesh-complete one, or one of them lies in it under its name."""
    file = "mesh-complete.mesh.vtu"
    return any((folder / part / file).is_file() for part in ("", "fluid", "solid"))


_READERS = {"ivus": _ivus, "synthetic": _synthetic, "surface": _surface, "mesh": _mesh}


def _entries(below: Mapping[str, Any], name: str, context: Context) -> list[tuple[str, Any]]:
    """Entries of a sub-table; a fault where it is none."""
    table = below.get(name, {})
    if isinstance(table, dict):
        return list(table.items())
    cure = f"write [anatomy.{name}] on a line of its own and its entries below it"
    context.add(f"anatomy.{name}", table, "a table is expected here", cure)
    return []


def _named(below: Mapping[str, Any], name: str, context: Context) -> list[tuple[str, Any]]:
    """Entries of a sub-table whose keys are names of openings."""
    kept = []
    for key, value in _entries(below, name, context):
        if _OPENING.fullmatch(key):
            kept.append((key, value))
            continue
        allowed = "a letter, then letters, digits, _ and -; not interface, outer_wall or ..._ring"
        place = f"anatomy.{name}.{shown_key(key)}"
        context.add(place, None, "not a valid name of an opening", "rename it", allowed)
    return kept


def _point(place: str, value: object, context: Context) -> Point | None:
    if isinstance(value, list) and len(value) == 3:
        numbers = [x for x in value if isinstance(x, int | float) and not isinstance(x, bool)]
        if len(numbers) == 3 and all(math.isfinite(x) for x in numbers):
            return float(numbers[0]), float(numbers[1]), float(numbers[2])
    cure = "write three numbers, [x, y, z]"
    context.add(place, value, "a point is expected here", cure, "[x, y, z] in the anatomy's unit")
    return None


def _cut(place: str, table: object, context: Context) -> SurfaceCut | None:
    keys = ("centre", "normal", "radius")
    if not isinstance(table, dict) or set(table) != set(keys):
        cure = "write centre = [x, y, z], normal = [x, y, z] and radius = ..., and nothing else"
        context.add(place, None, "a table of centre, normal and radius is expected here", cure)
        return None
    centre = _point(f"{place}.centre", table["centre"], context)
    normal = _point(f"{place}.normal", table["normal"], context)
    radius = table["radius"]
    if isinstance(radius, bool) or not isinstance(radius, int | float) or not 0 < radius < 1e4:
        cure = "give the radius of the vessel there, in the anatomy's unit"
        context.add(f"{place}.radius", radius, "not a radius", cure, "above 0")
        return None
    if normal is not None and not any(normal):
        context.add(f"{place}.normal", None, "no direction", "point it out of the domain")
        return None
    if centre is None or normal is None:
        return None
    return SurfaceCut(centre, normal, float(radius))
