import jax
import numpy as np
import pytest

from calibration import extrapolated, mesh_band, three_meshes

ACROSS = (2.3, 3.6, 5.2)


def on_mesh(n, order, exact=11.0, C=40.0):
    return exact + C * np.asarray(n) ** -order


@pytest.mark.parametrize("order", [1.0, 2.0, 3.1])
def test_order_and_limit_of_a_power_law_are_found(order):
    found = three_meshes(tuple(on_mesh(ACROSS, order)), ACROSS)
    # the root is found to 1e-12 of the order
    assert found.order == pytest.approx(order, rel=1e-9)
    assert found.expected == pytest.approx(11.0, rel=1e-9)
    fine = on_mesh(ACROSS[-1], order)
    assert found.gci == pytest.approx(1.25 * (fine - 11.0) / fine, rel=1e-9)


def test_numbers_that_swing_have_no_order():
    assert np.isnan(three_meshes((3.0, 1.0, 2.0), ACROSS).order)
    assert np.isnan(three_meshes((3.0, 3.0, 3.0), ACROSS).expected)


@pytest.mark.parametrize("order", [2.0, 2.7, 4.0])
def test_band_of_orders_holds_the_limit(order):
    fine, coarse = on_mesh(3.6, order), on_mesh(2.3, order)
    band = mesh_band(fine, coarse, 3.6 / 2.3, (2.0, 3.0, 4.0))
    assert band.low - 1e-12 <= 11.0 <= band.high + 1e-12
    assert band.low < band.expected < band.high < band.value


def test_meshes_too_much_alike_are_refused():
    with pytest.raises(ValueError, match=r"1\.10 times.*allowed from 1\.2"):
        mesh_band(1.0, 1.1, 1.1, (2.0, 3.0, 4.0))


def test_extrapolation_is_differentiable_and_jittable():
    def limit(x):
        return extrapolated(x[0], x[1], x[2], x[3])

    x = np.array([12.0, 14.0, 1.6, 3.0])
    slope = jax.jit(jax.grad(limit))(x)
    h = 1e-6
    for i, e in enumerate(np.eye(4)):
        # central differences of step 1e-6 are right to 1e-9
        assert slope[i] == pytest.approx(
            float(limit(x + h * e) - limit(x - h * e)) / (2 * h), rel=1e-6
        )
