import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest

from calibration import (
    Experiment,
    FreeParameter,
    NetworkExperiment,
    fit,
    fit_batch,
    identifiability,
    mean_flow_target,
    mean_pressure_target,
    profile,
    stacked,
    waveform_target,
)
from calibration.free_parameter import as_free, read, write
from lumped import (
    MMHG,
    RCR,
    FlowSource,
    Fourier,
    Shooting,
    Sinusoid,
    Surrogate,
    condition_from_clinic,
    connect,
    ffr_divider,
    stress_rule,
)

NAMES = ("R0", "alpha", "coronary.C_a", "coronary.C_im", "C0")
REST = condition_from_clinic(110.0, 65.0, 0.8)
TRUTH = Surrogate(R0=5e3, alpha=0.3)
TIMES = np.arange(256) * (0.8 / 256)
SD_P, SD_Q = 0.1 * MMHG, 0.01


def waveforms(P, Q):
    """Distal pressure and coronary flow at 256 instants: 512 residuals."""
    return Experiment(
        REST,
        (
            waveform_target("distal", TIMES, P, SD_P),
            waveform_target("ostium", TIMES, Q, SD_Q),
        ),
        solver=Fourier(128),
    )


def predictions(model):
    experiment = waveforms(np.zeros(256), np.zeros(256))
    solution = solved(experiment, model)
    return [np.asarray(target.predicted(solution)) for target in experiment.targets]


@eqx.filter_jit
def solved(experiment, model):
    return experiment.solution(model)


def moved(factors, model=TRUTH, names=NAMES):
    free = as_free(names)
    return write(model, free, read(model, free) * jnp.asarray(factors))


@pytest.fixture(scope="module")
def exact():
    return waveforms(*predictions(TRUTH))


@pytest.fixture(scope="module")
def batch():
    """200 repeats of the same experiment with fresh noise."""
    P, Q = predictions(TRUTH)
    rng = np.random.default_rng(4)
    noise = rng.standard_normal((2, 200, 256))
    one = waveforms(P, Q)
    many = stacked([one] * 200)
    values = (jnp.asarray(P + SD_P * noise[0]), jnp.asarray(Q + SD_Q * noise[1]))
    data = eqx.tree_at(lambda e: [t.value for t in e.targets], many, list(values))
    return data, fit_batch(TRUTH, NAMES, data)


def case(data, k):
    return jax.tree.map(lambda leaf: leaf[k], data)


def test_waveforms_return_their_parameters_from_a_factor_two_off(exact):
    start = moved([2.0, 0.5, 2.0, 0.5, 2.0])
    found = fit(start, NAMES, exact)
    assert found.residual.shape == (512,)
    # round-off of the residuals (1e-12 sd) over the smallest singular value (about 2)
    np.testing.assert_allclose(found.values, read(TRUTH, as_free(NAMES)), rtol=1e-10)
    assert float(found.chi2) < 1e-18
    np.testing.assert_array_equal(read(found.model, found.free), found.values)
    assert found.identifiability.sentences() == ("The data determine all 5 parameters.",)


def test_laplace_covariance_is_that_of_repeated_experiments(batch):
    _, fits = batch
    truth = np.log(np.asarray(read(TRUTH, as_free(NAMES))))
    off = np.log(np.asarray(fits.values)) - truth
    covariance = np.asarray(fits.covariance_scaled)
    square = np.einsum("bi,bij,bj->b", off, np.linalg.inv(covariance), off)
    # a sum of 200 chi-squares of 5 degrees of freedom: mean 1000, sd sqrt(2000); 3.3 sd
    assert abs(np.sum(square) - 1000.0) < 3.3 * np.sqrt(2000.0)
    inside = np.abs(off) < 1.96 * np.asarray(fits.sd_scaled)
    # binomial(200, 0.95): sd 0.0154; 3.3 sd
    assert np.all(np.abs(np.mean(inside, axis=0) - 0.95) < 0.051)
    # chi2 of 512 - 5 degrees of freedom, mean of 200: sd sqrt(2 * 507 / 200); 3.3 sd
    assert abs(np.mean(fits.chi2) - 507.0) < 3.3 * np.sqrt(2 * 507 / 200)


def test_interval_is_symmetric_in_the_logarithm(batch):
    _, fits = batch
    low, high = np.moveaxis(np.asarray(fits.interval(1.0)), -1, 0)
    # definition, to round-off
    np.testing.assert_allclose(low * high, np.asarray(fits.values) ** 2, rtol=1e-12)
    np.testing.assert_allclose(np.log(high / low), 2 * np.asarray(fits.sd_scaled), rtol=1e-9)
    # the delta method: d x = x d log x
    np.testing.assert_allclose(fits.sd, fits.values * fits.sd_scaled, rtol=1e-12)


