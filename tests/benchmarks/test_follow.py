"""The advised measurement, followed: Bayes' rule, promises that are kept, and the tables."""

import json
import sys

import numpy as np
import pytest

from benchmarks.blind import __main__ as command
from benchmarks.blind.advice import with_flow
from benchmarks.blind.cases import seal
from benchmarks.blind.follow import case_of, converse_of, standing
from benchmarks.blind.readings import (
    Possible,
    expected_information,
    log_density,
    parts_of,
    scale_of,
    true_reading,
    updated,
)
from diagnosis import Record, RecordedCondition
from diagnosis.next_measurement import READINGS

EQUALISATION = "equalisation check at the end"


@pytest.mark.parametrize("moment", [False, True])
@pytest.mark.parametrize("one_sided", [False, True])
@pytest.mark.parametrize(("mean", "sd"), [(1.3, 0.4), (0.2, 0.9), (-0.1, 0.5)])
def test_density_of_a_reading_is_the_integral_over_the_size(mean, sd, one_sided, moment):
    size = np.linspace(-12.0, 12.0, 240_001)
    prior = np.exp(-0.5 * ((size - mean) / sd) ** 2)
    if moment:
        prior *= size**2 * ((size > 0.0) if one_sided else 1.0)
    prior /= prior.sum()
    for r in (-0.4, 0.0, 0.7, 2.0):
        likelihood = np.exp(-0.5 * ((r - size) / 0.3) ** 2) / (0.3 * np.sqrt(2.0 * np.pi))
        got = log_density(
            np.array(r), np.array(mean), np.array(sd), 0.3, moment=moment, one_sided=one_sided
        )
        # a kink at zero costs the sum the square of its step, 1e-8
        assert float(got) == pytest.approx(np.log(np.sum(prior * likelihood)), abs=1e-5)


def test_update_multiplies_probabilities_by_densities():
    parts = [
        Possible("none", None, 0.5, {}),
        Possible("wire_drift", None, 0.3, {"wire_drift": (2.0, 0.5)}),
        Possible("unknown", "wire_drift", 0.2, {"wire_drift": (1.0, 0.1)}),
    ]
    density = [
        np.exp(float(log_density(np.array(1.5), np.array(m), np.array(s), 0.3)))
        for m, s in ((0.0, 0.0), (2.0, 0.5), (1.0, 0.1))
    ]
    expected = np.array([0.5, 0.3, 0.2]) * density
    got = updated(parts, {"wire_drift": 1.5}, {"wire_drift": 0.3})
    np.testing.assert_allclose(got, expected / expected.sum(), rtol=1e-12)


def drift_row(p, mean, sd, promised=5.0):
    """A row as the diagnosis leaves it where a drift and no gap are possible."""
    return {
        "case": 0, "verdict": "ambiguous", "named": ["wire_drift", "none"], "best": "wire_drift",
        "confirmed": True,
        "probabilities": {"none": 1.0 - p - 0.01, "wire_drift": p, "unknown": 0.01},
        "beside": {"none": 0.01}, "misfit": {"none": 130.0, "wire_drift": 100.0},
        "sizes": {"wire_drift": {"wire_drift": [mean, sd, ""]}}, "worse": [],
        "n_data": 100, "n_unknowns": 10, "last": 3.0, "flow": 2.0,
        "advice": [[EQUALISATION, ["wire_drift", "none"], promised]],
    }  # fmt: skip


def test_realised_information_of_gaussian_hypotheses_is_the_promised():
    rng = np.random.default_rng(3)
    mean, sd, sigma, n = 0.5, 0.6, 0.3, 4000
    # the formula of `next_measurement`, and its converse
    forward = 0.5 * (mean**2 + sd**2) / sigma**2 - 0.5 * np.log1p(sd**2 / sigma**2)
    backward = converse_of(mean, sd, sigma)
    acting = mean + sd * rng.standard_normal(n) + sigma * rng.standard_normal(n)
    absent = sigma * rng.standard_normal(n)

    def log_B(r):
        zero = np.zeros(n)
        return log_density(r, zero + mean, zero + sd, sigma) - log_density(r, zero, zero, sigma)

    for got, promised in ((log_B(acting), forward), (-log_B(absent), backward)):
        assert abs(got.mean() - promised) < 3.0 * got.std() / np.sqrt(n)


def test_expected_information_is_what_the_truth_gains_on_average():
    rng = np.random.default_rng(4)
    parts = parts_of(drift_row(0.4, 0.5, 0.6))
    p, sigma = np.array([part.p for part in parts]), dict(READINGS[EQUALISATION][1])["wire_drift"]
    gains = []
    for _ in range(2000):
        k = rng.choice(p.size, p=p)
        mean, sd = parts[k].sizes.get("wire_drift", (0.0, 0.0))
        r = mean + np.hypot(sd, sigma) * rng.standard_normal()
        after = updated(parts, {"wire_drift": r}, {"wire_drift": sigma})
        gains.append(np.log(after[k] / p[k]))
    expected = expected_information(parts, EQUALISATION, rng, draws=4000)
    # both are means of draws
    error = np.std(gains) * np.sqrt(1.0 / 2000 + 1.0 / 4000)
    assert abs(np.mean(gains) - expected) < 3.0 * error


