import jax
import jax.numpy as jnp
import numpy as np
import pytest

from calibration import FreeParameter
from calibration.free_parameter import as_free, coordinates, read, write

MODEL = {"a": jnp.asarray(2.0), "b": jnp.asarray(0.3), "c": jnp.asarray(-4.0), "d": (1.0, 5.0)}
FREE = (
    FreeParameter("a", lower=1.0, upper=9.0),
    FreeParameter("b", upper=0.5),
    FreeParameter("c", lower=-6.0, scale="linear"),
    FreeParameter("second", where=lambda m: m["d"][1], scale="linear"),
)


def test_maps_invert_and_stay_inside_their_bounds():
    axes = coordinates(MODEL, FREE)
    np.testing.assert_allclose(axes.values(axes.u_start), [2.0, 0.3, -4.0, 5.0], rtol=1e-14)
    # arcsin and square root lose a few digits next to their ends
    np.testing.assert_allclose(axes.scaled(axes.unbounded(axes.u_start)), axes.u_start, rtol=1e-12)
    for y in (-30.0, -1.0, 0.0, 2.0, 1e3):
        x = axes.values(axes.scaled(jnp.full(4, y)))
        assert 1.0 - 1e-12 <= float(x[0]) <= 9.0 + 1e-12  # round-off of exp and log
        assert float(x[1]) <= 0.5 + 1e-12
        assert float(x[2]) >= -6.0


def test_bend_is_the_ratio_of_derivatives():
    axes = coordinates(MODEL, FREE)
    y = jnp.array([0.4, -0.7, 1.3, 0.2])
    slope = jnp.diag(jax.jacfwd(axes.scaled)(y))
    second = jnp.einsum("iii->i", jax.jacfwd(jax.jacfwd(axes.scaled))(y))
    np.testing.assert_allclose(axes.bend(y), second / slope, rtol=1e-12)  # round-off
    assert np.all(np.isfinite(np.asarray(axes.bend(jnp.zeros(4)))))


def test_read_and_write_are_inverse_and_touch_nothing_else():
    free = as_free(["a", "d.1"])
    changed = write(MODEL, free, jnp.array([7.0, 8.0]))
    np.testing.assert_array_equal(read(changed, free), [7.0, 8.0])
    assert changed["d"][0] == 1.0
    assert changed["b"] is MODEL["b"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"lower": 2.0, "upper": 1.0}, "leave no room"),
        ({"lower": 0.0}, "not positive"),
        ({"lower": np.inf}, "not finite"),
        ({"prior": (1.0, 0.0)}, "positive standard deviation"),
        ({"scale": "decibel"}, "scale"),
    ],
)
def test_bad_declarations_are_refused(options, words):
    with pytest.raises((ValueError, TypeError), match=words):
        FreeParameter("R0", **options)
