"""The share of a correction that is taken is the one with the smallest residual."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.core.solve.line_search import first_trial, shortened


def _equations(y):
    """Two circles that meet at (1, 0) and (0, 1)."""
    return jnp.stack([jnp.sum(y**2) - 1.0, jnp.sum((y - 1.0) ** 2) - 1.0])


def _newton_trial(start):
    y = jnp.asarray(start)
    r = _equations(y)
    dy = jnp.linalg.solve(jax.jacobian(_equations)(y), r)
    return first_trial(y)._replace(y=y - dy, base=y, r=r)


# starts close to the line y₀ = y₁, on which the derivative is singular
@pytest.mark.parametrize("start", [(0.52, 0.5), (2.0, 1.9), (-0.3, -0.32)])
@pytest.mark.parametrize("weight", [(1.0, 1.0), (5.0, 0.2)])
def test_share_is_the_best_of_a_quadratic_residual(start, weight):
    weight, trial = jnp.asarray(weight), _newton_trial(start)
    found = shortened(trial, _equations(trial.y), weight)
    shares = np.linspace(0.04, 0.7, 2000)
    sizes = [
        np.linalg.norm(weight * _equations(trial.base + s * (trial.y - trial.base))) for s in shares
    ]
    # shares stand 10 % apart
    assert float(found.share) == pytest.approx(shares[np.argmin(sizes)], rel=0.06)
    on_line = trial.base + found.share * (trial.y - trial.base)
    np.testing.assert_allclose(found.y, on_line, rtol=1e-12)


def test_later_trials_stay_on_the_same_correction():
    trial = _newton_trial((0.502, 0.5))
    first = shortened(trial, _equations(trial.y), jnp.ones(2))
    # the residual of another point on the way: what a stronger law would have left there
    second = shortened(first, 50.0 * _equations(first.y), jnp.ones(2))
    assert float(second.share) < float(first.share)
    direction = (second.y - trial.base) / second.share
    np.testing.assert_allclose(direction, trial.y - trial.base, rtol=1e-9)
    np.testing.assert_array_equal(second.base, trial.base)


def test_it_is_compiled_batched_and_the_same():
    starts = [(0.52, 0.5), (2.0, 1.9)]
    trials = jax.tree.map(lambda *a: jnp.stack(a), *[_newton_trial(s) for s in starts])
    residuals = jnp.stack([_equations(y) for y in trials.y])
    together = jax.jit(jax.vmap(shortened, in_axes=(0, 0, None)))(trials, residuals, jnp.ones(2))
    for k, start in enumerate(starts):
        one = _newton_trial(start)
        alone = shortened(one, _equations(one.y), jnp.ones(2))
        np.testing.assert_allclose(together.y[k], alone.y, rtol=1e-12)
        np.testing.assert_allclose(together.share[k], alone.share, rtol=1e-12)
