"""Templates of a case file and of a record, written from what their keys declare."""

import importlib.resources
import json
import textwrap
from collections.abc import Iterable, Mapping
from typing import Any

from study.case.anatomy import STATE
from study.case.schema import Flag, Key, Location, Quantity, Word, spellings
from study.case.sections import CASE, CONDITION_SLOT, RECORD, FileTable

RECORD_FILE, EXAMPLE_FILE = "record.toml", "rest.csv"

_WIDTH, _COLUMN = 100, 38

_MARKS = """\
Every key that carries a unit ends in it. Lines that begin with "#name =" or "#[" are optional and \
show the default, or an example where it says so; remove the "#" to set them. Any table takes \
source = "..." (where its values come from) and notes = "...". docs/case-file.md explains every \
key; "jaxfsi template --schema" prints a JSON Schema for editors."""

_CASE_HEAD = f"A patient case. {_MARKS}"

_RECORD_HEAD = f"""\
What was measured in one patient. "jaxfsi diagnose FOLDER" compares it with the model; this file \
is FOLDER/record.toml. What a case file knows too is spelt as there. {_MARKS}"""

_RECORD_FOOT = """\
Traces are CSV files. The first line names the columns: time_s, P_aorta_mmHg, and where recorded \
P_distal_mmHg and Q_coronary_ml_per_min, the flow into the artery at its origin. Give one beat \
from the opening of the aortic valve on, the first sample at 0 s; or a recording, which may begin \
and end within a beat: its clock need not divide the beats, beats may differ in length, and rows \
may be lost. "jaxfsi template --record --out FOLDER" writes an example, rest.csv."""

_ANATOMY = """\
The vessel: exactly one kind. Leave it out where R0 is given below and nothing needs a mesh."""

_CASE_STRESS = {"kind": "stress", "P_systolic": 130.0, "P_diastolic": 70.0, "period": 0.45}
_STRESS_ONLY = ("drug", "flow_reserve", "flow_reserve_sd")
_RECORD_STRESS = {
    "drug": "dobutamine", "period": 0.45, "P_systolic": 130.0, "P_diastolic": 70.0, "ffr": 0.90,
}  # fmt: skip


def case_template() -> str:
    """A commented case file to start from; it is itself a valid case."""
    blocks = [_comment(_CASE_HEAD)]
    for section in CASE:
        if section.kind and section.kind != "ivus":
            names = ", ".join(key.key for key in section.keys)
            text = f'kind = "{section.kind}" takes {names}. {section.text}'
            blocks.append(_comment(" ".join(text.split())))
        elif section.kind:
            kinds = " | ".join(part.kind for part in CASE if part.kind)
            text = f"{_ANATOMY}\n\nivus: {section.text}"
            kind = Word(name="kind", options=tuple(kinds.split(" | ")), example="ivus")
            lines = [_line(key, {}, commented=True) for key in (kind, *section.keys)]
            states = [_line(key, {}, commented=True, told=False) for key in STATE]
            more = "#[anatomy.states.rest_systole]"
            blocks.append("\n".join([_comment(text), "#[anatomy]", *lines, more, *states]))
        elif section.heading == CONDITION_SLOT:
            shown = ("P_systolic", "P_diastolic", "period", "ffr")
            blocks += _conditions(section, shown, _CASE_STRESS)
        else:
            shown = {"patient": ("id",), "surrogate": ("R0",)}.get(section.heading, ())
            blocks.append(_table(section, section.heading, shown))
    return "\n\n".join(blocks) + "\n"


def record_template() -> str:
    """A commented record to start from; it is itself a valid record."""
    blocks = [_comment(_RECORD_HEAD)]
    for section in RECORD:
        if section.heading == CONDITION_SLOT:
            shown = ("drug", "period", "P_systolic", "P_diastolic", "ffr")
            blocks += _conditions(section, shown, _RECORD_STRESS)
        else:
            shown = ("id",) if section.heading == "patient" else ()
            blocks.append(_table(section, section.heading, shown))
    return "\n\n".join([*blocks, _comment(_RECORD_FOOT)]) + "\n"


