"""Records and cases: one spelling for what both know, older ones still read, advice that works."""

import dataclasses
import re
import tomllib

import pytest

from lumped.units import MMHG_S_PER_ML
from study.case.faults import CaseError
from study.case.ostium import LOSS_KEYS
from study.case.read import read_case
from study.case.record import read_record
from study.case.recorded import CONDITION, NOISE
from study.case.schema import Quantity, spellings
from study.case.template import case_template, example_traces, record_template
from study.run.diagnosis import with_case

NEW = """\
[patient]
id = "a-1"
[noise]
ffr_sd = 0.02
[surrogate]
R0_mmHg_s_per_ml = { value = 3.5, sd_log = 0.2 }
K_mmHg_s2_per_ml2 = 0.5
[condition.rest]
drug = "none"
period_s = 0.8
P_systolic_mmHg = 110
P_diastolic_mmHg = 65
ffr = 0.91
[condition.exercise]
drug = "dobutamine"
period_s = 0.45
P_systolic_mmHg = 130
P_diastolic_mmHg = 70
ffr = 0.85
"""
OLD = NEW.replace('[patient]\nid = "a-1"', 'id = "a-1"').replace("[surrogate]", "[prior]")
for _name in ("rest", "exercise"):
    OLD = OLD.replace(f"[condition.{_name}]", f'[[condition]]\nname = "{_name}"')

CASE = """\
[patient]
id = "a-1"
[condition.rest]
period_s = 0.8
P_systolic_mmHg = 110
P_diastolic_mmHg = 65
ffr = 0.91
[surrogate]
R0_dyn_s_per_cm5 = 5e3
"""


def write(folder, text, name="record.toml"):
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


def read(folder, text):
    return read_record(write(folder, text))


def refusal(reader, file):
    with pytest.raises(CaseError) as refused:
        reader(file)
    return refused.value.faults


def test_both_spellings_give_the_identical_record(tmp_path):
    new, silent = read(tmp_path / "new", NEW)
    old, advised = read(tmp_path / "old", OLD)
    assert old == new
    assert not any("older spelling" in remark for remark in silent)
    (advice,) = (remark for remark in advised if "older spelling" in remark)
    assert all(part in advice for part in ("[patient]", "[surrogate]", "[condition.NAME]"))


def test_advice_on_an_older_spelling_goes_to_standard_error(command, tmp_path):
    for name, text in (("old", OLD), ("new", NEW)):
        write(tmp_path / name, text)
        (tmp_path / f"{name}-taken").write_text("a file where the results would go")
        outcome = command("plan-measurement", tmp_path / name, folder=tmp_path / f"{name}-taken")
        assert outcome.status == 2
        advised = [line for line in outcome.stderr.splitlines() if "older spelling" in line]
        assert len(advised) == (name == "old")


def test_traces_are_named_as_in_a_case_and_by_the_older_word(tmp_path):
    read_ = {}
    for word in ("waveform", "file"):
        folder = tmp_path / word
        text = NEW.replace("ffr = 0.91", f'ffr = 0.91\n{word} = "rest.csv"')
        write(folder, example_traces(), "rest.csv")
        read_[word], remarks = read(folder, text)
        assert any("waveform, not file" in remark for remark in remarks) == (word == "file")
        write(folder, "time_s\n0\n", "rest.csv")
        (fault,) = refusal(read_record, folder / "record.toml")
        assert fault.key == f"condition.rest.{word}"
    one, other = (read_[word].conditions[0] for word in ("waveform", "file"))
    assert {name: wave.tolist() for name, wave in one.beats.items()} == {
        name: wave.tolist() for name, wave in other.beats.items()
    }
    both = NEW.replace("ffr = 0.91", 'waveform = "rest.csv"\nfile = "other.csv"')
    for name in ("rest.csv", "other.csv"):
        write(tmp_path / "both", example_traces(), name)
    (fault,) = refusal(read_record, write(tmp_path / "both", both))
    assert "contradicts waveform" in fault.problem


