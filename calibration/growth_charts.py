"""Height and weight of children by age and sex: the growth charts of the CDC.

A chart holds the Box-Cox power L, the median M and the coefficient of variation S at each age; a
value y has the standard score z, and the other way round (Cole & Green 1992)::

    z = ((y/M)^L − 1)/(L S),    y = M (1 + L S z)^(1/L)

Between the whole years of the tables all three are interpolated linearly, which moves a height by
at most 0.4 % and a weight by at most 0.6 % from the monthly charts. Below 2 and beyond 20 years
the charts have no values; the nearest ones are taken. All functions are differentiable and take
arrays.

Source: Kuczmarski et al. 2002, 2000 CDC Growth Charts for the United States, Vital Health Stat 11
(246); the data files statage.csv and wtage.csv of the National Center for Health Statistics, read
off at whole years.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from lumped.parameters import Parameter, real

_AGES = tuple(range(2, 21))
# by sex, girls first; in each the rows L, M, S by age
_HEIGHT = (
    # girls
    (
        (1.072, 0.561, 0.238, -0.048, -0.216, -0.213, -0.086, 0.077, 0.273, 0.719, 1.289,
         1.256, 0.964, 0.895, 0.939, 0.997, 1.046, 1.082, 1.108),
        (84.98, 93.92, 100.75, 107.66, 114.71, 121.49, 127.59, 132.92, 137.99, 143.98, 151.19,
         157.15, 160.39, 161.86, 162.55, 162.91, 163.12, 163.25, 163.34),
        (0.0408, 0.0420, 0.0432, 0.0442, 0.0449, 0.0454, 0.0459, 0.0468, 0.0486, 0.0505,
         0.0488, 0.0440, 0.0411, 0.0401, 0.0398, 0.0397, 0.0397, 0.0397, 0.0396),
    ),
    # boys
    (
        (0.942, -0.347, 0.793, 1.261, 1.150, 0.770, 0.463, 0.413, 0.503, 0.492, 0.419, 0.787,
         1.636, 2.196, 2.126, 1.741, 1.410, 1.234, 1.167),
        (86.45, 94.96, 102.22, 108.90, 115.39, 121.77, 127.88, 133.51, 138.62, 143.52, 149.05,
         156.09, 163.84, 169.94, 173.51, 175.29, 176.16, 176.60, 176.85),
        (0.0403, 0.0406, 0.0413, 0.0425, 0.0436, 0.0444, 0.0451, 0.0462, 0.0476, 0.0489,
         0.0499, 0.0503, 0.0490, 0.0460, 0.0432, 0.0415, 0.0407, 0.0404, 0.0404),
    ),
)  # fmt: skip
_WEIGHT = (
    # girls
    (
        (-0.735, -1.017, -1.171, -1.284, -1.327, -1.270, -1.134, -0.977, -0.851, -0.788,
         -0.805, -0.909, -1.102, -1.365, -1.641, -1.833, -1.854, -1.702, -1.513),
        (12.055, 13.865, 15.793, 17.930, 20.237, 22.757, 25.628, 28.991, 32.891, 37.206,
         41.646, 45.821, 49.360, 52.042, 53.883, 55.137, 56.185, 57.304, 58.219),
        (0.1074, 0.1189, 0.1313, 0.1408, 0.1492, 0.1592, 0.1716, 0.1847, 0.1956, 0.2018,
         0.2024, 0.1977, 0.1890, 0.1784, 0.1685, 0.1619, 0.1603, 0.1630, 0.1666),
    ),
    # boys
    (
        (-0.206, -0.603, -0.908, -0.998, -1.082, -1.230, -1.349, -1.343, -1.214, -1.027,
         -0.844, -0.703, -0.633, -0.662, -0.795, -0.967, -1.065, -1.027, -0.916),
        (12.671, 14.330, 16.231, 18.393, 20.681, 23.065, 25.639, 28.551, 31.936, 35.895,
         40.471, 45.591, 51.005, 56.281, 60.921, 64.570, 67.198, 69.123, 70.598),
        (0.1081, 0.1116, 0.1196, 0.1295, 0.1388, 0.1470, 0.1556, 0.1662, 0.1784, 0.1896,
         0.1964, 0.1968, 0.1911, 0.1821, 0.1728, 0.1659, 0.1620, 0.1602, 0.1615),
    ),
)  # fmt: skip


def height_score(height: Parameter, age_years: Parameter, male: Parameter) -> Float[Array, "..."]:
    """Standard score of a height for age and sex [-].

    Args:
        height: standing [cm].
        age_years: age [years], 2..20.
        male: 1 for a boy, 0 for a girl.
    """
    return _score(real(height), *_chart(_HEIGHT, age_years, male))


def weight_score(
    weight_kg: Parameter, age_years: Parameter, male: Parameter
) -> Float[Array, "..."]:
    """Standard score of a weight for age and sex [-].

    Args:
        weight_kg: weight [kg].
        age_years: age [years], 2..20.
        male: 1 for a boy, 0 for a girl.
    """
    return _score(real(weight_kg), *_chart(_WEIGHT, age_years, male))


def modified_height_score(
    height: Parameter, age_years: Parameter, male: Parameter
) -> Float[Array, "..."]:
    """Distance of a height from the median in half distances of the score 2 [-].

    Scores of weights that skew end below 5 however large the weight; these go on (CDC 2016, SAS
    program for the growth charts). Arguments as in `height_score`.
    """
    return _modified(real(height), *_chart(_HEIGHT, age_years, male))


def modified_weight_score(
    weight_kg: Parameter, age_years: Parameter, male: Parameter
) -> Float[Array, "..."]:
    """The same for a weight [-]; arguments as in `weight_score`."""
    return _modified(real(weight_kg), *_chart(_WEIGHT, age_years, male))


def height_at(age_years: Parameter, male: Parameter, score: Parameter = 0.0) -> Float[Array, "..."]:
    """Height at a standard score [cm]; arguments as in `height_score`."""
    return _value(real(score), *_chart(_HEIGHT, age_years, male))


def weight_at(age_years: Parameter, male: Parameter, score: Parameter = 0.0) -> Float[Array, "..."]:
    """Weight at a standard score [kg]; arguments as in `weight_score`."""
    return _value(real(score), *_chart(_WEIGHT, age_years, male))


def _chart(
    chart: tuple, age_years: Parameter, male: Parameter
) -> tuple[Float[Array, "..."], Float[Array, "..."], Float[Array, "..."]]:
    """L, M and S at an age."""
    girl, boy = (
        [jnp.interp(real(age_years), real(_AGES), real(row)) for row in rows] for rows in chart
    )
    L, M, S = (jnp.where(real(male) > 0.5, b, g) for g, b in zip(girl, boy, strict=True))
    return L, M, S


def _score(y: Array, L: Array, M: Array, S: Array) -> Array:
    # no chart has L = 0 at a whole year; between two of them the limit ln(y/M)/S is met smoothly
    L = jnp.where(jnp.abs(L) < _LEAST_POWER, _LEAST_POWER, L)
    return jnp.expm1(L * jnp.log(y / M)) / (L * S)


def _modified(y: Array, L: Array, M: Array, S: Array) -> Array:
    two = jnp.where(y > M, 2.0, -2.0)
    return two * (y - M) / (_value(two, L, M, S) - M)


def _value(z: Array, L: Array, M: Array, S: Array) -> Array:
    L = jnp.where(jnp.abs(L) < _LEAST_POWER, _LEAST_POWER, L)
    return M * jnp.exp(jnp.log1p(L * S * z) / L)


_LEAST_POWER = 1e-6
"""Box-Cox powers below this count as this one: z changes by less than 1e-5."""
