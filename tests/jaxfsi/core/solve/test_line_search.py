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


# whole corrections from here leave twice to twelve times the residual
STARTS = [(0.7, 0.5), (0.6, 0.3), (0.3, 0.1)]


def _sizes(trial, weight, shares):
    """Norm of the residual at shares of a whole correction."""
    way = trial.y - trial.base
    return np.array([np.linalg.norm(weight * _equations(trial.base + s * way)) for s in shares])


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("weight", [(1.0, 1.0), (5.0, 0.2)])
def test_share_is_the_best_of_a_quadratic_residual(start, weight):
    weight, trial = jnp.asarray(weight), _newton_trial(start)
    found = shortened(trial, _equations(trial.y), weight)
    shares = np.linspace(0.02, 1.0, 2000)
    sizes = _sizes(trial, weight, shares)
    best = shares[np.argmin(sizes)]
    assert 0.2 < best < 0.5
    assert sizes[-1] > np.linalg.norm(weight * trial.r)  # the whole correction made it grow
    # shares stand 10 % apart
    assert float(found.share) == pytest.approx(best, rel=0.06)
    assert _sizes(trial, weight, [float(found.share)]) < 0.8 * np.linalg.norm(weight * trial.r)
    on_line = trial.base + found.share * (trial.y - trial.base)
    np.testing.assert_allclose(found.y, on_line, rtol=1e-12)


@pytest.mark.parametrize("start", STARTS)
def test_any_share_tells_the_same_best_one(start):
    """A later trial is as good a one to learn from as the first."""
    whole = _newton_trial(start)
    share = 0.75
    part = whole._replace(y=whole.base + share * (whole.y - whole.base), share=jnp.asarray(share))
    first = shortened(whole, _equations(whole.y), jnp.ones(2))
    second = shortened(part, _equations(part.y), jnp.ones(2))
    # either is one of a series of shares that stand 10 % apart
    assert float(second.share) == pytest.approx(float(first.share), rel=0.11)
    np.testing.assert_allclose(
        (second.y - whole.base) / second.share, whole.y - whole.base, rtol=1e-9
    )
    np.testing.assert_array_equal(second.base, whole.base)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_residual_that_is_not_finite_takes_a_quarter(value):
    trial = _newton_trial(STARTS[0])
    found = shortened(trial, jnp.full(2, value), jnp.ones(2))
    assert float(found.share) == 0.25
    np.testing.assert_allclose(found.y, trial.base + 0.25 * (trial.y - trial.base), rtol=1e-12)


def test_it_is_compiled_batched_and_the_same():
    trials = jax.tree.map(lambda *a: jnp.stack(a), *[_newton_trial(s) for s in STARTS])
    residuals = jnp.stack([_equations(y) for y in trials.y])
    together = jax.jit(jax.vmap(shortened, in_axes=(0, 0, None)))(trials, residuals, jnp.ones(2))
    for k, start in enumerate(STARTS):
        one = _newton_trial(start)
        alone = shortened(one, _equations(one.y), jnp.ones(2))
        np.testing.assert_allclose(together.y[k], alone.y, rtol=1e-12)
        np.testing.assert_allclose(together.share[k], alone.share, rtol=1e-12)
