"""The order in which an accelerator computes: the same answers as on a CPU.

The tests marked `gpu` run on the first accelerator of JAX; the others trace the accelerator's order
and run it on the CPU.
"""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from calibration import sweep_alpha
from jaxfsi.core.solve.krylov import fgmres
from jaxfsi.core.step.march import march
from jaxfsi.core.step.state import initial_state
from jaxfsi.core.step.stepper import prepare
from jaxfsi.verification.coupled_tube import (
    TubeParameters,
    coupled_mesh,
    coupled_model,
    outlet_pressure,
    outlet_pressure_gradient,
)
from lumped import Surrogate, condition_from_clinic, ffr_divider

STEPS = 5
PATIENT, REST = Surrogate(R0=5e3), condition_from_clinic(110.0, 65.0, 0.8)

gpu = pytest.mark.gpu
needs_accelerator = pytest.mark.skipif(
    jax.default_backend() == "cpu", reason="JAX sees no accelerator"
)


@pytest.fixture
def as_accelerator(monkeypatch):
    def switch():
        seen = SimpleNamespace(config=jax.config, default_backend=lambda: "gpu")
        monkeypatch.setattr("lumped.device.jax", seen)
        jax.clear_caches()

    yield switch
    jax.clear_caches()


def _end(tolerance=1e-6):
    model = coupled_model(coupled_mesh())
    stepper = prepare(1e-3, model, tolerance=tolerance)
    return march(model, initial_state(model, p=500.0), stepper, STEPS)


def _compare(found, expected):
    # Each step is solved to 1e-6 of its first residual, by iterations that differ in round-off.
    for name in ("u", "p", "d"):
        one, other = (np.asarray(getattr(end.state, name)) for end in (found, expected))
        assert np.linalg.norm(one - other) <= 1e-5 * np.linalg.norm(other), name


def test_steps_are_those_of_the_cpu(as_accelerator):
    expected = _end()
    as_accelerator()
    found = _end()
    _compare(found, expected)
    # the same method: round-off alone may cost or save an iteration
    change = found.history.report.n_gmres - expected.history.report.n_gmres
    assert np.all(np.abs(change) <= 1)


def test_classical_gram_schmidt_twice_is_as_orthogonal(as_accelerator):
    as_accelerator()
    rng = np.random.default_rng(5)
    A = jnp.asarray(np.diag(np.logspace(0, 4, 60)) + rng.standard_normal((60, 60)))
    b = jnp.asarray(rng.standard_normal(60))
    found = fgmres(lambda v: A @ v, b, lambda v: v, tolerance=1e-10, max_iterations=60)
    true = jnp.linalg.norm(b - A @ found.x)
    # conditioned by 1e4, to round-off times that
    assert float(true) <= 2e-10
    assert float(found.residual) == pytest.approx(float(true), abs=1e-11)


def test_sweep_is_that_of_the_cpu(as_accelerator):
    alphas = jnp.linspace(0.1, 2.0, 300)
    expected = sweep_alpha(PATIENT, REST, alphas, waveforms=False).metrics
    as_accelerator()
    found = sweep_alpha(PATIENT, REST, alphas, waveforms=False).metrics
    # sums in another order
    np.testing.assert_allclose(found.ifr, expected.ifr, rtol=1e-12)


@gpu
@needs_accelerator
def test_steps_on_the_accelerator_are_those_of_the_cpu():
    found = _end()
    with jax.default_device(jax.devices("cpu")[0]):
        expected = _end()
    _compare(found, expected)


@gpu
@needs_accelerator
def test_gradient_on_the_accelerator_is_that_of_central_differences():
    model = coupled_model(coupled_mesh())
    stepper, state = prepare(1e-3, model, tolerance=1e-6), initial_state(model, p=500.0)
    p = TubeParameters(*(jnp.asarray(value, float) for value in TubeParameters()))
    slope = outlet_pressure_gradient(p, model, state, stepper, STEPS).E

    def pressure(E):
        return float(outlet_pressure(p._replace(E=jnp.asarray(E)), model, state, stepper, STEPS))

    h = 1e-2 * float(p.E)
    difference = (pressure(float(p.E) + h) - pressure(float(p.E) - h)) / (2.0 * h)
    # steps of 1 % leave 1e-4; steps solved to 1e-6 leave as much
    assert float(slope) == pytest.approx(difference, rel=2e-3)


@gpu
@needs_accelerator
def test_sweep_on_the_accelerator_follows_the_divider_rule():
    alphas = jnp.linspace(0.05, 2.0, 2000)
    ratio = sweep_alpha(PATIENT, REST, alphas, waveforms=False).metrics.ratio
    exact = ffr_divider(PATIENT.R0, alphas * PATIENT.coronary.R_total)
    np.testing.assert_allclose(ratio, exact, rtol=1e-12)
