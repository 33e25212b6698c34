"""Beats of catheter recordings: what is found in them, and what is left out."""

import pathlib

import numpy as np
import pytest

from study import CaseError
from study.case.catheter.beat_means import delay_between, import_condition
from study.case.catheter.beats import find_beats
from study.case.catheter.columns import ExportFormat, column_map
from study.case.catheter.drift import wire_drift
from study.case.catheter.named_files import CHECK, common_stem, named_files
from study.case.catheter.samples import CatheterTrace
from study.case.catheter.table import read_console_table
from study.case.catheter.trace import read_trace
from tests.study.catheter_minutes import Minute, export, minute


def trace_of(found: Minute) -> CatheterTrace:
    columns = found.columns
    waves = {"P_aorta": columns["p_aortic"], "P_distal": columns["p_distal"]}
    t = columns["time"]
    return CatheterTrace(pathlib.Path("x_rest.csv"), t, waves, float(t[1] - t[0]), ())


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("period", [0.42, 0.8, 1.1])
def test_minute_with_ectopics_noise_and_respiration_gives_its_truth(seed, period):
    given = minute(seed, period=period)
    found = import_condition("rest", "none", trace_of(given))
    means = found.means
    assert means.period == pytest.approx(given.period, rel=0.01)
    assert means.mean_P_aorta == pytest.approx(given.mean["P_aorta"], abs=0.3)
    assert means.mean_P_distal == pytest.approx(given.mean["P_distal"], abs=0.3)
    onset = found.beats.onset[found.beats.used]
    nearest = np.abs(onset[:, None] - given.onset).argmin(axis=1)
    assert not given.ectopic[nearest].any()
    ordinary = (~given.ectopic & (given.onset > 0.5) & (given.onset < 58.0)).sum()
    assert onset.size >= 0.9 * ordinary
    # single samples scatter by the noise, and by shapes that change with the length of the beats
    assert 0.9 < means.noise["P_aorta"] < 2.2


def test_onset_lies_at_the_foot_of_the_upstroke():
    given = minute(1, noise=0.2, respiration=0.0, ectopics=0.0, rate=200.0)
    found = find_beats(trace_of(given))
    off = found.onset - given.onset[np.abs(found.onset[:, None] - given.onset).argmin(axis=1)]
    assert 0.0 < off.mean() < 0.03  # the valve opens 30 ms after the beat's start
    assert off.std() < 0.003


def test_noise_is_that_of_the_samples():
    for noise in (0.5, 2.0):
        given = minute(2, noise=noise, respiration=0.0, ectopics=0.0, sway=0.0)
        beats = import_condition("rest", "none", trace_of(given))
        assert beats.means.noise["P_distal"] == pytest.approx(noise, rel=0.25)


@pytest.mark.parametrize("delay", [-0.04, 0.0, 0.012, 0.08])
def test_shift_between_the_traces_is_stated_and_not_removed(delay):
    given = minute(3, delay=delay)
    found = import_condition("rest", "none", trace_of(given))
    assert found.means.delay == pytest.approx(delay, abs=0.004)
    assert any("ms" in line for line in found.remarks()) == (abs(delay) > 0.03)
    assert found.trace.waves["P_distal"] is not None
    np.testing.assert_array_equal(found.trace.waves["P_distal"], given.columns["p_distal"])


def test_delay_of_a_shifted_beat_is_the_shift():
    phase = np.arange(128) / 128
    beat = np.exp(-(((phase - 0.3) / 0.1) ** 2))
    later = np.exp(-(((phase - 0.35) / 0.1) ** 2))
    assert delay_between(beat, later, 0.8) == pytest.approx(0.04, abs=1e-3)
    assert delay_between(later, beat, 0.8) == pytest.approx(-0.04, abs=1e-3)


def test_change_within_a_recording_is_told():
    given = minute(4, ectopics=0.0)
    fall = np.linspace(1.05, 0.9, given.columns["time"].size)
    given.columns["p_distal"] *= fall
    said = import_condition("ade", "adenosine", trace_of(given)).remarks()
    assert any("--span" in line for line in said)
    steady = import_condition("ade", "adenosine", trace_of(minute(4))).remarks()
    assert not any("--span" in line for line in steady)


def test_bigeminy_is_refused():
    given = minute(5, ectopics=0.9)
    with pytest.raises(CaseError, match=r"are of use|no regular beats"):
        find_beats(trace_of(given))


def test_drift_of_the_wire_from_a_check_and_from_a_repeated_rest():
    def shifted(seed: int, drug: str, offset: float):
        given = minute(seed, ratio=1.0 if drug == CHECK else 0.9)
        given.columns["p_distal"] += offset
        return import_condition("rest", drug, trace_of(given))

    rest, again, check = shifted(0, "none", 0.0), shifted(1, "none", 3.0), shifted(2, CHECK, 3.0)
    known = wire_drift([rest], [check])
    assert known is not None
    assert known.certain
    assert known.size == pytest.approx(3.0, abs=0.3)
    repeated = wire_drift([rest, again], [])
    assert repeated is not None
    assert not repeated.certain
    assert repeated.size == pytest.approx(3.0, abs=0.5)
    assert "the patient has changed" in repeated.sentence(0.9, 90.0)
    assert wire_drift([rest], []) is None