@pytest.mark.parametrize(
    ("line", "sd_log"),
    [
        ("R0_dyn_s_per_cm5 = 5e3", None),
        ("R0_dyn_s_per_cm5 = { value = 5e3, sd_log = 0.3 }", 0.3),
        (f"R0_mmHg_s_per_ml = {5e3 / MMHG_S_PER_ML!r}", None),
        (f"R0_mmHg_s_per_ml = {{ value = {5e3 / MMHG_S_PER_ML!r}, sd_log = 0.3 }}", 0.3),
        ("R0_dyn_s_per_cm5 = 5e3\nR0_mmHg_s_per_ml = 3.75", None),
    ],
)
def test_case_and_record_take_R0_alike(tmp_path, line, sd_log):
    case = read_case(write(tmp_path, CASE.replace("R0_dyn_s_per_cm5 = 5e3", line), "case.toml"))
    assert case.surrogate.R0 == pytest.approx(5e3, rel=1e-14)  # two products
    assert case.surrogate.R0_sd_log == sd_log
    text = re.sub("R0_mmHg.*", line, NEW)
    record, _ = read(tmp_path, text)
    assert record.R0 == pytest.approx(5e3, rel=1e-14)
    assert record.R0_sd_log == (sd_log or 0.15)
    assert with_case(record, case.path)[0].R0_sd_log == record.R0_sd_log


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("[noise]", '[noise]\nid = "a-2"', "noise.id"),
        ("[patient]", 'id = "a-2"\n[patient]', "id"),
        ("K_mmHg", "R0_dyn_s_per_cm5 = 3e3\nK_mmHg", "surrogate.R0_mmHg_s_per_ml"),
        ("[noise]", "[prior]\nR0_mmHg_s_per_ml = { value = 5, sd_log = 0.2 }\n[noise]", "prior.R0"),
        ("[condition.rest]", '[condition.rest]\nname = "other"', "condition.rest.name"),
        ('"none"', '"dobutamine"', "condition.rest.drug"),
        ("value = 3.5", "value = 3.5, unit = 1", "surrogate.R0_mmHg_s_per_ml.unit"),
        ("value = 3.5", "value = 3.5e9", "surrogate.R0_mmHg_s_per_ml.value"),
        ("R0_mmHg_s_per_ml", "R0_kPa_s_per_ml", "surrogate.R0_kPa_s_per_ml"),
    ],
)
def test_contradictions_and_slips_are_refused(tmp_path, old, new, key):
    assert old in NEW
    places = [
        fault.key for fault in refusal(read_record, write(tmp_path, NEW.replace(old, new, 1)))
    ]
    assert key in places


def test_the_same_value_twice_is_accepted(tmp_path):
    text = NEW.replace("[patient]", 'id = "a-1"\n[patient]').replace("K_mmHg", "L_mmHg", 1)
    text = text.replace("s2_per_ml2 = 0.5", "s2_per_ml = 0.05\nR0_dyn_s_per_cm5 = 4666.27")
    record, _ = read(tmp_path, text)
    assert (record.id, record.L) == ("a-1", pytest.approx(0.05 * MMHG_S_PER_ML))


def followed(text, cure, value):
    """A file after its advice was followed to the letter, `...` replaced by the value."""
    found = re.fullmatch(r"add (\w+) = (?:\.\.\.|\"\.\.\.\") (below|in the) (\[.+\])(.*)", cure)
    assert found is not None, cure
    line, heading = f"{found[1]} = {value}\n", found[3]
    if found[2] == "in the":
        name = re.fullmatch(r" with name = (\w+)", found[4])
        assert name is not None
        heading += f'\nname = "{name[1]}"'
    if f"{heading}\n" in text:
        return text.replace(f"{heading}\n", f"{heading}\n{line}", 1)
    return f"{text}{heading}\n{line}"


