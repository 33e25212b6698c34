"""The oracle of the foreign sets: evidence against closed forms, truths named, and regret."""

import json

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from benchmarks.foreign import other_forms
from benchmarks.foreign.branches import evidences
from benchmarks.foreign.catalogue import DRAWERS
from benchmarks.foreign.effect_runs import bench, differences
from benchmarks.foreign.evidence import Metric, Nodes, integrate
from benchmarks.foreign.form import EffectForm
from benchmarks.foreign.oracle import DRAWERS_OF, hypotheses, named, residual, verdict
from benchmarks.foreign.patient import draw_patient
from benchmarks.foreign.replay import leaves
from benchmarks.foreign.score import table

CHEAP = ("sensor_height", "wire_drift", "aortic_zero_error", "outside:flow_error")
"""Truths whose runs cost nothing."""


def toy(seed=0, n=30):
    rng = np.random.default_rng(seed)
    return rng.normal(size=n), rng.normal(size=(n, 2)), rng.normal(size=n)


def test_density_without_nuisances_is_that_of_their_sum():
    r, J, _ = toy()
    G = np.eye(r.size) + J @ J.T
    log_det = np.linalg.slogdet(2.0 * np.pi * G)[1]
    expected = -0.5 * (r @ np.linalg.solve(G, r) + log_det)
    assert Metric.of(J).log_density(r) == pytest.approx(expected, abs=1e-9)


def test_density_is_the_integral_over_one_nuisance():
    r, J, _ = toy(n=6)
    J = J[:, :1]

    def joint(u):
        return np.exp(norm.logpdf(r - J[:, 0] * u).sum()) * norm.pdf(u)

    brute = quad(joint, -12.0, 12.0, epsabs=1e-14)[0]
    assert Metric.of(J).log_density(r) == pytest.approx(np.log(brute), abs=1e-6)


@pytest.mark.parametrize("strength", [0.1, 3.0, 100.0])
def test_evidence_of_a_linear_effect_is_the_closed_form(strength):
    """d = z e with z ~ N(0, 1) is one more Gaussian direction, however narrow its likelihood."""
    r, J, e = toy(3)
    e = strength * e
    r = r + 0.7 * e
    metric = Metric.of(J)
    z = np.array([[-1.0], [0.5], [1.5]])
    nodes = Nodes.of(z, e[:, None] * z[:, 0], r, metric, [None])
    expected = Metric.of(np.column_stack([J, e])).log_density(r) - metric.log_density(r)
    # importance sampling with about 1000 effective samples
    assert integrate(nodes.gain, 1).log_evidence == pytest.approx(expected, abs=0.1)


def test_branches_of_a_drawer_share_its_probability():
    patient = draw_patient(np.random.default_rng(0))
    for name in ("vasodilation", "wire_drift", "quadratic_loss", "outside:arrhythmia"):
        found = leaves(DRAWERS[name], patient)
        assert sum(np.exp(leaf.log_share) for leaf in found) == pytest.approx(1.0)
    dilations = leaves(DRAWERS["vasodilation"], patient)
    assert len(dilations) == 6  # three forms, wider or narrower
    assert {len(leaf.used) for leaf in dilations} == {1}
    assert leaves(DRAWERS["outside:arrhythmia"], patient)[0].course


def test_runs_side_by_side_are_those_of_one_form_alone():
    scene = other_forms.with_form(EffectForm(), np.random.default_rng(5)).scene
    b = bench(scene)
    leaf = leaves(DRAWERS["quadratic_loss"], scene.patient)[0]
    forms = [leaf.form(np.full(len(leaf.used), z)) for z in (-1.0, 0.0)]
    both = differences(b, forms, precise=False)
    for form, d in zip(forms, both, strict=True):
        alone = differences(b, [form], precise=False)[0]
        assert d == pytest.approx(alone, abs=1e-8)


def probabilities(effect, seed):
    """Of the cheap truths alone."""
    rng = np.random.default_rng([seed, 21])
    record = other_forms.with_form(DRAWERS[effect](rng), rng)
    b = bench(record.scene)
    drawers = {name: DRAWERS[name] for name in CHEAP}
    log = evidences(b, residual(b, record.files), drawers)
    prior = hypotheses(DRAWERS_OF["other_forms"])
    weights = {name: prior[name] * np.exp(log.get(name, 0.0)) for name in ("none", *CHEAP)}
    total = sum(weights.values())
    return record, {name: w / total for name, w in weights.items()}


def test_a_visible_effect_is_named():
    for effect in ("sensor_height", "wire_drift"):
        record, p = next(
            one
            for one in (probabilities(effect, seed) for seed in range(20))
            if one[0].truth["lambda"] > 6.0
        )
        assert p[effect] > 0.9, record.truth


def test_a_null_is_no_gap_most_times():
    said = [verdict(named(probabilities("none", s)[1], other=False))["verdict"] for s in range(4)]
    assert said.count("no_gap") >= 3


def test_verdicts_follow_the_probabilities():
    assert verdict({"none": 0.6, "inertance": 0.4})["verdict"] == "no_gap"
    assert verdict({"unknown": 0.8, "inertance": 0.2})["verdict"] == "unknown"
    assert verdict({"inertance": 0.95, "none": 0.05})["named"] == ["inertance"]
    unsure = verdict({"inertance": 0.5, "signal_delay": 0.48, "none": 0.02})
    assert unsure["verdict"] == "ambiguous"
    assert unsure["named"] == ["inertance", "signal_delay"]
    truths = {"none": 0.5, "outside:bridge": 0.2, "outside:distal_gain": 0.3}
    assert named(truths, other=False) == {"none": 0.5, "unknown": 0.2, "sensor_gain": 0.3}
    assert "none" not in named(truths, other=True)


def test_regret_of_the_oracle_is_nought_and_rows_need_its_answers(tmp_path):
    labels = {
        "0000": {"truth": "inertance", "lambda": 9.0},
        "0001": {"truth": "none", "lambda": 0.0},
        "0002": {"truth": "outside:bridge", "lambda": 4.0},
    }
    best = {
        "0000": verdict({"inertance": 0.97, "none": 0.03}),
        "0001": verdict({"none": 0.8, "inertance": 0.2}),
        "0002": verdict({"unknown": 0.9, "inertance": 0.1}),
    }
    worse = {name: verdict({"none": 1.0}) for name in labels}
    (tmp_path / "labels.json").write_text(json.dumps({"records": labels}))
    (tmp_path / "answers-own.json").write_text(json.dumps(worse))
    assert "log-score regret" not in table([tmp_path], "own")
    (tmp_path / "answers-oracle.json").write_text(json.dumps(best))
    itself = table([tmp_path], "oracle")
    assert "| log-score regret, 90 % | 0.00 [0.00, 0.00] |" in itself
    assert "method, oracle | 1, 1 of 1 |" in itself
    own = table([tmp_path], "own")
    expected = (np.log(0.97 / 0.01) + np.log(0.8) + np.log(0.9 / 0.01)) / 3.0
    assert f"| log-score regret, 90 % | {expected:.2f} [" in own
    assert "method, oracle | 0, 1 of 1 |" in own