def test_batch_equals_loop(batch):
    data, fits = batch
    for k in (0, 7):
        one = fit(TRUTH, NAMES, case(data, k))
        # both stop within 1e-7 posterior sd (round-off of the cost), sd up to 0.6
        np.testing.assert_allclose(one.values, fits.values[k], rtol=1e-6)
        np.testing.assert_allclose(one.chi2, fits.chi2[k], rtol=1e-10)


@pytest.mark.slow  # its twin with another solver: test_waveforms_return_their_parameters_...
def test_nonlinear_surrogate_is_fitted_by_shooting():
    truth = Surrogate(R0=4e3, alpha=0.25, K=2e3)
    solver = Shooting(n_steps=16, order=1)
    empty = Experiment(REST, (), solver=solver)
    solution = solved(empty, truth)
    experiment = Experiment(
        REST,
        (
            waveform_target("distal", solution.t, solution.pressure("distal"), SD_P),
            mean_flow_target("ostium", solution.mean_flow("ostium"), 0.01),
        ),
        solver=solver,
    )
    found = fit(Surrogate(R0=6e3, alpha=0.25, K=1e3), ["R0", "K"], experiment)
    # shooting leaves 1e-11 of the pressures, here of 1e2 sd, over singular values of 10
    np.testing.assert_allclose(found.values, [4e3, 2e3], rtol=1e-8)


@pytest.mark.slow
def test_rest_and_stress_together_separate_what_rest_alone_cannot():
    rule = stress_rule("printed")
    names = ("R0", "alpha", "coronary.R_2")
    pressures = condition_from_clinic(130.0, 70.0, 0.5)
    experiments = []
    for condition, change in ((REST, None), (pressures, rule)):
        empty = Experiment(condition, (), rule=change, solver=Fourier(64))
        solution = solved(empty, TRUTH)
        distal, flow = solution.mean_pressure("distal"), solution.mean_flow("ostium")
        targets = (
            mean_pressure_target("distal", distal, SD_P),
            mean_flow_target("ostium", flow, 0.01),
        )
        experiments.append(Experiment(condition, targets, rule=change, solver=Fourier(64)))
    start = moved([1.5, 0.7, 1.2], names=names)
    both = fit(start, names, experiments)
    assert int(identifiability(both.jacobian[:2], names).rank) == 2
    assert int(both.identifiability.rank) == 3
    # conditioning about 1e3
    np.testing.assert_allclose(both.values, read(TRUTH, as_free(names)), rtol=1e-8)


def test_ratio_alone_is_reported_as_singular_not_as_nan():
    def ratio(model):
        bed = model.coronary
        divider = ffr_divider(model.R0, model.alpha * (bed.R_1 + bed.R_2 + bed.R_3))
        return (divider[None] - 0.9) / 0.01

    found = fit(TRUTH, ["R0", "alpha", "coronary.C_a"], ratio)
    # one equation, solved
    assert float(found.chi2) < 1e-18
    assert all(np.all(~np.isnan(np.asarray(leaf))) for leaf in jax.tree.leaves(found.outcome))
    assert np.all(np.isinf(np.asarray(found.sd)))
    assert float(found.values[2]) == pytest.approx(float(TRUTH.coronary.C_a), rel=1e-12)
    text = " ".join(found.identifiability.sentences())
    assert "The data determine 1 of 3 combinations" in text
    assert "Only alpha / (R0) is determined" in text or "Only R0 / (alpha) is determined" in text
    assert "alpha cannot be told from R0: +1 % in alpha is made up for by +1 % in R0." in text
    assert "coronary.C_a has no effect on the data." in text


def windkessel(R_proximal, C, R_distal):
    heart = FlowSource(Sinusoid(80.0, 60.0, 1.0))
    return connect({"heart": (heart, "aorta"), "bed": (RCR(R_proximal, C, R_distal), "aorta")})


BED = ("bed.R_proximal", "bed.C", "bed.R_distal")


@pytest.fixture(scope="module")
def pressure():
    truth = windkessel(100.0, 1e-3, 1200.0)
    return np.asarray(solved(NetworkExperiment(1.0, (), Fourier(32)), truth).pressure("aorta"))


def in_aorta(values):
    target = waveform_target("aorta", jnp.arange(32.0) / 32.0, values, MMHG)
    return NetworkExperiment(1.0, (target,), Fourier(32))


