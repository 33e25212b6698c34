"""Costly scalars through cheap ones: exact where the difference is of a known form."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import norm

from calibration import LogNormal, Normal, Runs, correction, evaluate, standard_normals, uncertainty

Z90 = norm.ppf(0.95)


def _cheap(z):
    return 2.0 * z[:, 0] - z[:, 1]


def test_terms_of_a_correction_are_found_again():
    z = standard_normals(32, 3)
    cheap = _cheap(z)
    costly = cheap + 0.3 + 0.2 * (cheap - np.mean(cheap)) + 0.5 * z[:, 2]
    found = correction(Runs(costly, cheap, z))
    assert found.kind == "linear"
    assert found.error < 1e-12
    assert found.correlation == pytest.approx(1.0)
    other = standard_normals(8, 3, seed=1)
    cheap_there = _cheap(other)
    expected = cheap_there + 0.3 + 0.2 * (cheap_there - np.mean(cheap)) + 0.5 * other[:, 2]
    assert found(other, cheap_there) == pytest.approx(expected)
    assert found.slope(np.array([2.0, -1.0, 0.0])) == pytest.approx([2.4, -1.2, 0.5])


def test_gain_is_that_of_runs_left_out():
    rng = np.random.default_rng(0)
    z = standard_normals(8, 2)
    cheap = _cheap(z)
    costly = 1.5 * cheap + 0.05 * rng.standard_normal(8)
    found = correction(Runs(costly, cheap, z))
    assert found.kind == "scale"
    missed = []
    for k in range(8):
        rest = np.arange(8) != k
        line = np.polyfit(cheap[rest], costly[rest], 1)
        missed.append(costly[k] - np.polyval(line, cheap[k]))
    assert found.gain == pytest.approx(np.var(costly) / np.mean(np.square(missed)))
    slope, height = np.polyfit(cheap, costly, 1)
    residual = costly - slope * cheap - height
    assert found.error == pytest.approx(np.sqrt(np.sum(residual**2) / 6))
    assert found.freedom == 6


def test_the_error_of_another_sample_is_that_of_a_regression():
    rng = np.random.default_rng(3)
    inside = []
    for _ in range(400):
        # five runs, whose difference is white noise, and another sample in a wider range
        cheap, there = 0.7 + 0.03 * rng.standard_normal(5), 0.7 + 0.1 * rng.standard_normal()
        costly = cheap + 0.1 + 0.01 * rng.standard_normal(5)
        found = correction(Runs(costly, cheap))
        true = there + 0.1 + 0.01 * rng.standard_normal()
        z, g = np.zeros((2, 1)), np.full(2, there)
        half = found.missed(z, g, np.array([norm.ppf(0.05), norm.ppf(0.95)]))
        low, high = np.asarray(found(z, g)) + half
        inside.append(low <= true <= high)
    # of 400, 90 % are met to 0.015; choosing among corrections costs a few hundredths
    assert 0.83 < np.mean(inside) < 0.95


def test_an_error_that_is_expected_counts_as_runs():
    one = correction(Runs(np.array([0.9001]), np.array([0.9]), error=0.02))
    # chance agreement of a single run proves nothing
    assert one.error == pytest.approx(0.02, rel=1e-3)
    assert one.freedom == 4
    many = correction(Runs(np.full(50, 0.8), np.full(50, 0.7), error=0.02))
    assert many.error < 0.01


def test_a_cheap_scalar_that_says_nothing_gains_nothing():
    rng = np.random.default_rng(0)
    found = correction(Runs(rng.standard_normal(9), np.full(9, 0.5)))
    assert found.gain < 1.0
    assert found.correlation == 0.0
    # a scale that rests on a single run is not taken
    alone = correction(Runs(np.array([0.7, 0.71, 0.69, 0.95]), np.array([0.7, 0.7, 0.7, 0.9])))
    assert alone.kind == "shift"


def test_more_terms_than_runs_support_are_not_learned():
    z = standard_normals(8, 12)
    costly = z @ np.linspace(0.0, 1.0, 12)
    assert correction(Runs(costly, np.zeros(8), z)).kind in ("shift", "scale")
    one = correction(Runs(np.array([0.8]), np.array([0.7])))  # without an expected error
    assert (one.kind, one.n_runs) == ("shift", 1)
    assert one.error == pytest.approx(0.1)
    assert np.isnan(one.correlation)
    assert one(z, np.full(8, 0.5)) == pytest.approx(np.full(8, 0.6))


def test_runs_without_a_value_are_left_out_and_none_at_all_is_refused():
    z = standard_normals(4, 2)
    values = np.array([1.0, np.nan, 1.0, 1.0])
    found = correction(Runs(values, np.zeros(4), z))
    assert (found.n_runs, found.n_failed) == (3, 1)
    damaged = np.array(z)
    damaged[0, 1] = np.nan
    assert correction(Runs(np.ones(4), np.zeros(4), damaged)).n_runs == 3
    with pytest.raises(ValueError, match="give one each"):
        correction(Runs(np.ones(4), np.zeros(3)))
    assert found(z, np.zeros(4)) == pytest.approx(np.ones(4))
    with pytest.raises(ValueError, match="give at least one that has"):
        correction(Runs(np.full(4, np.nan), np.zeros(4)))


INPUTS = {"a": Normal(1.0, 0.3), "b": LogNormal(2.0, 0.2)}


def test_an_interval_is_that_of_the_costly_scalar():
    def costly(x):
        return x["a"] + 0.5 * jnp.log(x["b"]) + 0.1

    exact = uncertainty(costly, INPUTS, n_samples=2**14)
    runs = evaluate(costly, lambda x: x["a"], INPUTS, 16)
    found = uncertainty(lambda x: x["a"], INPUTS, runs=[runs], n_samples=2**14)
    assert found.nominal == pytest.approx(exact.nominal)
    assert found.slopes == pytest.approx({**exact.slopes, "model": 0.0}, abs=1e-12)
    # a column of draws more, for the error of the runs, makes it another sequence
    assert found.interval() == pytest.approx(exact.interval(), abs=2e-3)
    assert [level.n_runs for level in found.corrections] == [16]
    assert exact.corrections == ()


def test_levels_follow_each_other():
    def middle(x):
        return x["a"] + 0.5 * jnp.log(x["b"])

    exact = uncertainty(lambda x: 1.5 * middle(x) - 0.2, INPUTS, n_samples=2**12)
    first = evaluate(middle, lambda x: x["a"], INPUTS, 16, name="middle")
    last = evaluate(lambda x: 1.5 * middle(x) - 0.2, middle, INPUTS, 4, name="last")
    last = last._replace(z=None)
    found = uncertainty(lambda x: x["a"], INPUTS, runs=[first, last], n_samples=2**12)
    assert [level.kind for level in found.corrections] == ["linear", "scale"]
    assert found.slopes == pytest.approx({**exact.slopes, "middle": 0.0, "last": 0.0}, abs=1e-12)
    assert found.interval() == pytest.approx(exact.interval(), abs=0.02)


def test_what_runs_cannot_explain_widens_the_interval():
    rng = np.random.default_rng(1)
    z = standard_normals(256, 2)
    cheap = 1.0 + 0.3 * z[:, 0]
    noisy = Runs(cheap + 0.4 * rng.standard_normal(256), cheap, z)
    found = uncertainty(lambda x: x["a"], INPUTS, runs=[noisy], n_samples=2**14)
    # 256 runs give a standard deviation to 1/√512 = 4 %
    assert found.sd == pytest.approx(np.hypot(0.3, 0.4), rel=0.1)
    low, high = found.interval()
    assert (high - low) / 2.0 == pytest.approx(Z90 * 0.5, rel=0.1)
    # and it is a cause like others
    assert found.shares["model"] == pytest.approx(0.64, abs=0.06)
    narrow, wide = found.known_better("model")
    assert wide - narrow < 0.75 * (high - low)
    held = uncertainty(lambda x: x["a"], INPUTS, runs=[noisy], bounds=(0.5, 1.5))
    assert (held.samples.min(), held.samples.max()) == (0.5, 1.5)


def test_runs_of_other_inputs_are_refused():
    with pytest.raises(ValueError, match="one column an input, of which there are 2"):
        uncertainty(
            lambda x: x["a"], INPUTS, runs=[Runs(np.zeros(4), np.zeros(4), np.zeros((4, 3)))]
        )
