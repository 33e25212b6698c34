"""The blind benchmark itself: its truth, its seals, and a subset small enough for every run."""

import numpy as np
import pytest

from benchmarks.blind import layers, rates, truth
from benchmarks.blind.cases import Cases, seal, unseal
from benchmarks.blind.diagnoses import diagnose_folder, records_in
from benchmarks.blind.grid import grid_figure, grid_table
from benchmarks.blind.sample import sampled_log_evidence
from benchmarks.blind.score import (
    expected_calibration_error,
    expected_error_if_calibrated,
    misses,
    ranked,
    score,
)
from diagnosis import CATALOGUE, diagnose, measured, stacked
from study.case.record import read_record
from study.case.template import EXAMPLE_FILE, RECORD_FILE, example_traces, record_template
from study.store.cache_folder import VARIABLE

CAUSES = ("quadratic_loss", "vasodilation", "sensor_height", "signal_delay", None, None)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Six cases, marched with fewer steps and beats than the benchmark takes."""
    place = tmp_path_factory.mktemp("blind")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(truth, "STEPS", 3200)
        patch.setattr(truth, "BEATS", 5)
        cases = Cases(1, len(CAUSES), effects=CAUSES)
    cases.write(place / "noise-0.5", 0.5)
    seal(place, cases.labels)
    return place


@pytest.fixture(scope="module")
def rows(folder):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(VARIABLE, "off")
        found = diagnose_folder(folder / "noise-0.5", "waveforms+flow")
    labels = unseal(folder)
    for row in found:
        waves = row.pop("held_out_waves")
        row["label"] = labels[row["case"]]
        level = float(np.std(waves["before"]))
        row["held_out"] = {"before": level, "after": level, "oracle": level}
    return found


def test_a_refused_record_is_left_out_and_named(tmp_path, capsys):
    for k, text in enumerate(("nothing = 1\n", record_template())):
        case = tmp_path / f"case-{k:04d}"
        case.mkdir()
        (case / RECORD_FILE).write_text(text)
        (case / EXAMPLE_FILE).write_text(example_traces())
    found = records_in(sorted(tmp_path.iterdir()))
    assert [place.name for place in found] == ["case-0001"]
    assert "case-0000 is refused" in capsys.readouterr().err


def test_truth_and_catalogue_hold_the_same_effects():
    assert set(truth.RANGES) == {effect.id for effect in CATALOGUE}
    assert not set(truth.OUTSIDE) & set(truth.RANGES)


@pytest.mark.slow
def test_single_causes_are_ranked_first_and_nulls_not_named(rows):
    for row, cause in zip(rows, CAUSES, strict=True):
        if cause is None:
            assert row["verdict"] != "named"
        else:
            assert ranked(row)[0] == cause


@pytest.mark.slow
def test_score_table_and_figure_are_made(rows, tmp_path):
    figures = score(rows)
    assert figures["top-1"].startswith("1.000")
    assert "| subset | 6 |" in grid_table({"subset": rows})
    grid_figure({"subset": rows}, tmp_path / "grid.png")
    assert (tmp_path / "grid.png").stat().st_size > 10_000
    wrong = {**rows[0], "inclusion": {**rows[0]["inclusion"], "wire_drift": 2.0}}
    assert "wire_drift" in misses([wrong])[0]


@pytest.mark.slow
def test_probabilities_agree_with_importance_sampling(folder):
    place = folder / "noise-0.5" / "case-0001"
    (found,) = diagnose(stacked([measured(read_record(place)[0])]))
    best = found.judgement.best
    base, _ = sampled_log_evidence(found, ())
    log_Z, draws = sampled_log_evidence(found, best)
    assert draws > 300
    # Monte Carlo error and the curvature that the linear evidence leaves out
    assert log_Z - base == pytest.approx(found.log_B[best], abs=0.5)


def test_labels_that_were_changed_are_refused(folder, tmp_path):
    seal(tmp_path, unseal(folder))
    text = bytearray((tmp_path / "labels.sealed").read_bytes())
    text[3] ^= 1
    (tmp_path / "labels.sealed").write_bytes(bytes(text))
    with pytest.raises(ValueError, match="were changed after sealing"):
        unseal(tmp_path)


@pytest.mark.slow
def test_clocks_that_divide_no_beat_raise_no_alarm(tmp_path):
    """Patients without an effect, recorded at 60 to 250 Hz with beats of changing length."""
    rng = np.random.default_rng(5)
    found = rates.diagnosed(tmp_path, Cases(5, 16, "none"), rates.draw_clocks(rng, 16), 6)
    verdicts = [diagnosis.judgement.verdict for diagnosis in found if diagnosis is not None]
    assert len(verdicts) == 16
    # 3 % of alarms are allowed: two or more of 16 then come in 8 % of such draws
    assert sum(verdict in ("named", "unknown") for verdict in verdicts) <= 1


@pytest.mark.slow
def test_equal_layers_without_a_branch_are_one_layer(monkeypatch):
    monkeypatch.setattr(truth, "STEPS", 3200)
    monkeypatch.setattr(truth, "BEATS", 2)
    monkeypatch.setattr(layers, "SQUEEZE", (1.0, 1.0))
    monkeypatch.setattr(layers, "SHARES_2", (0.5, 0.5))
    monkeypatch.setattr(layers, "BRANCH", 1e7)
    one = Cases(2, 1, "none").traces["P_distal"]
    two = Cases(2, 1, "none", tier=2).traces["P_distal"]
    # a branch of ten million resistances takes a millionth of the flow
    np.testing.assert_allclose(two, one, atol=1e-3)


def test_calibration_error_of_honest_and_of_boastful_statements():
    p = np.full(1000, 0.8)
    assert expected_calibration_error(p, np.arange(1000) % 5 > 0) == pytest.approx(0.0, abs=1e-12)
    assert expected_calibration_error(p, np.arange(1000) % 2 > 0) == pytest.approx(0.3, abs=1e-12)
    # 1000 statements of one probability: √(2 p (1 − p)/(π n))
    assert expected_error_if_calibrated(p) == pytest.approx(0.0101, rel=0.1)