def test_network_parameters_are_fitted(pressure):
    found = fit(windkessel(50.0, 3e-3, 800.0), BED, in_aorta(pressure))
    # one harmonic and a mean: three numbers for three unknowns, condition about 10
    np.testing.assert_allclose(found.values, [100.0, 1e-3, 1200.0], rtol=1e-10)


def test_derivative_of_the_optimum_is_exact_and_jit_equals_eager(pressure):
    rng = np.random.default_rng(8)
    data = jnp.asarray(pressure + 2.0 * MMHG * rng.standard_normal(32))  # leaves a residual
    start = windkessel(80.0, 2e-3, 1000.0)

    def optimum(values):
        return jnp.log(fit(start, BED, in_aorta(values)).values)

    @jax.jit
    def gradient(values):
        found, pull = jax.vjp(optimum, values)
        return found, jax.vmap(lambda row: pull(row)[0])(jnp.eye(3))

    found, rows = gradient(data)
    # both stop within 1e-7 posterior sd (round-off of the cost), sd below 0.1
    np.testing.assert_allclose(found, optimum(data), atol=1e-8)
    shape = MMHG * jnp.sin(2.0 * jnp.pi * jnp.arange(32.0) / 32.0 + 0.4)
    h = 1e-2
    central = (optimum(data + h * shape) - optimum(data - h * shape)) / (2.0 * h)
    # h² times the third derivative, and the stopping error over h
    np.testing.assert_allclose(rows @ shape, central, rtol=1e-4, atol=1e-6)


# a model without haemodynamics keeps the rest quick ------------------------------------------

T = jnp.linspace(0.0, 4.0, 40)


def line(model):
    """Linear in both parameters: everything has a closed form."""
    return (model["a"] + model["b"] * T - 2.0 - 0.5 * T + jnp.sin(9.0 * T)) / 0.3


LINE = {"a": jnp.asarray(1.0), "b": jnp.asarray(0.2)}
LINEAR = (FreeParameter("a", scale="linear"), FreeParameter("b", scale="linear"))


def test_linear_problem_has_the_textbook_answer_and_covariance():
    found = fit(LINE, LINEAR, line)
    X = np.stack([np.ones(40), np.asarray(T)], axis=1)
    y = 2.0 + 0.5 * np.asarray(T) - np.sin(9.0 * np.asarray(T))
    # closed form, round-off
    np.testing.assert_allclose(found.values, np.linalg.lstsq(X, y, rcond=None)[0], rtol=1e-9)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(X.T @ X) * 0.09, rtol=1e-9)


def test_prior_weighs_like_one_more_measurement():
    found = fit(LINE, (FreeParameter("a", scale="linear", prior=(5.0, 0.02)), LINEAR[1]), line)
    X = np.stack([np.ones(40), np.asarray(T)], axis=1) / 0.3
    y = (2.0 + 0.5 * np.asarray(T) - np.sin(9.0 * np.asarray(T))) / 0.3
    X, y = np.vstack([X, [1 / 0.02, 0.0]]), np.append(y, 5.0 / 0.02)
    # closed form, round-off
    np.testing.assert_allclose(found.values, np.linalg.lstsq(X, y, rcond=None)[0], rtol=1e-9)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(X.T @ X), rtol=1e-9)
    expected = np.sum((X @ np.asarray(found.values) - y) ** 2)
    np.testing.assert_allclose(found.cost, expected, rtol=1e-12)


def test_profile_of_a_linear_problem_is_its_parabola():
    found = fit(LINE, LINEAR, line)
    sd = np.asarray(found.sd)[1]
    centre = float(found.values[1])
    steps = jnp.asarray(centre + sd * np.array([-2.0, -0.5, 0.0, 1.0, 3.0]))
    along = profile(found, "b", steps)
    # exactly quadratic; round-off of the cost
    np.testing.assert_allclose(along.rise, ((steps - centre) / sd) ** 2, atol=1e-9)
    share = float(found.covariance[0, 1]) / sd**2
    expected = float(found.values[0]) + share * (steps - centre)
    np.testing.assert_allclose(along.others[:, 0], expected, rtol=1e-8)
    alone = fit(LINE, LINEAR[:1], line)
    np.testing.assert_allclose(profile(alone, "a", [float(alone.values[0])]).rise, 0.0, atol=1e-9)