def test_separator_and_decimal_mark_change_no_number(tmp_path):
    columns = minute(0, seconds=20.0).columns
    path = tmp_path / "x.csv"
    values = []
    for separator, decimal in ((",", "."), (";", ","), ("\t", ","), (" ", "."), ("|", ".")):
        path.write_text(export(columns, separator=separator, decimal=decimal))
        values.append(read_console_table(path).values)
    for other in values[1:]:
        np.testing.assert_array_equal(values[0], other)
    path.write_bytes(export(columns).encode("utf-16"))
    np.testing.assert_array_equal(values[0], read_console_table(path).values)


@pytest.mark.parametrize(
    ("aortic", "distal"),
    [("P1 Ao [mmHg]", "P2 distal [mmHg]"), ("CH1: Pa", "CH2: Pd"), ("Pa", "Pd")],
)
def test_columns_are_known_by_the_names_of_consoles(tmp_path, aortic, distal):
    columns = minute(0, seconds=20.0).columns
    path = tmp_path / "x_rest.csv"
    named = {"Zeit [s]": columns["time"], aortic: columns["p_aortic"]}
    path.write_text(export({**named, distal: columns["p_distal"]}))
    trace = read_trace(path, ExportFormat())
    np.testing.assert_allclose(trace.waves["P_distal"], columns["p_distal"], atol=6e-4)


def test_columns_by_number_or_name_and_a_rate_in_place_of_times(tmp_path):
    columns = minute(0, seconds=20.0).columns
    path = tmp_path / "x.csv"
    path.write_text(export({"a": columns["p_distal"], "b": columns["p_aortic"]}))
    for text in ("aortic=1,distal=0", "aortic=b,distal=a"):
        trace = read_trace(path, ExportFormat(column_map(text), rate=100.0))
        np.testing.assert_allclose(trace.t, columns["time"], atol=1e-9)
        np.testing.assert_allclose(trace.waves["P_aorta"], columns["p_aortic"], atol=6e-4)
    for wrong in ("aortic", "aorta=1", "aortic=1,aortic=2"):
        with pytest.raises(ValueError, match=r"ROLE=COLUMN|twice"):
            column_map(wrong)
    with pytest.raises(CaseError, match="no such column"):
        read_trace(path, ExportFormat({"aortic": "c", "distal": "a"}, rate=100.0))


def test_name_of_a_file_says_its_condition(tmp_path):
    names = ["p7_rest_1.csv", "p7_ade.csv", "p7_dobu.csv", "p7_rest_2.csv", "end_equal.csv"]
    found = named_files([str(tmp_path / name) for name in names])
    said = [(file.name, file.drug) for file in found]
    assert said == [
        ("rest", "none"), ("adenosine", "adenosine"), ("dobutamine", "dobutamine"),
        ("rest_2", "none"), ("check", CHECK),
    ]  # fmt: skip
    assert named_files(["dobutamine_high=a.txt"])[0].drug == "dobutamine"
    for wrong in (["a.txt"], ["exercise=a.txt"], ["rest=a.txt", "rest=b.txt"], ["a_equal.csv"]):
        with pytest.raises(CaseError):
            named_files(wrong)


def test_patient_is_what_all_file_names_share(tmp_path):
    files = named_files([f"{tmp_path}/k-17_ruhe.csv", f"{tmp_path}/k-17_dobutamin.csv"])
    assert (files[0].name, common_stem(files)) == ("rest", "k-17")
    files = named_files([f"rest={tmp_path}/k_17_early.csv", f"{tmp_path}/k_17_dobu.csv"])
    assert common_stem(files) == "k-17"
    files = named_files([f"rest={tmp_path}/one.csv", f"dobutamine={tmp_path}/two.csv"])
    assert common_stem(files) == "one"


def test_message_proposes_the_columns_that_carry_the_unit_of_a_pressure(tmp_path):
    columns = minute(3).columns
    named = {"Time (s)": columns["time"], "EKG (mV)": 0.01 * columns["time"]}
    named |= {"Druck 1 (mmHg)": columns["p_aortic"], "Druck 2 (mmHg)": columns["p_distal"]}
    path = tmp_path / "x_rest.csv"
    path.write_text(export(named, separator=";"))
    with pytest.raises(CaseError, match="--columns time=0,aortic=2,distal=3"):
        read_trace(path, ExportFormat())
    given = column_map("aortic=druck 1,distal=Druck 2")
    found = read_trace(path, ExportFormat(given))
    assert found.columns["distal"] == "Druck 2 (mmHg)"
    assert np.allclose(found.waves["P_distal"], columns["p_distal"], atol=0.01)


@pytest.mark.parametrize("head", ["p_aortic", "p_aortic (mmHg)"])
def test_numbers_in_kilopascal_are_told_whatever_the_header_says(tmp_path, head):
    columns = minute(3).columns
    end = head.removeprefix("p_aortic")
    named = {"time": columns["time"], head: columns["p_aortic"] / 7.50062}
    path = tmp_path / "x_rest.csv"
    path.write_text(export({**named, f"p_distal{end}": columns["p_distal"] / 7.50062}))
    with pytest.raises(CaseError, match=r"kPa are \d+ mmHg\), add --unit kPa"):
        read_trace(path, ExportFormat())
    found = read_trace(path, ExportFormat(pressure_unit="kPa"))
    assert np.allclose(found.waves["P_aorta"], columns["p_aortic"], atol=0.1)


def test_exchanged_columns_are_a_reading_of_a_ratio_above_one():
    given = trace_of(minute(3, ratio=1.03))
    said = import_condition("rest", "none", given).remarks()
    assert any("columns are exchanged" in line for line in said)
