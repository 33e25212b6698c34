"""Functions that are compiled quickly are still functions that JAX transforms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lumped.device import quick_jit

X = jnp.linspace(0.1, 1.0, 5)


@quick_jit
def _rooted(x, power=2):
    return jnp.sqrt(x) ** power + jnp.sin(x)


def test_a_number_is_that_of_the_plain_function():
    assert np.allclose(_rooted(X, power=3), jnp.sqrt(X) ** 3 + jnp.sin(X), rtol=1e-14)


@pytest.mark.parametrize(
    ("transformed", "expected"),
    [
        (lambda x: jax.grad(lambda x: jnp.sum(_rooted(x)))(x), lambda x: 1.0 + jnp.cos(x)),
        (lambda x: jax.vmap(_rooted)(x[:, None])[:, 0], lambda x: x + jnp.sin(x)),
        (jax.jit(lambda x: _rooted(x)), lambda x: x + jnp.sin(x)),
        (jax.jit(lambda x: x + _rooted(np.ones(5))), lambda x: x + 1.0 + jnp.sin(1.0)),
    ],
    ids=["grad", "vmap", "jit", "of a constant within jit"],
)
def test_it_is_transformed_like_any_other(transformed, expected):
    assert np.allclose(transformed(X), expected(X), rtol=1e-13)


def test_it_is_compiled_once():
    traced = []

    def function(x):
        traced.append(x)
        return 2.0 * x

    quick = quick_jit(function)
    assert [float(quick(jnp.asarray(v))) for v in (1.0, 2.0)] == [2.0, 4.0]
    assert len(traced) == 1
