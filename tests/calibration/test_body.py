import jax
import jax.numpy as jnp
import pytest

from calibration import Body, body_surface_area, coronary_flow, right_share, territory_flow
from calibration.body import (
    diastolic_pressure,
    left_ventricular_mass,
    resting_period,
    stroke_volume,
    systolic_pressure,
)
from calibration.growth_charts import height_at
from lumped import ML_PER_MIN, MMHG

CHILD = Body(32.0, 139.0, 10.2, 1.0)
SHARES = ("right", "left", "balanced")


def at_median_height(age, male):
    return Body(None, float(height_at(age, male)), age, male)


def test_surface_of_a_body():
    # by hand: 0.024265 · 139^0.3964 · 32^0.5378
    assert float(body_surface_area(CHILD)) == pytest.approx(1.1065, abs=5e-4)
    # Mosteller's √(height · weight/3600) is within a few hundredths in children
    assert float(body_surface_area(CHILD)) == pytest.approx((139 * 32 / 3600) ** 0.5, rel=0.02)


def test_a_number_that_the_body_lacks_is_named():
    with pytest.raises(ValueError, match=r"no weight_kg and no height\. Give weight_kg"):
        body_surface_area(Body(age_years=10.0))
    with pytest.raises(ValueError, match="no male"):
        systolic_pressure(Body(None, 139.0, 10.2))
    with pytest.raises(ValueError, match="no age_years"):
        resting_period(Body(32.0, 139.0))


@pytest.mark.parametrize(("age", "rate"), [(5.0, 96.0), (13.5, 78.0), (40.0, 72.0)])
def test_rate_meets_the_national_means(age, rate):
    # Ostchega et al. 2011; their standard errors are 0.2 to 0.5
    assert 60.0 / float(resting_period(Body(age_years=age))) == pytest.approx(rate, abs=0.3)


def test_rate_of_infants_is_that_of_another_review():
    # Fleming et al. 2011, Lancet 377:1011: median of 113 at 2 years, not used in the fit
    assert 60.0 / float(resting_period(Body(age_years=2.0))) == pytest.approx(113.0, rel=0.03)


@pytest.mark.parametrize(("pressure", "sd", "published"), [
    (systolic_pressure, 10.7128, (102.0, 115.0, 119.0, 127.0)),
    (diastolic_pressure, 11.6032, (61.0, 76.0, 80.0, 88.0)),
])  # fmt: skip
def test_pressures_are_those_of_the_fourth_report(pressure, sd, published):
    # boys of 10 years at the median height: percentiles 50, 90, 95, 99 of the printed tables,
    # which are rounded to 1 mmHg and smoothed
    middle = float(pressure(at_median_height(10.0, 1.0))) / MMHG
    for z, value in zip((0.0, 1.2816, 1.6449, 2.3263), published, strict=True):
        assert middle + sd * z == pytest.approx(value, abs=1.1)


def test_tall_children_have_higher_pressures_and_adults_those_of_17_years():
    tall, short = (Body(None, float(height_at(12.0, 0.0, z)), 12.0, 0.0) for z in (1.5, -1.5))
    assert float(systolic_pressure(tall)) > float(systolic_pressure(short)) + 3.0 * MMHG
    grown = [systolic_pressure(Body(None, 176.85, age, 1.0)) for age in (20.0, 50.0)]
    assert float(grown[0]) == float(grown[1])


def test_stroke_index_meets_the_aortic_flow_of_another_cohort():
    # Ahn et al. 1990: stroke distance 23.8 ± 4.0 cm above 1 year; area of the annulus by Pettersen
    from_flow = 23.76 * 3.14159 / 4.0 * 1.56**2  # at 1 m²
    area = float(body_surface_area(CHILD))
    assert float(stroke_volume(CHILD)) / area == pytest.approx(from_flow, rel=0.17)  # one sd


def test_flow_is_that_of_a_gram_times_the_grams():
    body = at_median_height(11.0, 0.0)
    mass = float(left_ventricular_mass(body))
    assert float(coronary_flow(body)) / ML_PER_MIN == pytest.approx(0.9 * 1.28 * mass, rel=1e-12)


@pytest.mark.parametrize("dominance", SHARES)
def test_both_arteries_carry_the_whole_flow(dominance):
    parts = [float(territory_flow(CHILD, artery, dominance)) for artery in ("left", "right")]
    assert sum(parts) == pytest.approx(float(coronary_flow(CHILD)), rel=1e-13)
    assert right_share("left") < right_share("balanced") < right_share("right") < 0.5


def test_share_of_the_right_artery_follows_its_width():
    # flow goes with the 2.6th power of a coronary diameter (Changizi & Cherniak 2000)
    left, right = 2.924 * 1.2**0.5 - 0.182, 2.752 * 1.2**0.5 - 0.304
    by_width = right**2.6 / (left**2.6 + right**2.6)
    assert right_share("right") == pytest.approx(by_width, abs=0.03)


@pytest.mark.parametrize("number", [
    body_surface_area, resting_period, systolic_pressure, diastolic_pressure, stroke_volume,
    left_ventricular_mass, coronary_flow,
])  # fmt: skip
def test_derivatives_compiled_and_batched(number):
    numbers = jnp.array([[32.0, 139.0, 10.2], [17.0, 104.0, 4.4], [58.0, 163.0, 15.3]])

    def of(x):
        return number(Body(x[0], x[1], x[2], 1.0))

    batch = jax.jit(jax.vmap(of))(numbers)
    for k, x in enumerate(numbers):
        assert float(batch[k]) == pytest.approx(float(of(x)), rel=1e-12)
        slopes, h = jax.grad(of)(x), 1e-4
        for i in range(3):
            up, down = (of(x.at[i].add(step)) for step in (h, -h))
            # h² of the difference, and round-off over h
            expected = float(up - down) / (2.0 * h)
            assert float(slopes[i]) == pytest.approx(expected, rel=1e-5, abs=1e-7 * float(of(x)))