def test_active_bounds_are_flagged_and_hold():
    def decay(model):
        curve = model["a"] * jnp.exp(-model["b"] * T) + model["c"]
        return (curve - 2.0 * jnp.exp(-1.5 * T) - 0.3) / 0.01

    free = (
        FreeParameter("a", lower=1.0, upper=1.9),
        FreeParameter("b", lower=1.6),
        FreeParameter("c", lower=0.01, upper=1.0),
    )
    start = {"a": jnp.asarray(1.2), "b": jnp.asarray(4.0), "c": jnp.asarray(0.1)}
    found = fit(start, free, decay)
    np.testing.assert_array_equal(found.at_bound, [1, -1, 0])
    # the flag's own width
    np.testing.assert_allclose(found.values[:2], [1.9, 1.6], rtol=2e-5)
    slope = np.asarray(found.jacobian.T @ found.residual)
    scale = np.linalg.norm(np.asarray(found.jacobian), axis=0)
    # the data push beyond the bounds ...
    assert slope[0] < -scale[0]
    assert slope[1] > scale[1]
    # ... and leave the free one without slope, to 1e-14 of the cost (about 1e3) in sd
    assert abs(slope[2]) / scale[2] < 1e-5
    np.testing.assert_array_equal(found.sd[:2], 0.0)
    assert float(found.sd[2]) == pytest.approx(float(found.values[2]) / scale[2], rel=1e-9)
    assert found.messages()[0].startswith("a ended at its upper bound 1.9: the data push beyond.")
    # optimistix' own method, which does not know the map, ends at the same place
    same = fit(start, free, decay, solver=optx.LevenbergMarquardt(rtol=1e-9, atol=1e-9))
    np.testing.assert_allclose(same.values, found.values, rtol=1e-6)
    assert int(found.iterations) < 0.5 * int(same.iterations)


def test_several_starts_find_the_better_of_two_minima():
    def wave(model):
        return (jnp.sin(model["w"] * T) - jnp.sin(3.0 * T)) / 0.1

    start = {"w": jnp.asarray(0.9)}
    free = [FreeParameter("w", lower=0.3, upper=10.0)]
    assert float(fit(start, free, wave).chi2) > 100.0
    found = fit(start, free, wave, starts=40, spread=1.0)
    # noise-free
    np.testing.assert_allclose(found.values, [3.0], rtol=1e-9)
    assert found.start_costs.shape == (40,)
    assert np.sum(np.asarray(found.start_costs) < 1e-12) >= 2


def test_failure_is_a_code_with_cause_and_cure():
    def wave(model):
        return (jnp.exp(-model["a"] * T) - jnp.exp(-3.0 * T)) / 0.01

    start = {"a": jnp.asarray(0.1)}
    with pytest.raises(RuntimeError, match=r"maximum number of steps(.|\n)*starts"):
        fit(start, ["a"], wave, max_steps=2)
    silent = fit(start, ["a"], wave, max_steps=2, throw=False)
    assert silent.result == optx.RESULTS.nonlinear_max_steps_reached

    def broken(model):
        return jnp.log(-model["a"]) * T

    with pytest.raises(RuntimeError, match="not finite"):
        fit(start, ["a"], broken)


def test_batch_names_the_cases_that_failed():
    class Decay(eqx.Module):
        rate: jax.Array

        def __call__(self, model):
            return (jnp.exp(-model["a"] * T) - jnp.exp(-self.rate * T)) / 0.01

    start = {"a": jnp.asarray(1.0)}
    with pytest.raises(RuntimeError, match=r"cases \[1\]"):
        fit_batch(start, ["a"], Decay(jnp.array([1.2, jnp.nan])))
    with pytest.raises(ValueError, match="Leading axes"):
        fit_batch({"a": jnp.ones(3)}, ["a"], Decay(jnp.array([1.2, 1.1])))
    for options, words in (({"starts": 0}, "0 starts"), ({"batch_size": 0}, "batch_size = 0")):
        with pytest.raises(ValueError, match=words):
            fit_batch(start, ["a"], Decay(jnp.array([1.2, 1.1])), **options)
    own = fit_batch({"a": jnp.array([1.0, 0.5])}, ["a"], Decay(jnp.array([1.2, 0.7])))
    # noise-free
    np.testing.assert_allclose(own.model["a"], [1.2, 0.7], rtol=1e-10)


@pytest.mark.parametrize(
    ("free", "words"),
    [
        (["coronary.R2"], r"no 'R2'(.|\n)*R_2"),
        (["K"], "NoneType"),
        (["alpha", "alpha"], "twice"),
        (["alpha", FreeParameter("scale", where=lambda m: m.alpha)], "twice"),
        ([FreeParameter("R0", lower=6e3)], "outside its bounds"),
        ([FreeParameter("R0", upper=1e3)], "outside its bounds"),
        (["coronary.P_venous"], "scale='linear'"),
    ],
)
def test_bad_free_parameters_are_refused(free, words, exact):
    with pytest.raises(ValueError, match=words):
        fit(TRUTH, free, exact)
