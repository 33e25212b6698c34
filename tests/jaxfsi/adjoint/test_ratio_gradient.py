"""The gradient of a ratio of a coupled tube against central differences of the whole march."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.adjoint.ratio_gradient import RatioSensors, advance_part, ratio_gradient
from jaxfsi.core.step.state import initial_state
from jaxfsi.core.step.stepper import prepare
from jaxfsi.verification.coupled_tube import coupled_mesh, coupled_model

STEPS, CYCLE, CHUNK = 12, 8, 4
TIGHT = {"tolerance": 1e-9, "max_iterations": 100, "max_systems": 10}


@pytest.fixture(autouse=True, scope="module")
def promotion():
    with jax.numpy_rank_promotion("allow"):
        yield


class _Memory:
    """Keeps what a sweep gathers; may end it after some chunks."""

    def __init__(self, stop_after=None):
        self.arrays, self.saved, self.stop_after = None, 0, stop_after

    def load(self):
        return self.arrays

    def save(self, arrays):
        self.arrays, self.saved = arrays, self.saved + 1
        if self.saved == self.stop_after:
            raise KeyboardInterrupt


@pytest.fixture(scope="module")
def run():
    model = coupled_model(coupled_mesh())
    reading = RatioSensors(jnp.arange(5), model.names.index("outlet"), model.names.index("inlet"))
    return model, initial_state(model, p=500.0), reading


def _gradient(run, kept=None):
    model, state, reading = run
    stepper = prepare(1e-3, model, **TIGHT)
    return ratio_gradient(
        model, state, stepper, reading, n_steps=STEPS, per_cycle=CYCLE, chunk=CHUNK, kept=kept
    )


def _ratio(run, model=None, state=None):
    reading = run[2]
    model = run[0] if model is None else model
    state, sums = run[1] if state is None else state, np.zeros(2)
    stepper = prepare(1e-3, model, **TIGHT)
    for k in range(STEPS // CHUNK):
        part = advance_part(model, state, stepper, reading, CHUNK)
        state, sums = part.state, sums + (np.asarray(part.sums) if k else 0.0)
    return float(sums[1] / sums[0])


@pytest.mark.slow  # compiles a chunk in reverse mode: two minutes
def test_gradient_equals_differences_and_resumes_bit_for_bit(run):
    model, state, _ = run
    whole = _gradient(run)
    assert whole.ratio == pytest.approx(_ratio(run), rel=1e-12)
    for place in (
        lambda m: m.wall.material.E,
        lambda m: m.ports[1].block.C,
        lambda m: m.blood.rho_f,
    ):
        value = place(model)
        up, down = (
            _ratio(run, eqx.tree_at(place, model, value * (1.0 + h))) for h in (1e-3, -1e-3)
        )
        # central difference: 1e-6 of truncation
        assert float(place(whole.model)) == pytest.approx(
            (up - down) / (2e-3 * float(value)), rel=1e-3
        )
    start = lambda s: s.blocks[1]  # noqa: E731
    up, down = (_ratio(run, state=eqx.tree_at(start, state, start(state) + h)) for h in (5.0, -5.0))
    assert float(start(whole.state)[0]) == pytest.approx((up - down) / 10.0, rel=1e-3)
    memory = _Memory(stop_after=1)
    with pytest.raises(KeyboardInterrupt):
        _gradient(run, memory)
    memory.stop_after = None
    again = _gradient(run, memory)
    assert memory.saved == STEPS // CHUNK
    assert all(
        np.array_equal(a, b)
        for a, b in zip(jax.tree.leaves(whole.model), jax.tree.leaves(again.model), strict=True)
    )


def test_chunks_must_fit(run):
    model, state, reading = run
    with pytest.raises(ValueError, match="cannot be cut"):
        ratio_gradient(model, state, None, reading, n_steps=12, per_cycle=8, chunk=5)
