"""The blind benchmark itself: its truth, its seals, and a subset small enough for every run."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks.blind import layers, rates, truth
from benchmarks.blind.cases import TIERS, Cases, seal, unseal
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
from benchmarks.blind.sensors import seen
from diagnosis import CATALOGUE, diagnose, measured, stacked
from diagnosis.prediction import OWN, as_waves, condition_settings, predict
from lumped import MMHG
from study.case.record import read_record
from study.case.template import EXAMPLE_FILE, RECORD_FILE, example_traces, record_template
from study.store.cache_folder import VARIABLE
from tests.diagnosis.records import settings

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


def usual_sizes():
    """Geometric mean of each range; zero for all comes first."""
    names = list(truth.RANGES)
    sizes = np.diag([float(np.sqrt(low * high)) for low, high, _ in truth.RANGES.values()])
    return names, np.concatenate([np.zeros((1, len(names))), sizes])


def compared(waves):
    """Change by each effect; Q [mL/s] counts ten times: a drop of the ostium is of that order."""
    return (waves - waves[0])[1:] * np.array([1.0, 1.0, 10.0])[:, None]


@pytest.fixture(scope="module")
def predicted_changes():
    """What the catalogue's effects do: effects × conditions × sensors × samples."""
    names, sizes = usual_sizes()
    order = [names.index(effect.id) for effect in CATALOGUE]
    cases = condition_settings(measured(settings()))

    @jax.jit
    def waves(size):
        def one(case):
            return as_waves(predict(case, jnp.zeros(OWN), CATALOGUE, size))

        return jax.vmap(one)(cases)

    found = np.stack([np.asarray(waves(jnp.asarray(size[order]))) for size in sizes])
    found = found[..., :: found.shape[-1] // truth.SAMPLED] / MMHG
    return compared(found * np.array([1.0, 1.0, MMHG])[:, None])


@pytest.mark.parametrize("tier", TIERS)
def test_every_effect_has_a_form_in_the_truth_that_acts_as_it_does(
    tier, predicted_changes, monkeypatch
):
    monkeypatch.setattr(truth, "STEPS", 1600)
    monkeypatch.setattr(truth, "BEATS", 3)
    names, sizes = usual_sizes()
    cases = condition_settings(measured(settings()))
    count, conditions = len(sizes), cases.period.size
    one = np.ones(count * conditions)
    lanes = {name: one for name in ("C_a", "C_im", "C0")} | {"alpha": 0.25 * one}
    for name in ("period", "order", "stress", "adenosine", "dobutamine"):
        lanes[name] = np.tile(np.asarray(getattr(cases, name)), count)
    for name in ("R0", "P_systolic", "P_diastolic"):
        lanes[name] = np.tile(np.asarray(getattr(cases, name)) / MMHG, count)
    lanes["sizes"] = {n: np.repeat(sizes[:, k], conditions) for k, n in enumerate(names)}
    traces = seen(TIERS[tier](lanes), lanes)
    waves = np.stack([traces[n] for n in ("P_aorta", "P_distal", "Q")], axis=1)
    changes = compared(waves.reshape(count, conditions, 3, -1))
    for name, true, model in zip(names, changes, predicted_changes, strict=True):
        length, expected = np.linalg.norm(true), np.linalg.norm(model)
        # cosines are 0.95 to 1, ratios of lengths 0.8 to 1.6; a form of its own may lie further off
        assert length > 0.4 * expected, f"{name} changes little or nothing in the truth"
        assert length < 2.5 * expected, name
        assert np.sum(true * model) > 0.6 * length * expected, name


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


def test_labels_that_were_changed_are_refused(tmp_path):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(truth, "STEPS", 800)
        patch.setattr(truth, "BEATS", 2)
        cases = Cases(1, 1, effects=CAUSES[:1])
    cases.write(tmp_path / "noise-0.5", 0.5)
    assert len(records_in(sorted((tmp_path / "noise-0.5").iterdir()))) == 1
    seal(tmp_path, cases.labels)
    assert unseal(tmp_path) == cases.labels
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
