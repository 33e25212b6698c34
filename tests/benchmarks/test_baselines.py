"""Baselines of the foreign challenge: their tests, networks and features, and what they write."""

import builtins
import io
import json
import pathlib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks.foreign import baselines, other_forms, training
from benchmarks.foreign.amortised import blank, trained
from benchmarks.foreign.boosted import boosted, softened, temperature_of
from benchmarks.foreign.features import (
    KINDS,
    RESIDUAL_MMHG,
    TRACES,
    WINDOWS,
    features_of,
    residual_features,
)
from benchmarks.foreign.plain import FORMS, PlainFit
from benchmarks.foreign.regimes import LEVEL, MEAN_FLOW, failing, regimes_of, single_term
from benchmarks.foreign.score import comparison
from benchmarks.foreign.training import CLASSES, NONE, UNKNOWN, Training, draw_causes
from diagnosis import CATALOGUE, Record, RecordedCondition, measured
from diagnosis.evidence import Whitened
from diagnosis.fit import Fitted
from diagnosis.measured import weights, whitener_of
from diagnosis.prediction import n_unknowns
from diagnosis.scan import Linearised, Scan
from diagnosis.spectra import FROM_SAMPLES, PHASE
from lumped import MMHG


def wave(phase, level):
    """A pressure of few harmonics [dyn/cm²]."""
    turn = 2.0 * np.pi * phase
    return MMHG * (level + 12.0 * np.sin(turn) + 5.0 * np.cos(2.0 * turn) - 2.0 * np.sin(3 * turn))


def record_of(samples, error=lambda phase: 0.0 * phase, rng=None, sd=0.5):
    """A record whose distal pressure under adenosine has an error [mmHg], and white noise."""
    phase = np.arange(samples) / samples
    drugs = ("none", "adenosine", "dobutamine")
    conditions = []
    for order, drug in enumerate(drugs):
        aorta, distal = wave(phase, 90.0), wave(phase, 80.0)
        distal = distal + MMHG * error(phase) * (drug == "adenosine")
        beats = {}
        for name, trace in (("P_aorta", aorta), ("P_distal", distal)):
            noise = 0.0 if rng is None else MMHG * sd * rng.standard_normal(samples)
            beats[name] = (trace + noise)[None]
        conditions.append(
            RecordedCondition(
                drug, drug, order, False, 0.8, 110.0 * MMHG, 70.0 * MMHG, mean_Q=1.2, beats=beats
            )
        )
    return measured(Record("test", tuple(conditions), pressure_sd=sd * MMHG))


def shown(conditions=3):
    """Signals of a fit that knows nothing of the error."""
    flow = np.full_like(PHASE, 1.2)
    return np.tile([wave(PHASE, 90.0), wave(PHASE, 80.0), flow], (conditions, 1, 1))


def test_f_test_has_its_level_whatever_the_scale_of_the_noise():
    rng = np.random.default_rng(0)
    X = rng.standard_normal((80, 6))
    columns = [rng.standard_normal((80, 3)) for _ in range(8)]
    draws = 400
    found = [failing(3.0 * rng.standard_normal(80), X, columns) for _ in range(draws)]
    alarms = np.mean([bool(f) for f in found])
    # three binomial standard deviations; of eight independent tests 1 − (1 − 0.05/8)^8 = 0.049
    assert alarms == pytest.approx(LEVEL, abs=3.0 * np.sqrt(LEVEL * 0.95 / draws))


def test_planted_regime_is_found_and_no_other():
    record = record_of(128)
    regimes = regimes_of(record)
    assert {r.phase for r in regimes} >= {"late systole", MEAN_FLOW}
    W, seen = whitener_of(record), np.asarray(weights(record)).ravel() > 0.0
    C, d = W.weight.shape
    bump = 4.0 * MMHG * np.exp(-0.5 * ((PHASE - 0.3) / 0.03) ** 2)
    change = np.zeros((C, d))
    change[1, FROM_SAMPLES.shape[0] : 2 * FROM_SAMPLES.shape[0]] = FROM_SAMPLES @ bump
    rng = np.random.default_rng(1)
    y = (np.asarray(W(jnp.asarray(change))) + rng.standard_normal((C, d))).ravel()[seen]
    X = rng.standard_normal((y.size, 14))
    found = [(regimes[r].condition, regimes[r].phase) for r in failing(y, X, _columns(regimes))]
    assert found == [(1, "late systole")]


def _columns(regimes):
    return [regime.columns for regime in regimes]


