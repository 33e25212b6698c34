import jax.numpy as jnp
import numpy as np
import pytest

from diagnosis.effects import NEAR_ZERO
from diagnosis.evidence import Whitened, log_moment, log_size_factor, posterior


@pytest.mark.parametrize("mean", [-12.0, -3.0, -0.2, 0.0, 2.5])
def test_moment_of_a_one_sided_size_matches_quadrature(mean):
    x = np.linspace(0.0, 12.0, 400_001)
    density = np.exp(-0.5 * (x - mean) ** 2 + 0.5 * min(mean, 0.0) ** 2)
    exact = np.log(np.sum(x**2 * density) / np.sum(density))
    found = log_moment(jnp.array([mean] * 2), jnp.ones(2), jnp.array([1.0, 0.0]))
    # step of the quadrature; far below zero the leading term of the series
    assert float(found[0]) == pytest.approx(exact, abs=0.1 if mean < -6.0 else 1e-4)
    assert float(found[1]) == pytest.approx(np.log(mean**2 + 1.0), rel=1e-12, abs=1e-12)


def test_factor_of_a_size_has_both_parts_of_its_prior():
    mean, variance = jnp.array([0.0, 2.0]), jnp.array([1e-4, 0.3])
    found = np.exp(np.asarray(log_size_factor(mean, variance, jnp.zeros(2))))
    np.testing.assert_allclose(
        found, (1.0 - NEAR_ZERO) * np.array([1e-4, 4.3]) + NEAR_ZERO, rtol=1e-12
    )


def test_evidence_with_columns_matches_the_dense_gaussian():
    rng = np.random.default_rng(3)
    e, J, F = rng.normal(size=(2, 7)), rng.normal(size=(2, 7, 3)), rng.normal(size=(2, 7, 2))
    C = np.eye(14) + J.reshape(14, 3) @ J.reshape(14, 3).T
    for c in range(2):
        C[7 * c : 7 * c + 7, 7 * c : 7 * c + 7] += F[c] @ F[c].T
    flat = e.reshape(14)
    exact = -0.5 * flat @ np.linalg.solve(C, flat) - 0.5 * np.linalg.slogdet(C)[1]
    found = posterior(Whitened(jnp.asarray(e), jnp.asarray(J)), jnp.asarray(F)).log_evidence
    assert float(found) == pytest.approx(exact, rel=1e-12)
