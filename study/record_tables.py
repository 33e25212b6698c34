"""The tables of a measured record (`record.toml`): what each takes, how its values must agree."""

from typing import Any

from lumped.units import MMHG, MMHG_S_PER_ML
from study.case_tables import FFR_MEANING
from study.schema import Key, Location, Quantity, Word
from study.tables import Context, check_order, read_table

DRUGS = ("none", "adenosine", "dobutamine")

_NAME = r"[A-Za-z0-9]([A-Za-z0-9._-]{0,62}[A-Za-z0-9_-])?"

HEAD = (Word("id", pattern=_NAME, required=True, described="a name of letters, digits, . _ -"),)
NOISE = (
    Quantity("pressure_sd", "pressure", "mmHg", 0.02, 20.0),
    Quantity("pressure_offset_sd", "pressure", "mmHg", 0.01, 20.0),
    Quantity("flow_relative_sd", "ratio", "", 0.001, 1.0),
    Quantity("ffr_sd", "ratio", "", 0.0005, 0.2),
)
RESISTANCE = (
    Quantity("value", "resistance", "mmHg_s_per_ml", 0.01, 1000.0, required=True),
    Quantity("sd_log", "number", "", 0.01, 3.0, required=True),
)
LOSSES = (
    Quantity("K", "quadratic loss", "mmHg_s2_per_ml2", 0.0, 1.0e4),
    Quantity("L", "inertance", "mmHg_s2_per_ml", 0.0, 100.0),
)
"""What may be known of the ostium beside its resistance: the rest of a ramp's curve."""
CONDITION: tuple[Key, ...] = (
    Word("name", pattern=r"[A-Za-z][A-Za-z0-9_-]{0,39}", required=True, described="a short name"),
    Word("drug", DRUGS, required=True),
    Quantity("order", "number", "", 0.0, 20.0, whole=True),
    Quantity("period", "time", "s", 0.2, 3.0, required=True, aliases=("heart_rate", "HR")),
    Quantity("P_systolic", "pressure", "mmHg", 30.0, 300.0, required=True),
    Quantity("P_diastolic", "pressure", "mmHg", 20.0, 200.0, required=True),
    Quantity("mean_P_aorta", "pressure", "mmHg", 20.0, 250.0),
    Quantity("mean_P_distal", "pressure", "mmHg", 5.0, 250.0),
    Quantity("ffr", "ratio", "", 0.0, 1.15, exclusive=True, advice=FFR_MEANING),
    Quantity("mean_flow", "flow", "ml_per_min", 0.0, 2000.0, exclusive=True),
    Location("file", described="CSV file with time_s,P_aorta_mmHg,P_distal_mmHg"),
)


def homes() -> dict[str, str]:
    """For each key, the heading of the table that it belongs to."""
    found = {key.key: "[[condition]]" for key in CONDITION}
    return found | {k.key: "[noise]" for k in NOISE} | {k.key: "[prior]" for k in LOSSES}


def read_record_tables(document: dict[str, Any], context: Context) -> dict[str, Any]:
    """Values of a record by table, in mmHg, mL, s; faults go to the context."""
    known = {"id", "noise", "prior", "condition", "notes", "source"}
    for name in document:
        if name not in known:
            cure = f"remove it, or use one of {', '.join(sorted(known))}"
            context.add(name, None, "unknown key or table", cure, ", ".join(sorted(known)))
    top = {name: document[name] for name in ("id",) if name in document}
    values: dict[str, Any] = read_table(top, "record", HEAD, context)
    noise = read_table(document.get("noise", {}), "noise", NOISE, context)
    for name in ("pressure_sd", "pressure_offset_sd"):
        noise[name] = _clinical(noise[name], MMHG)
    values["noise"] = noise
    values["prior"] = _read_prior(document.get("prior", {}), context)
    tables = document.get("condition")
    if not isinstance(tables, list) or not tables:
        cure = "write [[condition]] with name, drug, period_s, P_systolic_mmHg, P_diastolic_mmHg"
        context.add("condition", None, "the record has no condition", cure)
        tables = []
    values["condition"] = [_read_condition(t, k, context) for k, t in enumerate(tables)]
    names = [c["name"] for c in values["condition"] if c["name"]]
    for name in {n for n in names if names.count(n) > 1}:
        context.add(f"condition.{name}", name, "two conditions have this name", "rename one")
    return values


def _clinical(value: Any, factor: float) -> float | None:
    return None if value is None else float(value) / factor


def _read_prior(table: object, context: Context) -> dict[str, Any]:
    if not isinstance(table, dict):
        context.add("prior", table, "a table is expected here", "write [prior] on its own line")
        return {}
    known = ("R0_mmHg_s_per_ml", *(key.key for key in LOSSES))
    for name in table:
        if name not in known:
            cure = "use R0_mmHg_s_per_ml = { value = 3.75, sd_log = 0.15 }, or remove it"
            context.add(f"prior.{name}", None, "unknown key", cure, ", ".join(known))
    if "R0_mmHg_s_per_ml" not in table:
        if any(key in table for key in known):
            problem = "K and L are the rest of a curve whose R0 is missing"
            cure = "give R0_mmHg_s_per_ml = { value = ..., sd_log = ... } as well"
            context.add("prior.R0_mmHg_s_per_ml", None, problem, cure)
        return {}
    inner = table["R0_mmHg_s_per_ml"]
    if isinstance(inner, dict):  # the unit stands in the key of the pair
        inner = {("value_mmHg_s_per_ml" if k == "value" else k): v for k, v in inner.items()}
    entry = read_table(inner, "prior.R0_mmHg_s_per_ml", RESISTANCE, context)
    given = {key.key: table[key.key] for key in LOSSES if key.key in table}
    rest = read_table(given, "prior", LOSSES, context)
    return {
        "R0": _clinical(entry["value"], MMHG_S_PER_ML),
        "R0_sd_log": entry["sd_log"],
        "K": _clinical(rest["K"], MMHG),
        "L": _clinical(rest["L"], MMHG),
    }


def _read_condition(table: object, place: int, context: Context) -> dict[str, Any]:
    heading = f"condition[{place}]"
    held_out: object = False
    if isinstance(table, dict):
        heading = f"condition.{table.get('name', place)}"
        held_out = table.get("held_out", False)
        table = {name: value for name, value in table.items() if name != "held_out"}
    if not isinstance(held_out, bool):
        context.add(f"{heading}.held_out", held_out, "true or false is expected", "write true")
        held_out = False
    values: dict[str, Any] = read_table(table, heading, CONDITION, context)
    if isinstance(table, dict):
        order = ("P_diastolic", "P_systolic")
        check_order(values, *order, heading, CONDITION, table, context, apart=True)
    for name in ("P_systolic", "P_diastolic", "mean_P_aorta", "mean_P_distal"):
        values[name] = _clinical(values[name], MMHG)
    mean_Q = values.pop("mean_flow")
    values["mean_Q"] = mean_Q
    values["order"] = place if values["order"] is None else int(values["order"])
    return {**values, "held_out": held_out, "heading": heading}
