"""The reference page of case files and records, made from what their keys declare.

::

    python -m study.case.reference        write docs/case-file.md again
"""

import pathlib
from collections.abc import Iterable

from lumped.whole_files import write_whole
from study.case.anatomy import STATE
from study.case.ostium import Uncertain
from study.case.parameters import STRESS_FACTORS, ThicknessBounds
from study.case.schema import UNITS, Key, Quantity, keys_of, readable, spellings
from study.case.sections import CASE, RECORD, FileTable
from study.case.template import default_of, written

PAGE = pathlib.Path(__file__).parents[2] / "docs" / "case-file.md"
"""Where the page lies in a checkout."""

_HEAD = """\
# Case files and records

This page is written by `python -m study.case.reference`: do not edit it.

A *case file* (`case.toml`) holds what is known of a patient, a *record* (`record.toml` in a folder)
what was measured. Both are TOML and share one syntax. `jaxfsi template` prints a commented case
file, `jaxfsi template --record` a record; `--schema` prints the JSON Schema of either, which also
lies in `study/data/schema/` and lets [an editor](howto/command-line.md) complete keys.

- A key that carries a unit ends in it: `P_systolic_mmHg`. A key in another unit is refused, with
  the converted value in the message.
- All faults of a file are reported together: file and line, key, value, allowed range, what to try.
- Any table takes `source = "..."` (where its values come from) and `notes = "..."`.
- Python sees CGS units and the names of the last column: `study.read_case(path).wall.rho_s` is in
  g/cm3, angles are in rad.
- A default is what runs where the key is absent; `-` means that the command chooses, or that
  nothing is known.
"""

_OLDER = """\
## Older records

Records in an older spelling are still read, with a line of advice on standard error.

| older | now |
|---|---|
| `id` above all tables | `id` below `[patient]` |
| `[prior]` | `[surrogate]` |
| `[[condition]]` with `name = "rest"` | `[condition.rest]` |
| `file` of a condition | `waveform` |
"""

_INNER: dict[str, tuple[tuple[str, str, tuple[Key, ...]], ...]] = {
    "ivus": (("[anatomy.states.NAME]", "a further pullback", STATE),),
    "wall": (("thickness_per_radius = { ... }", "in place of a number", keys_of(ThicknessBounds)),),
    "surrogate": (
        ("R0_... = { value = ..., sd_log = ... }", "in place of a number", keys_of(Uncertain)),
    ),
    "stress": (("[stress.factors]", "in place of a rule", STRESS_FACTORS),),
}


def reference() -> str:
    """The page."""
    parts = [_HEAD, "## Case file\n", *map(_section, CASE)]
    parts += ["## Record\n", *map(_section, RECORD), _OLDER, _units()]
    return "\n".join(parts)


def _section(section: FileTable) -> str:
    title = f"[{section.heading}]" + (f' kind = "{section.kind}"' if section.kind else "")
    parts = [f"### `{title}`\n", section.text + "\n", _rows(section.keys)]
    for heading, what, keys in _INNER.get(section.kind or section.heading, ()):
        parts += [f"`{heading}`, {what}:\n", _rows(keys)]
    return "\n".join(parts)


def _rows(keys: Iterable[Key]) -> str:
    lines = ["| key | takes | default | meaning | field |", "|---|---|---|---|---|"]
    for key in keys:
        names = ", ".join(f"`{one.key}`" for one in spellings(key))
        default = default_of(key)
        said = "required" if key.required else "-" if default is None else f"`{written(default)}`"
        takes = (key.allowed or "`true` or `false`").replace(" | ", ", ")
        lines.append(f"| {names} | {takes} | {said} | {key.text} | `{key.field}` |")
    return "\n".join(lines) + "\n"


def _units() -> str:
    """Units that a wrong key is recognised in."""
    keys = [key for part in (*CASE, *RECORD) for key in part.keys]
    used = {key.dimension for key in keys if isinstance(key, Quantity)}
    lines = ["## Units", "", "Units that are recognised in a key or value that does not fit:", ""]
    for dimension, units in UNITS.items():
        names = ", ".join(readable(unit) for unit in units if unit)
        if dimension in used and names:
            lines.append(f"- {dimension}: {names}")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    write_whole(PAGE, reference())
    print(PAGE)
