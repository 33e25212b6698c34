import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi import Lumen


def ellipse(a: float, b: float, *, n: int = 500, turn: float = 0.0, shift=(0.0, 0.0)):
    t = 2.0 * np.pi * np.arange(n) / n
    points = np.stack([a * np.cos(t), b * np.sin(t)], axis=-1)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return points @ rotation.T + np.asarray(shift)


def lumen_of(*contours) -> Lumen:
    return Lumen(
        contours=jnp.asarray(np.stack(contours)), s=jnp.asarray(0.1 * np.arange(len(contours)))
    )


def test_ellipse_matches_analytic_area_moment_and_axes():
    a, b, n = 0.25, 0.07, 500
    lumen = lumen_of(ellipse(a, b, n=n, turn=0.4, shift=(3.0, -2.0)))
    # A polygon of n points inscribed in an ellipse loses a share (2 pi/n)^2/6 of its area.
    tolerance = 2.0 * (2.0 * np.pi / n) ** 2
    np.testing.assert_allclose(lumen.area, np.pi * a * b, rtol=tolerance)
    np.testing.assert_allclose(
        lumen.polar_moment, np.pi * a * b * (a**2 + b**2) / 4.0, rtol=tolerance
    )
    np.testing.assert_allclose(lumen.equivalent_ellipse.major, a, rtol=tolerance)
    np.testing.assert_allclose(lumen.equivalent_ellipse.minor, b, rtol=tolerance)
    # Directions 1/16 degree apart and points 0.7 degree apart: error of second order in both.
    np.testing.assert_allclose(lumen.calipers.major, 2.0 * a, rtol=1e-4)
    np.testing.assert_allclose(lumen.calipers.minor, 2.0 * b, rtol=1e-4)


def test_polygon_measures_converge_with_second_order():
    def error(n: int) -> float:
        return abs(float(lumen_of(ellipse(0.2, 0.1, n=n)).area[0]) - np.pi * 0.02)

    rates = np.log2([error(50) / error(100), error(100) / error(200)])
    # Second order with a fourth-order remainder below 1 % at these sizes.
    np.testing.assert_allclose(rates, 2.0, atol=0.01)


def test_rectangle_is_exact_and_ignores_sense_of_rotation():
    corners = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [0.0, 1.0]]) + 100.0
    lumen = lumen_of(corners, corners[::-1])
    # Exact but for round-off; coordinates are 100 times the size of the shape.
    np.testing.assert_allclose(lumen.area, 3.0, rtol=1e-12)
    np.testing.assert_allclose(lumen.perimeter, 8.0, rtol=1e-12)
    np.testing.assert_allclose(lumen.polar_moment, 3.0 * (9.0 + 1.0) / 12.0, rtol=1e-11)
    np.testing.assert_allclose(lumen.hydraulic_diameter, 1.5, rtol=1e-12)


@pytest.mark.parametrize("turn", [0.0, 0.013, 0.7])
def test_calipers_of_a_turned_rectangle(turn):
    corners = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [0.0, 1.0]])
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    calipers = lumen_of(corners @ rotation.T).calipers
    np.testing.assert_allclose(calipers.major, np.sqrt(10.0), rtol=1e-6)
    # The width has a kink at its minimum: major x half a direction step of 1/16 degree.
    np.testing.assert_allclose(calipers.minor, 1.0, atol=np.sqrt(10.0) * 5.5e-4)


def _measures(lumen: Lumen) -> dict[str, jax.Array]:
    return {
        "area": lumen.area,
        "perimeter": lumen.perimeter,
        "hydraulic_diameter": lumen.hydraulic_diameter,
        "polar_moment": lumen.polar_moment,
        "caliper_major": lumen.calipers.major,
        "caliper_minor": lumen.calipers.minor,
        "ellipse_major": lumen.equivalent_ellipse.major,
        "ellipse_minor": lumen.equivalent_ellipse.minor,
    }


@pytest.fixture
def wavy() -> Lumen:
    """Ellipses with a smooth random ripple."""
    rng = np.random.default_rng(0)
    t = 2.0 * np.pi * np.arange(200) / 200
    frames = []
    for _ in range(4):
        r = 1.0 + sum(0.05 * rng.normal() * np.cos(k * t + rng.normal()) for k in (2, 3, 4))
        frames.append(r[:, None] * ellipse(0.25, 0.1, n=200))
    return lumen_of(*frames)


@pytest.mark.parametrize("name", list(_measures(lumen_of(ellipse(0.2, 0.1)))))
def test_measures_differentiate(wavy, name):
    direction = jnp.asarray(np.random.default_rng(1).normal(size=wavy.contours.shape))
    # A smooth direction of change: the caliper must not jump to another point of the contour.
    direction = 0.1 * wavy.contours * (1.0 + 0.01 * direction)

    def total(step: jax.Array) -> jax.Array:
        return jnp.sum(_measures(Lumen(wavy.contours + step * direction, wavy.s))[name])

    h = 1e-5
    central = (total(jnp.asarray(h)) - total(jnp.asarray(-h))) / (2.0 * h)
    # Central differences: truncation h^2 and round-off 1e-16/h, both below 1e-8.
    np.testing.assert_allclose(jax.grad(total)(jnp.asarray(0.0)), central, rtol=1e-7)


def test_measures_have_finite_gradients_at_a_disc_and_at_a_repeated_point():
    disc = ellipse(0.2, 0.2)
    disc[1] = disc[0]
    lumen = lumen_of(disc)
    for name in _measures(lumen):
        gradient = jax.grad(lambda x, name=name: jnp.sum(_measures(x)[name]))(lumen)
        assert np.all(np.isfinite(gradient.contours)), name


def test_jit_and_batch_equal_eager_loop(wavy):
    eager = _measures(wavy)
    jitted = eqx.filter_jit(_measures)(wavy)
    many = jax.tree.map(lambda x: jnp.stack([x, 1.1 * x]), wavy)
    batched = jax.vmap(_measures)(many)
    second = _measures(jax.tree.map(lambda x: 1.1 * x, wavy))
    for name, value in eager.items():
        # Same arithmetic in another order: a few units in the last place.
        np.testing.assert_allclose(jitted[name], value, rtol=1e-12)
        np.testing.assert_allclose(batched[name][0], value, rtol=1e-12)
        np.testing.assert_allclose(batched[name][1], second[name], rtol=1e-12)
