"""Evidence over the kinds of equations, of fits that have settled and of one that has not."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from diagnosis import measured
from diagnosis.catalogue import CATALOGUE
from diagnosis.evidence import Whitened, posterior
from diagnosis.hypothesis import guessed_widths, numbers_of, uncertain_signals
from diagnosis.likeliest_kind import SETTLED, in_units_of, likeliest_kind
from diagnosis.measured import whitener_of
from diagnosis.prediction import n_unknowns
from tests.diagnosis.records import synthetic


@pytest.fixture(scope="module")
def given():
    """A linear model of a record's size, the freedoms of its base model, and its unknowns."""
    record, rng = measured(synthetic({}, seed=4)), np.random.default_rng(3)
    W, k = whitener_of(record), n_unknowns(record) + 2
    numbers, none = numbers_of(CATALOGUE), jnp.array([-1, -1])
    uncertain = jax.jit(
        lambda x: uncertain_signals(record, CATALOGUE, numbers, none, x, nonlinear=False)
    )(jnp.zeros(k))
    J = jnp.asarray(rng.normal(size=(*W.weight.shape, k)))
    e = jnp.asarray(rng.normal(size=W.weight.shape)) + J @ jnp.asarray(rng.normal(size=k))
    return Whitened(e, J), uncertain.freedoms(W, with_bed=False), none, jnp.zeros(k)


def kinds_at(x, given):
    linear, freedoms, pair, sided = given
    points = jnp.stack([x] * 3)
    linears = jax.tree.map(lambda a: jnp.stack([a] * 3), linear)
    return jax.jit(likeliest_kind)(
        points, linears, freedoms, jnp.asarray(guessed_widths(x.size)), pair, sided
    )


def test_a_settled_fit_has_the_evidence_of_the_exact_integral(given):
    linear, _, _, sided = given
    exact = posterior(linear, None, sided)
    found = kinds_at(exact.mean, given)
    # whose kind has the narrower unknowns: here they want no more
    assert float(found.kinds[0]) > 0.5
    log_Z = float(found.log_Z + jnp.log(found.kinds[0]) + np.log(3.0))
    assert log_Z == pytest.approx(float(exact.log_evidence), abs=1e-6)


@pytest.mark.parametrize("far", [3.0, 300.0])
def test_a_fit_that_has_not_settled_has_the_squares_of_its_point(far, given):
    linear, _, _, sided = given
    exact = posterior(linear, None, sided)
    x = exact.mean.at[3].add(far)
    found = kinds_at(x, given)
    r = linear.e - linear.J @ x
    there = jnp.sum(r**2) + jnp.sum(x**2)
    best = exact.misfit + jnp.sum(exact.mean**2)
    wanted = exact.log_evidence - 0.5 * (there - best - SETTLED)
    log_Z = found.log_Z + jnp.log(jnp.maximum(found.kinds[0], 1e-300)) + np.log(3.0)
    if float(found.kinds[0]) > 1e-200:
        assert float(log_Z) == pytest.approx(float(wanted), rel=1e-8)
    assert float(found.log_Z) < float(exact.log_evidence) - 10.0 * far


def test_a_wider_unknown_is_one_with_a_column_of_freedom_beside_it(given):
    """Transmission and bypass of guessed equations: in their prior, or as freedom of the data."""
    linear, freedoms, _, sided = given
    freedom = jax.tree.map(lambda a: a[1], freedoms)
    width = guessed_widths(linear.J.shape[-1])
    at = np.flatnonzero(width > 1.0)
    assert at.size == 2
    beside = linear.J[..., at] * np.sqrt(width[at] ** 2 - 1.0)[None, None]
    with_bed = freedom._replace(shared=jnp.concatenate([freedom.shared, beside], axis=-1))
    wide = freedom.posterior(in_units_of(jnp.asarray(width), linear), sided)
    column = with_bed.posterior(linear, sided)
    assert float(wide.log_evidence) == pytest.approx(float(column.log_evidence), rel=1e-9)
    # what is not wider has the same mean
    others = np.flatnonzero(width == 1.0)
    np.testing.assert_allclose(wide.mean[others], column.mean[others], rtol=1e-6, atol=1e-9)