def test_an_effect_that_acts_is_named_after_its_reading_and_one_that_does_not_is_dropped():
    row = drift_row(0.6, 2.0, 0.5)
    acts = case_of(row, {}, {"kind": "single", "sizes": {"wire_drift": 2.0}}, seed=1)
    assert acts["before"] == "ambiguous"
    assert [option["acts"] for option in acts["advice"]] == ["first"]
    for kind in ("gaussian", "moment"):
        found = acts["outcomes"][kind]
        assert found[EQUALISATION]["standing"] == "right"
        assert found[EQUALISATION]["log_B"] > 10.0
        # no hypothesis predicts anything of another reading
        assert found["occlusion pressure"]["information"] == pytest.approx(0.0, abs=1e-9)
    absent = case_of(row, {}, {"kind": "none", "sizes": {}}, seed=1)
    assert [option["acts"] for option in absent["advice"]] == ["second"]
    assert absent["outcomes"]["gaussian"][EQUALISATION]["standing"] == "no_gap"
    assert absent["outcomes"]["gaussian"][EQUALISATION]["log_B"] < 0.0


def test_standing_of_a_verdict():
    pair = {"kind": "pair", "sizes": {"a": 1.0, "b": 1.0}}
    assert standing("named", ["b", "a"], pair) == "right"
    assert standing("named", ["a"], pair) == "in part"
    assert standing("named", ["a", "c"], pair) == "wrong"
    assert standing("named", ["a"], {"kind": "outside", "sizes": {"a": 1.0}}) == "wrong"
    assert standing("unknown", ["a"], pair) == "unknown"


def test_readings_of_generator_and_catalogue_mean_the_same():
    row = drift_row(0.5, 1.0, 0.1)
    # 3.1 mmHg over three steps, where √3 φ is one form's offset at the end
    assert true_reading("wire_drift", 1.0, row) == pytest.approx(3.1 / 3.0)
    assert scale_of("wire_drift", "slowing down", row) == pytest.approx(3.0**0.5 / 3.0)
    # the drops of φ Q^1.85 and of the reading times Q² are one at the mean flow
    assert true_reading("quadratic_loss", 4.0, row) * 2.0**2 == pytest.approx(4.0 * 2.0**1.85)
    assert true_reading("sensor_gain", 0.05, row) == 0.05


def test_a_flow_waveform_is_added_with_its_noise():
    Q = np.full((8, 128), 2.0)
    beats = {"P_aorta": np.ones((1, 128))}
    condition = RecordedCondition("rest", "none", 0, False, 0.8, 1e5, 8e4, beats=beats)
    record = Record("a", (condition,) * 8)
    kept = with_flow(record, Q, 1, True).conditions
    assert set(kept[0].beats) == {"P_aorta", "Q"}
    assert set(with_flow(record, Q, 1, False).conditions[0].beats) == {"Q"}
    seen = np.stack([c.beats["Q"][0] for c in kept])
    # 5 % slowly, of eight draws, and 5 % a sample
    assert 0.05 < np.std(seen.mean(axis=1)) < 0.2
    assert np.std(seen - seen.mean(axis=1, keepdims=True)) == pytest.approx(0.1, rel=0.2)


def test_the_command_prints_its_tables_from_stored_advice(tmp_path, monkeypatch, capsys):
    labels = [
        {"kind": "single", "sizes": {"wire_drift": 2.0}},
        {"kind": "none", "sizes": {}},
        {"kind": "outside", "sizes": {"echo": 0.1}},
    ]
    seal(tmp_path, labels)
    more = drift_row(0.9, 2.0, 0.3)
    kinds = {"waveforms": drift_row(0.6, 2.0, 0.5), "waveforms+flow": more,
             "waveforms-flow-waveform": more}  # fmt: skip
    for kind, row in kinds.items():
        rows = [{**row, "case": k} for k in range(3)]
        (tmp_path / f"advice-{kind}-0.5.json").write_text(json.dumps(rows))
    arguments = ["blind", "follow", str(tmp_path), "--richness", "waveforms", "--seed", "5"]
    monkeypatch.setattr(sys, "argv", arguments)
    assert command.main() == 0
    printed = capsys.readouterr().out
    assert f"| waveforms | {EQUALISATION} | 3 (3) | 1, 5.00, " in printed
    assert "| waveforms | a reading: 3 of 3 | the advised | " in printed
    line = "| the advised | 1: 1, 0, 0 | 0: 0, 0, 0 | 0: 0, 0, 0 | 0: 0, 0 | 2: 0 |"
    assert f"| waveforms, Gaussian sizes | a reading {line}" in printed
    stored = json.loads((tmp_path / "follow.json").read_text())["waveforms"]
    acts = [case["advice"][0]["acts"] for case in stored]
    assert acts == ["first", "second", "neither"]
    assert len(stored[0]["outcomes"]["gaussian"]) == len(READINGS) + 2
