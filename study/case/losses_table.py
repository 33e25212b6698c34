"""The table [surrogate] in case files and records: what is known of the anomalous artery in 0D.

A resistance is a number, or `{ value = ..., sd_log = ... }` with the standard deviation of its
logarithm; it may be stated in either unit.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

from study.case.ostium import R0, Uncertain
from study.case.schema import Key, Quantity, keys_of, spellings
from study.case.table_reader import Context, contradict, read_table


def read_losses(
    table: object, heading: str, keys: Sequence[Key], context: Context
) -> dict[str, Any]:
    """Read a table that may hold R0; faults go to the context.

    Args:
        table: the parsed table.
        heading: its dotted name.
        keys: the keys that it takes, `R0` among them.
        context: where faults are collected.

    Returns:
        Values by name in CGS, and `R0_sd_log`, None where it is not stated.
    """
    if not isinstance(table, dict):
        return {**read_table(table, heading, keys, context), "R0_sd_log": None}
    plain, found = dict(table), []
    for key in spellings(R0):
        inner = table.get(key.key)
        if not isinstance(inner, dict) or not isinstance(key, Quantity):
            continue
        value = dataclasses.replace(key, field="value", label="value", required=True, also=())
        place = f"{heading}.{key.key}"
        braces = f"inside the braces of {key.key} = {{ value = ..., sd_log = ... }}"
        entry = read_table(inner, place, (value, *keys_of(Uncertain)), context, written=braces)
        del plain[key.key]
        if entry["value"] is not None:
            plain[key.key] = inner["value"]
        if contradict(entry["sd_log"], found[0] if found else None):
            context.add(f"{place}.sd_log", inner["sd_log"], "contradicts the other one", "keep one")
        found += [entry["sd_log"]] if entry["sd_log"] is not None else []
    sd_log = found[0] if found else None
    return {**read_table(plain, heading, keys, context), "R0_sd_log": sd_log}