def test_term_is_found_in_one_half_and_confirmed_in_the_other():
    rng = np.random.default_rng(2)
    n, k = 300, 5
    X = np.vstack([rng.standard_normal((n - k, k)), np.eye(k)])
    G = rng.standard_normal((n, 4))
    G[-k:] = 0.0
    A = np.zeros((n, 60))
    A[np.arange(60), np.arange(60)] = 1.0  # a regime is the first sixty data
    y = G @ np.array([0.0, 0.0, -1.0, 0.0]) + 0.5 * rng.standard_normal(n)
    half = np.arange(n) % 2 == 0
    term = single_term(y, X, A, G, np.zeros(4, bool), half)
    assert term is not None
    assert term.position == 2
    assert term.share > 0.5
    assert term.p < 1e-6
    other = single_term(y, X, A, G, np.array([False, False, True, False]), half)
    assert other is not None
    assert other.position != 2  # only a negative size explains, which a one-sided effect has not


def test_network_recovers_a_normal_posterior():
    """φ ~ N(0, 1) seen with noise of 0.5: mean f/1.25, sd √0.2; no size without the effect."""
    rng = np.random.default_rng(3)
    n = 3000
    cause = rng.integers(2, size=n)
    size = np.where(cause == 1, rng.standard_normal(n), np.nan)
    seen = np.where(cause == 1, np.nan_to_num(size), 0.0) + 0.5 * rng.standard_normal(n)
    flag = cause + 0.3 * rng.standard_normal(n)
    network = trained(np.stack([seen, flag], axis=1), cause, size, 2, passes=30)
    for f in (-1.0, 0.5, 1.5):
        log_q, mean, sd = network(jnp.array([f, 1.0]))
        # of 1500 sizes and a network that ends early
        assert float(mean[1]) == pytest.approx(f / 1.25, abs=0.15)
        assert float(sd[1]) == pytest.approx(np.sqrt(0.2), rel=0.2)
        assert float(jnp.exp(log_q[1])) > 0.9


def test_features_do_not_depend_on_the_sampling():
    def error(phase):
        return 2.0 * np.exp(-0.5 * ((phase - 0.3) / 0.08) ** 2)

    clean, _, noisy, silent = (
        residual_features(record, shown())
        for record in (
            record_of(64, error),
            record_of(64),
            record_of(250, error, np.random.default_rng(4)),
            record_of(250, rng=np.random.default_rng(5)),
        )
    )
    sd = 0.5 / np.sqrt(250 / WINDOWS) / RESIDUAL_MMHG
    assert clean.shape == (len(KINDS) * len(TRACES) * WINDOWS,)
    assert np.abs(clean - noisy).max() < 4.0 * sd  # the largest of 48
    assert np.abs(silent).max() < 4.0 * sd
    where = np.unravel_index(np.argmax(clean), (len(KINDS), len(TRACES), WINDOWS))
    assert where == (1, 1, 2)


def fake_fit(record, rng, names):
    """A fit whose residual is white noise."""
    C, d = np.asarray(weights(record)).shape
    k, F = n_unknowns(record), len(FORMS)
    seen = np.asarray(weights(record)) > 0.0
    e = rng.standard_normal((C, d)) * seen
    J, G = rng.standard_normal((C, d, k)), rng.standard_normal((C, d, F))
    one, blank_sizes = jnp.zeros(()), jnp.zeros(F)
    fitted = Fitted(
        x=jnp.zeros(k + 2), optimum=jnp.zeros(k + 2), log_evidence=one, kinds=jnp.ones(3),
        chi2=one, misfit=one, cost=one, residual=jnp.asarray(e), sizes=blank_sizes,
        size_sd=jnp.zeros(2), waves=jnp.asarray(shown(C)), sound=jnp.asarray(True),
    )  # fmt: skip
    scan = Scan(blank_sizes, blank_sizes, blank_sizes, jnp.zeros((F, F)))
    e, J, G = (jnp.asarray(own) for own in (e, J, G))
    return PlainFit(names, record, fitted, Linearised(Whitened(e, J), G), scan)


def fake_simulations(n, k, rng):
    """Simulations whose first feature tells the cause."""
    cause = np.arange(n) % len(CLASSES)
    features = rng.standard_normal((n, k))
    features[:, 0] = cause
    sized = np.array([c not in (NONE, UNKNOWN) for c in CLASSES])[cause]
    return Training(features, cause, np.where(sized, 1.0, np.nan))


def prepared(folder, monkeypatch):
    """A set of one record without labels to read, a training, and fits without a fit."""
    rng = np.random.default_rng(6)
    other_forms.draw(11, 0).write(folder / "set" / "records" / "0000")
    (folder / "set" / "labels.json").write_text("{}")
    k = features_of(fake_fit(record_of(64), rng, ())).size
    (folder / "training").mkdir()
    np.savez(folder / "training" / "features.npz", **fake_simulations(130, k, rng)._asdict())
    network = blank(k, len(CLASSES), jax.random.key(0))
    eqx.tree_serialise_leaves(folder / "training" / baselines.NETWORK, network)

    def fits(records, batch):
        names = [tuple(c.name for c in record.conditions) for record in records]
        arrays = [jax.tree.map(lambda leaf, b=b: leaf[b], batch) for b in range(len(names))]
        return [fake_fit(a, rng, own) for a, own in zip(arrays, names, strict=True)]

    monkeypatch.setattr(baselines, "plain_fits", fits)
    monkeypatch.setattr(baselines, "use_cache", lambda: None)
    monkeypatch.setattr(baselines, "boosted", lambda simulations: boosted(simulations, rounds=2))


