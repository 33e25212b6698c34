"""Lines at which the keys of a TOML file stand, which `tomllib` does not tell.

The text is one that `tomllib` has read: only what a valid file can hold is told apart. Tables and
keys of every spelling count: dotted, quoted, in inline tables, in lists, in arrays of tables.
"""

import re
import tomllib
from collections.abc import Iterator

_Place = tuple[str | int, ...]

_BASIC, _LITERAL = r'"(?:\\.|[^"\\\n])*"', r"'[^'\n]*'"
_PART = re.compile(rf"[ \t]*(?:(?P<bare>[\w-]+)|(?P<basic>{_BASIC})|(?P<literal>{_LITERAL}))[ \t]*")
_GAP = re.compile(r"(?:[ \t\r\n,]+|#[^\n]*)*+")
_VALUE = re.compile(
    r'"""(?:\\.|[^\\])*?"""(?:"{0,2})' + r"|'''.*?'''(?:'{0,2})" + rf"|{_BASIC}|{_LITERAL}"
    r"|[^,\]}#\r\n]*",
    re.DOTALL,
)
_INDEX = re.compile(r"\[(\d+)\]")


class KeyLines:
    """Where the keys of a text stand."""

    def __init__(self, text: str):
        """Look through a text that is valid TOML."""
        self._text = text.replace("\r\n", "\n")
        self._lines: dict[_Place, int] = {}
        self._counts: dict[_Place, int] = {}
        self._names: dict[_Place, int] = {}
        self._at = 0
        self._passed, self._line = 0, 1
        self._scan()

    def line(self, key: str) -> int | None:
        """Line of a key, of the table that it is missing from, or None where neither stands.

        Args:
            key: dotted, as faults name it: `condition.rest.ffr`, `condition[2].drug`.
        """
        place = self._deepest(list(_parts(key)))
        return self._lines.get(place)

    def _deepest(self, parts: list[str | int]) -> _Place:
        """The longest beginning of a key that stands in the text."""
        place: _Place = ()
        for part in parts:
            deeper = (*place, part)
            if deeper not in self._lines and deeper in self._names:
                deeper = (*place, self._names[deeper])
            if deeper not in self._lines:
                break
            place = deeper
        if not place and len(parts) > 1:  # `file.source`, of what stands above all tables
            return self._deepest(parts[1:2])
        return place

    def _scan(self) -> None:
        table: _Place = ()
        self._skip()
        while self._at < len(self._text):
            if self._text[self._at] == "[":
                table = self._heading()
            else:
                self._entry(table)
            self._skip()

    def _heading(self) -> _Place:
        line, array = self._current_line(), self._text.startswith("[[", self._at)
        self._at += 1 + array
        table: _Place = ()
        parts = self._key()
        for k, part in enumerate(parts):
            table = (*table, part)
            last = k == len(parts) - 1
            if array and last:
                self._lines.setdefault(table, line)
                self._counts[table] = self._counts.get(table, 0) + 1
            if table in self._counts:
                table = (*table, self._counts[table] - 1)
            if last:
                self._lines[table] = line
            self._lines.setdefault(table, line)
        self._at += 1 + array
        return table

    def _entry(self, table: _Place) -> None:
        line = self._current_line()
        place = table
        for part in self._key():
            place = (*place, part)
            self._lines.setdefault(place, line)
        self._at += 1  # the equals sign
        self._value(place)

    def _key(self) -> list[str]:
        parts: list[str] = []
        while found := _PART.match(self._text, self._at):
            parts.append(_part(found))
            self._at = found.end()
            if not self._text.startswith(".", self._at):
                break
            self._at += 1
        return parts

    def _value(self, place: _Place) -> None:
        while self._text.startswith((" ", "\t"), self._at):
            self._at += 1
        opening = self._text[self._at : self._at + 1]
        if opening in ("[", "{"):
            self._inside(place, opening)
            return
        found = _VALUE.match(self._text, self._at)
        assert found is not None, "it matches nothing at all, too"
        self._at = found.end()
        name = found[0]
        if place[-1] == "name" and name[:1] in ("'", '"') and len(place) > 2:
            *outer, index, _ = place
            if isinstance(index, int):  # an entry of an array of tables may be called by its name
                self._names[(*outer, name.strip("'\""))] = index

    def _inside(self, place: _Place, opening: str) -> None:
        """What stands between brackets or braces."""
        self._at += 1
        closing, count = {"[": "]", "{": "}"}[opening], 0
        self._skip()
        while not self._text.startswith(closing, self._at):
            if opening == "{":
                self._entry(place)
            else:
                self._lines[(*place, count)] = self._current_line()
                self._value((*place, count))
                count += 1
            self._skip()
        self._at += 1

    def _skip(self) -> None:
        found = _GAP.match(self._text, self._at)
        assert found is not None, "it matches nothing at all, too"
        self._at = found.end()

    def _current_line(self) -> int:
        self._line += self._text.count("\n", self._passed, self._at)
        self._passed = self._at
        return self._line


def key_lines(text: str) -> KeyLines | None:
    """Where the keys of a text stand; None where it is no valid TOML."""
    try:
        tomllib.loads(text)
        return KeyLines(text)
    except (ValueError, RecursionError):
        return None


def _part(found: re.Match[str]) -> str:
    if found["bare"] is not None:
        return found["bare"]
    if found["literal"] is not None:
        return found["literal"][1:-1]
    return _unescaped(found["basic"])


def _unescaped(quoted: str) -> str:
    """A text in double quotes, as TOML reads it; as it stands where it is shown shortened."""
    try:
        return str(tomllib.loads(f"x = {quoted}")["x"]) if "\\" in quoted else quoted[1:-1]
    except ValueError:
        return quoted[1:-1]


def _parts(key: str) -> Iterator[str | int]:
    """Parts of a key as faults name it."""
    at = 0
    while found := _PART.match(key, at) or _INDEX.match(key, at):
        yield int(found[1]) if found.re is _INDEX else _part(found)
        at = found.end()
        at += key.startswith(".", at)
