"""Error bars: exact where the answer is known, and of FFR with α tuned inside."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import norm

from calibration import (
    Evidence,
    LogNormal,
    Normal,
    Truncated,
    Uniform,
    calibrate_alpha,
    interval_bounds,
    standard_normals,
    uncertainty,
    with_alpha,
)
from calibration.interval import SHARPEST
from lumped import (
    Surrogate,
    condition_from_clinic,
    mean_state,
    stress_rule,
)

Z90 = norm.ppf(0.95)


def test_a_sum_of_normals_is_normal():
    inputs = {"a": Normal(1.0, 0.3), "b": Normal(2.0, 0.4), "c": Normal(5.0, 0.0)}
    found = uncertainty(lambda x: 2.0 * x["a"] - x["b"] + x["c"], inputs, n_samples=2**14)
    assert found.nominal == 5.0
    assert found.slopes == pytest.approx({"a": 0.6, "b": -0.4, "c": 0.0})
    assert found.linear_sd == pytest.approx(np.hypot(0.6, 0.4))
    assert found.sd == pytest.approx(found.linear_sd, rel=1e-3)
    assert list(found.shares) == ["a", "b", "c"]
    assert sum(found.shares.values()) == pytest.approx(1.0)
    # a quantile of n points of a Sobol sequence is off by less than a few of their 1/n
    half = Z90 * found.linear_sd
    assert found.interval() == pytest.approx((5.0 - half, 5.0 + half), abs=3e-3)
    assert found.chance(5.0) == pytest.approx(0.5, abs=2e-3)
    assert found.chance(5.0 - half) == pytest.approx(0.05, abs=2e-3)
    assert found.n_failed == 0


def test_a_product_of_lognormals_is_lognormal():
    inputs = {"a": LogNormal(2.0, 0.5), "b": LogNormal(3.0, 0.2)}
    found = uncertainty(lambda x: x["a"] / x["b"], inputs, n_samples=2**14)
    log_sd = np.hypot(0.5, 0.2)
    bounds = 2.0 / 3.0 * np.exp(np.array([-1.0, 1.0]) * Z90 * log_sd)
    assert found.interval() == pytest.approx(bounds, rel=5e-3)
    assert found.nominal == pytest.approx(2.0 / 3.0)
    # to first order it is symmetric, which it is not
    assert found.linear_sd == pytest.approx(2.0 / 3.0 * log_sd)
    assert found.sd > 1.1 * found.linear_sd


def test_uniform_bounds_are_kept():
    found = uncertainty(lambda x: x["a"] ** 2, {"a": Uniform(1.0, 2.0)}, n_samples=2**10)
    assert found.nominal == pytest.approx(1.5**2)
    assert found.interval(0.998) == pytest.approx((1.001**2, 1.999**2), abs=4e-3)
    assert found.samples.min() >= 1.0
    assert found.samples.max() <= 4.0


def test_what_would_shrink_the_interval():
    inputs = {"a": Normal(0.0, 3.0), "b": Normal(0.0, 4.0)}
    found = uncertainty(lambda x: x["a"] + x["b"], inputs, n_samples=2**14)
    low, high = found.known_better("b")
    # some 2500 samples of equal weight are left where an input is known exactly
    assert (high - low) / 2.0 == pytest.approx(np.hypot(3.0, SHARPEST * 4.0) * Z90, rel=2e-2)
    low, high = found.known_better("b", 0.5)
    assert (high - low) / 2.0 == pytest.approx(np.hypot(3.0, 2.0) * Z90, rel=2e-2)
    same = found.known_better("a", 1.0)
    assert same == found.interval()


REST = condition_from_clinic(110.0, 65.0, 0.8)
STRESS = condition_from_clinic(130.0, 70.0, 0.45)


def stress_ratio(x):
    """Ratio under stress, α tuned to the resting ratio."""
    patient = Surrogate(R0=x["R0"], alpha=1.0)
    fit = calibrate_alpha(patient, REST, x["rest_ratio"], throw=False)
    rule = stress_rule("printed")
    rule = type(rule)(**{**vars(rule), "R_2": x["dilation"] * rule.R_2})
    network = with_alpha(patient.network(STRESS, rule=rule), fit.alpha)
    means = mean_state(network, STRESS.period)
    return means[network.pressure_index("distal")] / means[network.pressure_index("aorta")]


INPUTS = {
    "rest_ratio": Normal(0.91, 0.01),
    "R0": LogNormal(5e3, 0.3),
    "dilation": LogNormal(1.0, 0.3),
}


def _at(z):
    """The inputs at standard normal numbers, 0 where none is given."""
    return {name: s.value(jnp.asarray(z.get(name, 0.0), float)) for name, s in INPUTS.items()}


def test_ffr_with_alpha_tuned_inside():
    found = uncertainty(stress_ratio, INPUTS, n_samples=2**10)
    # α follows R0, so that R0 has no share in the error (see `calibration.sensitivity`)
    assert abs(found.slopes["R0"]) < 1e-9 * abs(found.slopes["dilation"])
    assert set(list(found.shares)[:2]) == {"dilation", "rest_ratio"}
    for name in ("rest_ratio", "dilation"):
        more, less = (float(stress_ratio(_at({name: z}))) for z in (1e-4, -1e-4))
        assert (more - less) / 2e-4 == pytest.approx(found.slopes[name], rel=1e-6)
    # samples are what the function gives
    z = standard_normals(2**10, 3)
    x = _at(dict(zip(INPUTS, z[7], strict=True)))
    assert found.samples[7] == pytest.approx(float(stress_ratio(x)), rel=1e-9)
    low, high = found.interval()
    assert low < found.nominal < high
    assert found.chance(0.0) == 0.0


def test_samples_without_a_value_are_counted_and_too_many_are_refused():
    def root(x):
        return jnp.sqrt(x["a"])

    few = uncertainty(root, {"a": Normal(2.8, 1.0)}, n_samples=2**12)
    assert 0 < few.n_failed <= 0.01 * 2**12
    assert len(few.samples) == len(few.z) == 2**12 - few.n_failed
    with pytest.raises(RuntimeError, match="no value in"):
        uncertainty(root, {"a": Normal(1.0, 1.0)}, n_samples=2**10)
    with pytest.raises(RuntimeError, match="medians"):
        uncertainty(root, {"a": Normal(-1.0, 1.0)})


def test_bad_input():
    with pytest.raises(ValueError, match="at least one input"):
        uncertainty(lambda x: jnp.asarray(0.0), {})
    with pytest.raises(ValueError, match="sd"):
        Normal(1.0, -0.1)
    with pytest.raises(ValueError, match="median"):
        LogNormal(0.0, 0.1)
    with pytest.raises(ValueError, match="not above low"):
        Uniform(2.0, 1.0)
    found = uncertainty(lambda x: x["a"], {"a": Normal(0.0, 1.0)}, n_samples=4)
    with pytest.raises(KeyError, match="take one of a"):
        found.known_better("b")
    with pytest.raises(ValueError, match="factor"):
        found.known_better("a", 1.5)
    with pytest.raises(ValueError, match="level"):
        found.interval(1.0)
    with pytest.raises(ValueError, match="n_samples"):
        uncertainty(lambda x: x["a"], {"a": Normal(0.0, 1.0)}, n_samples=1)


def test_evidence_is_bayes_rule_of_normals():
    inputs = {"a": Normal(1.0, 0.3), "b": Normal(2.0, 0.4)}
    seen = Evidence(lambda x, _: x["a"] + x["b"], 3.4, 0.25)
    found = uncertainty(lambda x: x["a"] - x["b"], inputs, evidence=[seen], n_samples=2**14)
    # of jointly normal y = a − b and m = a + b
    gain = (0.3**2 - 0.4**2) / (0.3**2 + 0.4**2 + 0.25**2)
    mean = -1.0 + gain * 0.4
    sd = np.sqrt(0.3**2 + 0.4**2 - gain * (0.3**2 - 0.4**2))
    # some 10^4 samples of equal weight
    assert found.n_effective > 5000
    assert np.mean(found.samples) == pytest.approx(mean, abs=0.01)
    assert found.sd == pytest.approx(sd, rel=0.02)
    assert found.interval() == pytest.approx((mean - Z90 * sd, mean + Z90 * sd), abs=0.03)
    # the part of a in the variance of y is its covariance with y, given m
    total = 0.3**2 + 0.4**2 + 0.25**2
    part = 0.3**2 * (1.0 - 0.3**2 / total) + 0.3**2 * 0.4**2 / total
    assert found.slopes["a"] == pytest.approx(np.sqrt(part), rel=0.02)
    assert found.linear_sd == pytest.approx(found.sd, rel=1e-6)


def test_evidence_that_nothing_agrees_with_is_refused():
    inputs = {"a": Normal(1.0, 0.1)}
    with pytest.raises(RuntimeError, match="contradict each other: the nearest of"):
        uncertainty(lambda x: x["a"], inputs, evidence=[Evidence(lambda x, _: x["a"], 9.0, 0.1)])
    with pytest.raises(ValueError, match="standard deviation above 0"):
        uncertainty(lambda x: x["a"], inputs, evidence=[Evidence(lambda x, _: x["a"], 1.0, 0.0)])
    with pytest.raises(ValueError, match="finite value"):
        uncertainty(lambda x: x["a"], inputs, evidence=[Evidence(lambda x, _: x["a"], np.nan, 0.1)])


def test_widths_follow_the_noise_of_the_measurement():
    def width(sd, n=2**12):
        inputs = {**INPUTS, "rest_ratio": Normal(0.91, sd)}
        low, high = interval_bounds(stress_ratio, inputs, n_samples=n)
        return high - low

    slope = jax.grad(width)(0.01)
    h = 1e-5
    # where two samples change places the derivative of a bound has a kink, of 1/n
    assert float(slope) == pytest.approx(
        float((width(0.01 + h) - width(0.01 - h)) / (2 * h)), rel=1e-3
    )
    assert float(slope) > 0.0


def test_bounds_of_a_normal_and_their_derivative():
    def bounds(sd):
        return interval_bounds(lambda x: x["a"], {"a": Normal(3.0, sd)}, n_samples=2**14)

    expected = 3.0 + Z90 * 0.2 * np.array([-1.0, 1.0])
    assert np.asarray(bounds(0.2)) == pytest.approx(expected, abs=1e-3)
    assert np.asarray(jax.jacfwd(bounds)(0.2)) == pytest.approx([-Z90, Z90], rel=2e-3)
    found = uncertainty(lambda x: x["a"], {"a": Normal(3.0, 0.2)}, n_samples=2**14)
    assert np.asarray(bounds(0.2)) == pytest.approx(found.interval(), abs=1e-3)
    with pytest.raises(ValueError, match="not between 0 and 1"):
        interval_bounds(lambda x: x["a"], {"a": Normal(3.0, 0.2)}, level=1.0)


def test_precise_evidence_is_met_by_more_samples():
    inputs = {"a": Normal(1.0, 0.3), "b": Normal(0.0, 1.0)}
    seen = Evidence(lambda x, _: x["a"], 1.2, 0.002)
    found = uncertainty(lambda x: x["a"] + 0.1 * x["b"], inputs, evidence=[seen], n_samples=2**10)
    assert found.n_effective >= 30.0
    assert np.mean(found.samples) == pytest.approx(1.2, abs=0.05)
    too_sharp = Evidence(lambda x, _: x["a"], 1.2, 1e-6)
    with pytest.raises(RuntimeError, match=r"contradict|samples agree with what was measured"):
        uncertainty(lambda x: x["a"], inputs, evidence=[too_sharp], n_samples=2**8)


def test_known_better_stays_within_what_can_be():
    # bounded, skewed, and with evidence: to first order it would leave the range
    inputs = {"r": Truncated(0.99, 0.02, 0.0, 0.999), "f": LogNormal(0.5, 0.5)}

    def ratio(x):
        beta = x["f"] * x["r"] / (1.0 - x["r"])
        return beta / (1.0 + beta)

    seen = Evidence(lambda x, y: y / x["f"], 1.2, 0.2)
    found = uncertainty(ratio, inputs, evidence=[seen], n_samples=2**12)
    low, high = found.interval()
    for name in inputs:
        a, b = found.known_better(name)
        assert 0.0 < a < b < 1.0
        assert b - a < high - low


def test_causes_after_evidence_add_up_to_the_variance():
    inputs = {"a": Normal(0.0, 1.0), "b": Normal(0.0, 1.0)}
    seen = Evidence(lambda x, y: y, 0.3, 0.1)
    found = uncertainty(lambda x: x["a"] + x["b"], inputs, evidence=[seen], n_samples=2**14)
    # evidence on the sum leaves the parts free against each other: they explain little of it
    assert found.linear_sd == pytest.approx(found.sd, rel=0.05)
    assert found.shares["a"] == pytest.approx(0.5, abs=0.1)