@pytest.mark.parametrize("method", baselines.METHODS)
def test_entries_have_the_form_of_the_challenge_without_a_look_at_labels(
    method, tmp_path, monkeypatch
):
    prepared(tmp_path, monkeypatch)
    opened, plainly = [], io.open

    def watched(file, *args, **kwargs):
        opened.append(str(file))
        return plainly(file, *args, **kwargs)

    with monkeypatch.context() as patch:
        patch.setattr(builtins, "open", watched)
        patch.setattr(io, "open", watched)
        baselines.answer_with(tmp_path / "set", method, training=tmp_path / "training")
    assert any(name.endswith("record.toml") for name in opened)
    assert not any("labels" in name or "truth" in name for name in opened)
    answers = json.loads((tmp_path / "set" / f"answers-{method}.json").read_text())
    assert set(answers) == {"0000"}
    for entry in answers.values():
        assert entry["verdict"] in ("no_gap", "named", "ambiguous", "unknown")
        assert set(entry["named"]) <= {effect.id for effect in CATALOGUE}
        assert set(entry["probabilities"]) <= set(CLASSES)
        assert sum(entry["probabilities"].values()) == pytest.approx(1.0, abs=1e-3)
        assert (method == "regime") == ("regimes" in entry)


def test_a_method_that_learns_asks_for_its_training(tmp_path, monkeypatch):
    monkeypatch.setattr(baselines, "use_cache", lambda: None)
    (tmp_path / "records" / "0000").mkdir(parents=True)
    with pytest.raises(ValueError, match="--training"):
        baselines.answer_with(tmp_path, "amortised")


def test_verdicts_follow_from_probabilities():
    def entry(**p):
        return baselines.entry_of(np.array([p.get(name, 0.0) for name in CLASSES]))

    assert entry(none=0.6, inertance=0.4)["verdict"] == "no_gap"
    assert entry(unknown=0.6, inertance=0.4)["verdict"] == "unknown"
    assert entry(none=0.1, inertance=0.9)["named"] == ["inertance"]
    both = entry(inertance=0.5, sensor_gain=0.4, none=0.1)
    assert both["verdict"] == "ambiguous"
    assert both["named"] == ["inertance", "sensor_gain"]


def test_trees_learn_and_temperature_softens_what_is_too_sure():
    simulations = fake_simulations(40 * 4, 3, np.random.default_rng(7))
    few = Training(simulations.features, simulations.cause % 4, simulations.size)
    features = few.features.copy()
    features[:, 0] = few.cause
    p = boosted(few._replace(features=features), rounds=10)(features)
    assert p.shape == (160, len(CLASSES))
    assert np.mean(p.argmax(axis=1) == few.cause) > 0.95
    rng = np.random.default_rng(8)
    sure = np.tile([0.99, 0.01], (500, 1))
    T = temperature_of(sure, (rng.random(500) > 0.7).astype(int))
    assert softened(sure, T)[0, 0] == pytest.approx(0.7, abs=0.06)


def test_causes_come_in_their_shares():
    causes = draw_causes(np.random.default_rng(9), 2000)
    none = np.mean([c is None for c in causes])
    outside = np.mean([c in training.OUTSIDE for c in causes])
    assert none == pytest.approx(training.SHARES["none"], abs=0.03)
    assert outside == pytest.approx(training.SHARES["outside"], abs=0.03)
    assert len(set(causes)) == 1 + len(training.RANGES) + len(training.OUTSIDE)


def test_comparison_counts_what_all_methods_answered(tmp_path):
    label = {"truth": "inertance", "lambda": 9.0, "form": "L dQ/dt"}
    labels = {"records": {f"{k:04d}": label for k in range(3)}}
    (tmp_path / "labels.json").write_text(json.dumps(labels))
    right = {"verdict": "named", "named": ["inertance"], "probabilities": {"inertance": 1.0}}
    wrong = {"verdict": "named", "named": ["sensor_gain"], "probabilities": {"sensor_gain": 1.0}}
    write(tmp_path, "one", {"0000": right, "0001": right, "0002": right})
    write(tmp_path, "two", {"0000": right, "0001": wrong})
    lines = comparison([tmp_path], ["one", "two"]).splitlines()
    assert lines[0] == "| 2 records | one | two |"
    cells = {line.split("|")[1].strip(): line.split("|")[2:4] for line in lines[2:]}
    one, two = cells["right if named"]
    assert "(2/2)" in one
    assert "(1/2)" in two


def write(folder: pathlib.Path, name, answers):
    (folder / f"answers-{name}.json").write_text(json.dumps(answers))
