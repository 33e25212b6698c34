"""Cases shared out among devices give what one device gives."""

import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from calibration import map_cases, sweep_alpha
from lumped import Surrogate, condition_from_clinic

PROGRAM = """
import sys
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from calibration import map_cases
from tests.calibration.test_cases import derivatives, ratios

assert jax.device_count() == 2
shares = eqx.filter_jit(lambda x: map_cases(lambda one: one**2, x, batch_size=4))(jnp.arange(8.0))
assert len(shares.sharding.device_set) == 2, "each device does its share"
np.savez(sys.argv[1], *ratios(), *derivatives())
"""
ALPHAS = jnp.geomspace(0.03, 3.0, 23)


def ratios():
    """Metrics of a sweep of an odd number of cases."""
    found = sweep_alpha(
        Surrogate(R0=5e3), condition_from_clinic(110.0, 65.0, 0.8), ALPHAS, n_samples=32,
        batch_size=5, waveforms=False,
    )  # fmt: skip
    return [np.asarray(leaf) for leaf in jax.tree.leaves((found.metrics, found.error_estimate))]


def derivatives():
    """By what differs from case to case, and by what all share; under `vmap` too."""

    def total(own, shared):
        cases = (own, shared * jnp.ones(()))
        return jnp.sum(map_cases(lambda case: case[1] * case[0] ** 2, cases, batch_size=3))

    own = jnp.arange(7.0)
    slopes = jax.grad(total, argnums=(0, 1))(own, 2.0)
    many = jax.jit(jax.vmap(total, in_axes=(0, None)))(jnp.stack([own, own + 1.0]), 2.0)
    return [np.asarray(value) for value in (*slopes, many)]


def test_cases_may_be_arrays_of_numpy():
    found = map_cases(lambda x: 2.0 * x, np.arange(5.0), batch_size=2)
    np.testing.assert_array_equal(found, 2.0 * np.arange(5.0))


def test_two_devices_give_what_one_gives(tmp_path):
    kept = tmp_path / "two.npz"
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count=2"
    ran = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(kept)],
        env=os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"},
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 0, ran.stderr
    with np.load(kept) as two:
        for name, one in zip(two.files, [*ratios(), *derivatives()], strict=True):
            # the same arithmetic, compiled for another number of devices: round-off
            np.testing.assert_allclose(two[name], one, rtol=1e-11)


def test_derivatives_are_those_of_the_sum():
    by_own, by_shared, many = derivatives()
    own = np.arange(7.0)
    np.testing.assert_allclose(by_own, 4.0 * own)
    assert by_shared == pytest.approx(np.sum(own**2))
    np.testing.assert_allclose(many, [2.0 * np.sum(own**2), 2.0 * np.sum((own + 1.0) ** 2)])
