import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from calibration import (
    REST_RULE,
    alpha_response,
    alpha_sensitivities,
    calibrate_alpha,
    ratio_response,
    through_calibration,
)
from lumped import Propagator, Shooting, Surrogate, condition_from_clinic, stress_rule

REST = condition_from_clinic(110.0, 65.0, 0.8)
STRESS = condition_from_clinic(130.0, 70.0, 0.45)
MODELS = {
    "linear": (Surrogate(R0=5.0e3, alpha=0.2), Propagator(64)),
    "quadratic": (Surrogate(R0=1.0e3, K=500.0, alpha=0.15), Shooting(48, order=3)),
}
SETTERS = {
    "R0": lambda m: m[0].R0,
    "K": lambda m: m[0].K,
    "alpha": lambda m: m[0].alpha,
    "C0": lambda m: m[0].C0,
    "R_2": lambda m: m[0].coronary.R_2,
    "C_im": lambda m: m[0].coronary.C_im,
    "im_factor": lambda m: m[0].coronary.im_factor,
    "P_systolic": lambda m: m[1].P_systolic,
    "period": lambda m: m[1].period,
    "stress_R_2": lambda m: m[2].R_2,
}


@eqx.filter_jit
def respond(model, solver):
    surrogate, condition, rule = model
    response = ratio_response(surrogate, condition, rule=rule, solver=solver)
    return response.metrics.ratio, response.sensitivity


def moved(model, name, log_factor):
    return eqx.tree_at(SETTERS[name], model, SETTERS[name](model) * np.exp(log_factor))


@pytest.fixture(scope="module", params=list(MODELS))
def case(request):
    surrogate, solver = MODELS[request.param]
    return (surrogate, STRESS, stress_rule("printed")), solver


def test_sensitivities_match_central_differences(case):
    model, solver = case
    _, slopes = respond(model, solver)
    for name in SETTERS:
        if name not in slopes:
            assert name == "K"
            assert model[0].K is None
            continue
        h = 1e-4
        up, down = (jnp.log(respond(moved(model, name, s * h), solver)[0]) for s in (1, -1))
        central = float(up - down) / (2.0 * h)
        # truncation h²/6 = 2e-9 of the third derivative, round-off 1e-15/h
        assert float(slopes[name]) == pytest.approx(central, rel=1e-6, abs=1e-9)


def test_linear_sensitivities_are_those_of_the_divider():
    surrogate, solver = MODELS["linear"]
    _, slopes = respond((surrogate, REST, REST_RULE), solver)
    bed = 0.2 * float(surrogate.coronary.R_total)
    share = 5.0e3 / (5.0e3 + bed)
    # a direct solve of six equations
    assert float(slopes["alpha"]) == pytest.approx(share, rel=1e-11)
    assert float(slopes["R0"]) == pytest.approx(-share, rel=1e-11)
    for name in ("C_a", "C_im", "period", "P_systolic"):
        assert abs(float(slopes[name])) < 1e-11


def test_alpha_response_equals_differentiated_calibration():
    surrogate, _ = MODELS["linear"]
    fit = calibrate_alpha(surrogate, REST, 0.9)
    tuned = eqx.tree_at(lambda s: s.alpha, surrogate, fit.alpha)
    _, slopes = respond((tuned, REST, REST_RULE), Propagator(64))
    ours, theirs = alpha_response(slopes), alpha_sensitivities(surrogate, REST, 0.9)
    # two routes through the same implicit function, each to round-off of Newton's last step
    assert float(ours["R0"]) == pytest.approx(float(theirs["R0"]), rel=1e-9)
    assert float(ours["R_3"]) == pytest.approx(float(theirs["R_3"]), rel=1e-9)
    assert float(ours["rest_ratio"]) == pytest.approx(float(theirs["ratio"]), rel=1e-9)


def test_recalibrated_derivative_matches_recalibrating():
    surrogate, solver = MODELS["linear"]

    def ffr(R0, R_2, ratio):
        patient = eqx.tree_at(lambda s: (s.R0, s.coronary.R_2), surrogate, (R0, R_2))
        alpha = calibrate_alpha(patient, REST, ratio).alpha
        tuned = eqx.tree_at(lambda s: s.alpha, patient, alpha)
        return tuned, respond((tuned, STRESS, stress_rule("printed")), solver)

    start = (jnp.array(5.0e3), surrogate.coronary.R_2, jnp.array(0.9))
    tuned, (_, stress) = ffr(*start)
    _, rest = respond((tuned, REST, REST_RULE), solver)
    total = through_calibration(stress, rest)
    h = 1e-4
    for k, name in enumerate(("R0", "R_2", "rest_ratio")):
        up, down = (
            float(jnp.log(ffr(*start[:k], start[k] * np.exp(s * h), *start[k + 1 :])[1][0]))
            for s in (1, -1)
        )
        # truncation h² and round-off 1e-15/h, as above
        assert float(total[name]) == pytest.approx((up - down) / (2.0 * h), rel=1e-6, abs=1e-9)
    assert abs(float(total["R0"])) < 1e-10
