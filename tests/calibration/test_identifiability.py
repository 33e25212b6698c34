import jax.numpy as jnp
import numpy as np
import pytest

from calibration import identifiability, ratio_identifiability
from calibration.identifiability import RATIO_PARAMETERS, laplace_covariance
from lumped import Surrogate, condition_from_clinic, nominal_coronary

REST = condition_from_clinic(110.0, 65.0, 0.8)


def test_ratio_of_the_linear_surrogate_determines_alpha_R_total_over_R0_only():
    surrogate = Surrogate(R0=5e3, alpha=0.12)
    found = ratio_identifiability(surrogate, REST, 0.01)
    bed = surrogate.coronary
    R = np.array([float(bed.R_1), float(bed.R_2), float(bed.R_3)])
    ratio = 0.12 * R.sum() / (5e3 + 0.12 * R.sum())
    # the divider theorem, to round-off
    np.testing.assert_allclose(found.ratio, ratio, rtol=1e-12)
    expected = np.concatenate([[-1.0, 1.0], R / R.sum(), [0.0, 0.0, 0.0]]) * (1.0 - ratio)
    np.testing.assert_allclose(found.sensitivities, expected, atol=1e-12)
    assert found.names == RATIO_PARAMETERS
    assert int(found.identifiability.rank) == 1
    assert set(found.identifiability.undetermined) == set(RATIO_PARAMETERS)
    first, second = found.sentences()
    assert first.startswith("The ratio determines only alpha · R_total / R0")
    assert second.startswith("C_a, C_im and C0 have no effect on it")


def test_quadratic_loss_adds_a_parameter_to_what_the_ratio_mixes():
    found = ratio_identifiability(Surrogate(R0=4e3, alpha=0.25, K=2e3), REST, 0.01)
    assert found.names[-1] == "K"
    assert float(found.sensitivities[-1]) < -1e-3
    assert int(found.identifiability.rank) == 1
    assert "The data determine 1 of 9 combinations" in found.sentences()[0]


def test_venous_pressure_breaks_no_sentence():
    surrogate = Surrogate(R0=5e3, alpha=0.3, coronary=nominal_coronary(P_venous=6000.0))
    found = ratio_identifiability(surrogate, REST, 0.01)
    assert found.sentences()[0].startswith("The ratio determines only alpha")


def test_full_rank_covariance_is_the_inverse_of_the_normal_matrix():
    J = jnp.asarray(np.random.default_rng(1).standard_normal((30, 4)))
    found = identifiability(J, "abcd")
    inverse = np.linalg.inv(np.asarray(J).T @ np.asarray(J))
    # condition below 10, round-off
    np.testing.assert_allclose(found.sd, np.sqrt(np.diag(inverse)), rtol=1e-12)
    np.testing.assert_allclose(laplace_covariance(J, jnp.zeros(4, bool)), inverse, atol=1e-14)
    d = np.sqrt(np.diag(inverse))
    np.testing.assert_allclose(found.correlation, inverse / np.outer(d, d), atol=1e-12)
    np.testing.assert_allclose(found.condition, np.linalg.cond(np.asarray(J)), rtol=1e-12)


def test_held_parameters_are_left_out_of_the_covariance():
    J = jnp.asarray(np.random.default_rng(1).standard_normal((30, 3)))
    found = laplace_covariance(J, jnp.array([False, True, False]))
    rest = np.asarray(J)[:, [0, 2]]
    np.testing.assert_allclose(found[::2, ::2], np.linalg.inv(rest.T @ rest), atol=1e-14)
    np.testing.assert_array_equal(found[1], 0.0)
    np.testing.assert_array_equal(found[:, 1], 0.0)


@pytest.mark.parametrize("rows", [1, 2, 6])
def test_singular_jacobians_are_reported_without_nan(rows):
    J = jnp.outer(jnp.arange(1.0, rows + 1.0), jnp.array([1.0, -1.0, 0.5, 0.0]))
    found = identifiability(J, ("p", "q", "r", "s"))
    assert int(found.rank) == 1
    assert np.isinf(float(found.condition))
    assert np.all(np.isinf(np.asarray(found.sd)))
    for array in (found.correlation, found.singular_values, found.directions):
        assert not np.any(np.isnan(np.asarray(array)))
    lines = found.sentences()
    assert "The data determine 1 of 4 combinations" in lines[0]
    assert "q cannot be told from p: +1 % in q is made up for by +1 % in p." in lines
    assert "r cannot be told from p: +1 % in r is made up for by -0.5 % in p." in lines
    assert "s has no effect on the data." in lines


def test_no_data_determine_nothing():
    found = identifiability(jnp.zeros((3, 2)), ("p", "q"))
    assert int(found.rank) == 0
    lines = found.sentences()
    assert "The data determine 0 of 2 combinations" in lines[0]
    assert "p has no effect on the data." in lines


def test_weak_and_alike_parameters_are_named():
    J = jnp.array([[100.0, 99.0], [0.0, 0.4]])
    lines = " ".join(identifiability(J, ("p", "q")).sentences())
    assert "Poorly determined:" in lines
    assert "p and q can hardly be told apart" in lines