def example_traces() -> str:
    """One beat at rest as a CSV file: the model's own, with the pressures of the template."""
    folder = importlib.resources.files("study") / "data" / "record_example"
    return (folder / EXAMPLE_FILE).read_text("utf-8")


def _conditions(section: FileTable, shown: Iterable[str], stress: Mapping[str, Any]) -> list[str]:
    """The condition at rest with every key, and one under stress with those that it needs."""
    own = tuple(key for key in section.keys if key.name in stress)
    lines = [_line(key, stress, commented=key.name == "kind", told=False) for key in own]
    alone = {name for name in _STRESS_ONLY if name not in stress}
    only = [_line(key, {}, commented=True) for key in section.keys if key.name in alone]
    both = tuple(key for key in section.keys if key.name not in alone)
    return [
        _table(section._replace(keys=both), "condition.rest", shown),
        "\n".join(["[condition.dobutamine]", *lines, *only]),
    ]


def _table(section: FileTable, heading: str, shown: Iterable[str]) -> str:
    """A table with each of its keys; those that are shown are set, the others commented out."""
    set_ = tuple(shown)
    lines = [_line(key, {}, commented=key.name not in set_) for key in section.keys]
    return "\n".join([_comment(section.text), f"[{heading}]" if set_ else f"#[{heading}]", *lines])


def _line(key: Key, values: Mapping[str, Any], *, commented: bool, told: bool = True) -> str:
    """A key with a value, and what it means."""
    value, example = default_of(key), False
    if key.name in values or value is None:
        value, example = values.get(key.name, key.example), True
    start = f"{'#' if commented else ''}{key.key} = {written(value)}"
    if not told:
        return start
    words = ("example; " if example and commented else "") + meaning(key)
    lines = textwrap.wrap(words, _WIDTH - _COLUMN - 2, break_on_hyphens=False)
    first = f"{start:{_COLUMN}}# {lines[0]}" if lines else start
    return "\n".join([first, *(" " * _COLUMN + f"# {line}" for line in lines[1:])])


def default_of(key: Key) -> Any:
    """The default of a key in its unit; None where there is none."""
    return key.usual if isinstance(key, Quantity) else key.default


def meaning(key: Key) -> str:
    """What a key takes and means, in a few words."""
    match key:
        case Quantity():
            limits = f"{short(key.low)} to {short(key.high)}"
            other = "".join(f", or {spelled.key}" for spelled in spellings(key)[1:])
            takes = f"{limits}{other}"
        case Word(options=options) if options:
            takes = " | ".join(options)
        case Word() | Location():
            takes = key.allowed
        case Flag():
            takes = ""
    return "; ".join(part for part in (takes, key.text) if part)


def short(value: float) -> str:
    """A number in few characters."""
    return f"{value:g}".replace("e+0", "e").replace("e-0", "e-")


def written(value: Any) -> str:
    """A value as TOML."""
    if isinstance(value, bool | str | int):
        # JSON escapes characters beyond 16 bits in pairs, which TOML does not know
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    size = abs(value)
    if size >= 1e4 or 0.0 < size < 1e-3:
        mantissa, _, exponent = f"{value:.9e}".partition("e")
        digits = mantissa.rstrip("0")
        return f"{digits}{'0' if digits.endswith('.') else ''}e{int(exponent)}"
    return f"{value:.10g}" if not float(value).is_integer() else f"{value:.1f}"


def _comment(text: str) -> str:
    """A text as a comment; its paragraphs follow each other."""
    paragraphs = [" ".join(part.split()) for part in text.split("\n\n")]
    lines = (textwrap.wrap(part, _WIDTH - 2, break_on_hyphens=False) for part in paragraphs)
    return "\n".join(f"# {line}" for part in lines for line in part)