def missing_keys():
    """Every line of a key whose absence is a fault, with the reader of its file."""
    for spelling, text in (("new", NEW), ("old", OLD)):
        for line in dict.fromkeys(text.split("\n")):
            if re.match(r"(id|period|P_sys|P_dia)", line) or line == 'drug = "dobutamine"':
                yield pytest.param(read_record, text, line, id=f"{spelling} {line}")
    for line in CASE.split("\n"):
        if re.match(r"(id|period|P_sys|P_dia)", line):
            yield pytest.param(read_case, CASE, line, id=f"case {line}")


@pytest.mark.parametrize(("reader", "text", "line"), [*missing_keys()])
def test_the_advice_for_a_missing_key_works_to_the_letter(tmp_path, reader, text, line):
    file = write(tmp_path, text.replace(f"{line}\n", "", 1))
    (fault,) = refusal(reader, file)
    file.write_text(followed(file.read_text(), fault.cure, line.split(" = ")[1]))
    reader(file)


def test_a_key_without_a_table_is_advised_into_its_own(tmp_path):
    for heading in ("noise", "condition.rest"):
        text = NEW.replace('[patient]\nid = "a-1"\n', "").replace(
            f"[{heading}]\n", f'[{heading}]\nid = "a-1"\n'
        )
        cures = [fault.cure for fault in refusal(read_record, write(tmp_path, text))]
        assert "move it below [patient], or remove it" in cures
    text = NEW.replace("[patient]", "[record]")
    cures = [fault.cure for fault in refusal(read_record, write(tmp_path, text))]
    assert "rename it to [patient]" in cures


def uncommented(text):
    return re.sub(r"^#(?=\w+ = |\[)", "", text, flags=re.MULTILINE)


def test_template_is_a_valid_record_and_shows_every_key_with_its_default(tmp_path):
    plain, _ = read(tmp_path / "plain", record_template())
    (tmp_path / "full").mkdir()
    (tmp_path / "full/rest.csv").write_text(example_traces())
    full, _ = read(tmp_path / "full", uncommented(record_template()))
    assert set(full.conditions[0].beats) == {"P_aorta", "P_distal", "Q"}
    assert (full.flow_relative_sd, full.ffr_sd) == (0.05, 0.01)
    assert [c.name for c in full.conditions] == [c.name for c in plain.conditions]
    assert [c.order for c in full.conditions] == [c.order for c in plain.conditions]
    tables = tomllib.loads(uncommented(record_template()))
    rest = set(tables["condition"]["rest"])
    assert {key.key for key in CONDITION if key.name != "name"} | {"held_out"} == rest
    assert {key.key for key in NOISE} == set(tables["noise"])
    text = record_template()
    for key in (*LOSS_KEYS, *CONDITION, *NOISE):
        assert all(spelled.key in text for spelled in spellings(key)), key.key
    for key in (*CONDITION, *NOISE):
        if isinstance(key, Quantity):
            line = next(x for x in text.split("\n") if x.lstrip("#").startswith(f"{key.key} ="))
            assert f"{key.low:g} to {key.high:g}" in line


def test_the_template_of_a_case_names_R0_in_both_units(tmp_path):
    assert "R0_mmHg_s_per_ml" in case_template()
    case = read_case(write(tmp_path, case_template(), "case.toml"))
    assert dataclasses.replace(case.surrogate, R0=None).R0_sd_log is None


def test_template_of_a_record_is_printed_and_can_be_written_once(command, tmp_path):
    printed = command("template", "--record")
    assert printed.stdout == record_template()
    assert command("template", "--record", folder=tmp_path / "new").status == 0
    written = (tmp_path / "new/record.toml").read_text()
    assert written == f"#:schema ./record.schema.json\n{record_template()}"
    assert (tmp_path / "new/rest.csv").read_text() == example_traces()
    assert command("template", "--record", folder=tmp_path / "new").status == 2


@pytest.mark.slow
@pytest.mark.parametrize("change", [str, uncommented])
def test_the_template_of_a_record_is_diagnosed(command, tmp_path, change):
    folder = tmp_path / "new"
    command("template", "--record", folder=folder)
    write(folder, change(record_template()))
    outcome = command("diagnose", folder, "--json", folder=tmp_path / "results")
    assert outcome.status == 0
    assert outcome.stderr.count("wrote ") == 2
