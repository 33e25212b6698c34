"""Lines of keys in a TOML file, against the line that each value names."""

import pathlib
import tomllib

import pytest

from jaxfsi.toml_lines import KeyLines, key_lines
from study.case.faults import CaseError, Fault
from study.case.read import read_case
from study.case.template import case_template, record_template

TEXT = '''\
top = 1
[x.y]  # [not.this]
"q k" = """
[z]
b = 4
\\""" ""
"""
'l.it' = [8, 8, # ]
 9, {p = 9, q = "}"}]
'in' = { a.b = 10, "c" = [ "#" ] }
d.e.f = 2020-01-01 11:00:00
lines = \'\'\'
[x]\'\'\'
"\\u00e9t\\"e" = 14
[[condition]]
name = "rest"
ffr = 17
[[condition]]
name = 'dob'
[condition.sub]
u = 21
[x]
last = "\\"#["
empty = ""
'''
KEYS = {
    "top": 1,
    "x.y": 2,
    "x.y.'q k'": 3,
    "x.y.'l.it'": 8,
    "x.y.'l.it'[2]": 9,
    "x.y.'l.it'[3].q": 9,
    "x.y.in.a.b": 10,
    "x.y.d.e.f": 11,
    "x.y.lines": 12,
    "x.y.'ét\"e'": 14,
    "condition[0].ffr": 17,
    "condition.rest.ffr": 17,
    "condition[1]": 18,
    "condition.dob.sub.u": 21,
    "x": 22,
    "x.last": 23,
    "x.empty": 24,
}


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("key", KEYS)
def test_key_of_every_spelling_has_its_line(key, end):
    tomllib.loads(TEXT)
    assert KeyLines(TEXT.replace("\n", end)).line(key) == KEYS[key]


def test_missing_key_has_the_line_of_its_table_and_a_missing_table_none():
    lines = KeyLines(TEXT)
    assert lines.line("x.y.absent") == 2
    assert lines.line("condition.dob.ffr") == 18
    assert lines.line("file.top") == 1
    assert lines.line("absent.key") is None
    assert lines.line("") is None


@pytest.mark.parametrize("template", [case_template(), record_template()])
def test_every_line_of_a_template_is_found(template):
    """The line that is found begins with the key, or is the heading of the table."""
    rows = template.splitlines()
    lines, count = KeyLines(template), 0

    def look(table: dict, prefix: str) -> None:
        nonlocal count
        for name, value in table.items():
            place = f"{prefix}{name}"
            line = lines.line(place)
            assert line is not None, place
            assert rows[line - 1].lstrip("[ ").startswith((name, place)), (place, rows[line - 1])
            count += 1
            if isinstance(value, dict) and rows[line - 1].startswith("["):
                look(value, f"{place}.")

    look(tomllib.loads(template), "")
    assert count > 8


@pytest.mark.parametrize("text", ["a = ", "[a", "time_s,P\n0,1\n", "x = " + "[" * 3000])
def test_what_is_no_toml_has_no_lines(text):
    assert key_lines(text) is None


CASE = (
    '\ufeff# é\r\n[patient]\r\nid = "p"\r\n\r\n[condition.rest]\r\nperiod_s = 9000\r\nffr = 7\r\n'
)


def test_faults_of_a_case_name_the_line_after_a_mark_and_windows_line_ends(tmp_path):
    file = tmp_path / "case.toml"
    file.write_bytes(CASE.encode())
    with pytest.raises(CaseError) as caught:
        read_case(file)
    found = {fault.key: fault.line for fault in caught.value.faults}
    assert found["condition.rest.period_s"] == 6
    assert found["condition.rest.ffr"] == 7
    assert found["condition.rest.P_systolic_mmHg"] == 5
    assert f"{file}:7: condition.rest.ffr = 7: above" in str(caught.value)


def test_syntax_errors_have_their_line(tmp_path):
    file = tmp_path / "case.toml"
    for text, line in (("a = 1\nb = yes\n", 2), ("a = 1\n\nb = [1,\n", 3)):
        file.write_text(text)
        with pytest.raises(CaseError) as caught:
            read_case(file)
        assert str(caught.value).splitlines()[1].startswith(f"{file}:{line}: not valid TOML")


def test_a_file_that_is_gone_or_no_toml_leaves_the_line_out(tmp_path):
    table = tmp_path / "beat.csv"
    table.write_text("condition = 1\nrest\n")
    for file in (table, tmp_path, pathlib.Path("absent.toml"), tmp_path / "\0"):
        error = CaseError([Fault(file, "condition.rest", 1.0, "wrong", "", "mend it")])
        assert error.faults[0].line is None
