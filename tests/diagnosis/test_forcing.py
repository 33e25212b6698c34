import jax.numpy as jnp
import numpy as np
import pytest

from diagnosis.evidence import smooth_scale
from diagnosis.forcing import (
    AMPLITUDES,
    CONDITION_CORRELATIONS,
    FORCING_HARMONICS,
    LENGTHS,
    forcing_mixture,
)
from diagnosis.form_columns import Freedom
from diagnosis.measured import Whitener
from lumped import MMHG


def test_a_forcing_beside_a_cause_matches_the_dense_gaussian():
    """Shared and own parts of a forcing are absorbed one after the other."""
    rng = np.random.default_rng(5)
    C, d, k = 3, 60, 4
    e, J = rng.normal(size=(C, d)), rng.normal(size=(C, d, k))
    m = 2 * FORCING_HARMONICS + 1
    F, form = 0.3 / MMHG * rng.normal(size=(C, d, m)), 0.3 * rng.normal(size=(C, d, 5))
    alike = 0.3 * rng.normal(size=(C, d, 5))
    pair, sided = jnp.array([-1, -1]), jnp.zeros(k)
    a, s, b, c, y = (jnp.asarray(v) for v in (form, alike, F, J, e))
    freedom = Freedom(a[:, None], jnp.zeros((C, 0)), s, Whitener(jnp.ones((C, d))))
    log_Z, means = forcing_mixture(freedom, b, c, y, pair, sided)
    assert means.shape == (log_Z.size, k)
    wide = alike.reshape(C * d, -1)
    n = 0
    for s in CONDITION_CORRELATIONS:
        for length in LENGTHS:
            for amplitude in AMPLITUDES:
                scaled = F * amplitude * smooth_scale(length, FORCING_HARMONICS)
                cov = np.eye(C * d) + J.reshape(C * d, k) @ J.reshape(C * d, k).T
                cov += wide @ wide.T
                for a in range(C):
                    for b in range(C):
                        part = (s + (1.0 - s) * (a == b)) * scaled[a] @ scaled[b].T
                        part += (a == b) * form[a] @ form[b].T
                        cov[a * d : a * d + d, b * d : b * d + d] += part
                flat = e.reshape(-1)
                exact = -0.5 * flat @ np.linalg.solve(cov, flat) - 0.5 * np.linalg.slogdet(cov)[1]
                assert float(log_Z[n]) == pytest.approx(exact, rel=1e-9)
                n += 1
