"""Freedom of uncertain equations against dense Gaussian algebra."""

import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks.foreign import layered
from benchmarks.foreign.plain import in_batches
from diagnosis import diagnose, measured
from diagnosis.catalogue import CATALOGUE
from diagnosis.evidence import Whitened
from diagnosis.form_columns import KINDS, Freedom
from diagnosis.hypothesis import numbers_of, of_kind, uncertain_signals
from diagnosis.measured import whitener_of
from diagnosis.prediction import n_unknowns
from tests.diagnosis.records import synthetic

C, D, K, M, S = 3, 40, 4, 6, 5
RNG = np.random.default_rng(8)
OWN, SHARED = RNG.normal(size=(C, D, M)), RNG.normal(size=(C, D, S))
COVARIANCE = np.eye(C * D) + SHARED.reshape(C * D, S) @ SHARED.reshape(C * D, S).T
for c in range(C):
    COVARIANCE[c * D : c * D + D, c * D : c * D + D] += OWN[c] @ OWN[c].T
FREEDOM = Freedom(jnp.asarray(OWN), jnp.asarray(SHARED))


def test_posterior_beside_a_freedom_is_that_of_the_dense_gaussian():
    e, J = RNG.normal(size=(C, D)), RNG.normal(size=(C, D, K))
    after = FREEDOM.posterior(Whitened(jnp.asarray(e), jnp.asarray(J)), jnp.zeros(K))
    flat = J.reshape(C * D, K)
    whole = COVARIANCE + flat @ flat.T
    y = e.reshape(-1)
    log_Z = -0.5 * y @ np.linalg.solve(whole, y) - 0.5 * np.linalg.slogdet(whole)[1]
    precision = np.eye(K) + flat.T @ np.linalg.solve(COVARIANCE, flat)
    mean = np.linalg.solve(precision, flat.T @ np.linalg.solve(COVARIANCE, y))
    assert float(after.log_evidence) == pytest.approx(log_Z, rel=1e-10)
    np.testing.assert_allclose(after.mean, mean, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(after.covariance, np.linalg.inv(precision), rtol=1e-8, atol=1e-12)


def test_misfits_are_in_units_of_noise_and_freedom_together():
    residuals = RNG.normal(size=(2, C, D))
    found = FREEDOM.misfits(jnp.asarray(residuals))
    flat = residuals.reshape(2, -1)
    exact = [r @ np.linalg.solve(COVARIANCE, r) for r in flat]
    np.testing.assert_allclose(found, exact, rtol=1e-10)


def test_only_a_bed_of_another_structure_gives_the_base_model_a_freedom():
    record = measured(synthetic({}, seed=4))
    x = jnp.zeros(n_unknowns(record) + 2)
    none = jnp.array([-1, -1])
    own = uncertain_signals(record, CATALOGUE, numbers_of(CATALOGUE), none, x, nonlinear=False)
    found = own.freedoms(whitener_of(record))
    (guessed, own_bed), (alike, alike_bed) = (np.abs(np.asarray(a)).max((1, 2, 3)) for a in found)
    assert guessed == alike == 0.0 < own_bed
    assert alike_bed == pytest.approx(3.0 * own_bed, rel=1e-9)  # nine tenths of the variance
    both = np.arange(len(KINDS))
    assert [float(np.abs(of_kind(found, jnp.asarray(k)).shared).max()) > 0.0 for k in both] == [
        False, False, True,
    ]  # fmt: skip


@pytest.mark.slow
def test_a_bed_of_three_layers_is_no_gap(tmp_path):
    for number in (18, 26, 53):
        record = layered.draw(70, number)
        assert record.truth["truth"] == "none"
        record.write(tmp_path / f"{number}")
    found = [d for _, _, batch in in_batches(sorted(tmp_path.iterdir())) for d in diagnose(batch)]
    assert [d.judgement.verdict for d in found] == ["no_gap"] * 3
    for d in found:  # and the record tells that its bed is another one
        assert float(d.base.kinds[-1]) > 0.9
