"""The body of a patient, and what is usual of its circulation at rest.

Body surface area (Haycock et al. 1978, J Pediatr 93:62; measured in newborns to adults)::

    BSA = 0.024265 · height^0.3964 · weight^0.5378      [m², cm, kg]

**Heart rate** [1/min] falls with age (resting pulse of 35 302 healthy persons, Ostchega et al.
2011, Natl Health Stat Report 41)::

    HR = 72 + 54.2 exp(−age/6.13)

through its means of 96 at 5 years, 78 in early adolescence (13.5) and 72 in adults.

**Pressures** [mmHg] are the expected cuff pressures of the Fourth Report (National High Blood
Pressure Education Program 2004, Pediatrics 114:555, appendix B), with a = age − 10 years, at most
that of 17, and the standard score z of height for age (`calibration.growth_charts`)::

    P = α + Σ β_j a^j + Σ γ_j z^j,   j = 1..4

**Stroke volume** is 42.5 mL/m² of body surface (Jegier et al. 1963, dye dilution in 77 persons of
0.2 to 2 m²), **cardiac output** that over the period.

**Coronary flow.** The mass of the left ventricle follows height (Foster et al. 2008, Circulation
117:2769); the free wall of the right one has 0.28 of it. Both take 0.9 mL/min/g at rest::

    Q_coronary = 0.9 · 1.28 · m_LV

The right artery carries the flow of the free wall of the right ventricle and, where it is dominant,
of 5 of 17 segments of the left one; in a balanced circulation half of that, else none.

Everything is differentiable and takes arrays; ages beyond 18 are those of young adults.
"""

from typing import Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from calibration.growth_charts import height_score
from lumped import ML_PER_MIN, MMHG
from lumped.parameters import Parameter, optional_parameter, real

Dominance = Literal["right", "left", "balanced"]

_ADULT_RATE, _YOUNG_RATE, _RATE_AGE = 72.0, 54.2, 6.13

# intercept, β_1..β_4, γ_1..γ_4; girls first
_SYSTOLIC = (
    (102.01027, (1.94397, 0.00598, -0.00789, -0.00059), (2.03526, 0.02534, -0.01884, 0.00121)),
    (102.19768, (1.82416, 0.12776, 0.00249, -0.00135), (2.73157, -0.19618, -0.04659, 0.00947)),
)
_DIASTOLIC = (
    (60.50510, (1.01301, 0.01157, 0.00424, -0.00137), (1.16641, 0.12795, -0.03869, -0.00079)),
    (61.01217, (0.68314, -0.09835, 0.01711, 0.00045), (1.46993, -0.07849, -0.03144, 0.00967)),
)
_PRESSURE_AGES = (1.0, 17.0)
_HEIGHT_SCORES = 3.0  # the polynomials are of no use beyond

STROKE_INDEX = 42.5
"""Stroke volume over body surface area [mL/m²]."""

_HEIGHTS = tuple(range(80, 191, 10))
_LV_MASSES = (32.2, 39.7, 47.2, 54.8, 63.3, 73.7, 86.8, 103.1, 122.4, 144.8, 168.6, 193.0)

MYOCARDIAL_FLOW = 0.9
"""Resting flow of the myocardium [mL/min/g]."""

RIGHT_VENTRICLE = 0.28
"""Mass of the right ventricle's free wall over that of the left ventricle [-]."""

_SEGMENTS = {"right": 5.0 / 17.0, "balanced": 2.5 / 17.0, "left": 0.0}


class Body(eqx.Module):
    """The body of a patient; a number that is not known is None.

    Attributes:
        weight_kg: weight [kg].
        height: standing [cm].
        age_years: age [years].
        male: 1 for a boy or man, 0 for a girl or woman.
    """

    weight_kg: Parameter | None = optional_parameter()
    height: Parameter | None = optional_parameter()
    age_years: Parameter | None = optional_parameter()
    male: Parameter | None = optional_parameter()


def _known(body: Body, *names: str) -> list[Parameter]:
    """Numbers of a body.

    Raises:
        ValueError: it lacks one of them.
    """
    numbers = {name: getattr(body, name) for name in names}
    missing = [name for name, number in numbers.items() if number is None]
    if missing:
        raise ValueError(f"The body has no {' and no '.join(missing)}. Give {missing[0]}.")
    return list(numbers.values())


def body_surface_area(body: Body) -> Float[Array, "..."]:
    """Body surface area by Haycock et al. 1978 [m²]; of weight and height.

    Raises:
        ValueError: the body lacks one of them.
    """
    weight, height = _known(body, "weight_kg", "height")
    return jnp.asarray(0.024265 * height**0.3964 * weight**0.5378)


def resting_period(body: Body) -> Float[Array, "..."]:
    """Length of a heart beat at rest [s]; of age."""
    (age,) = _known(body, "age_years")
    return 60.0 / (_ADULT_RATE + _YOUNG_RATE * jnp.exp(-age / _RATE_AGE))


def systolic_pressure(body: Body) -> Float[Array, "..."]:
    """Expected systolic pressure [dyn/cm²]; of age, height and sex.

    That of the left ventricle is the same, since nothing obstructs its outflow.
    """
    return _pressure(body, _SYSTOLIC)


def diastolic_pressure(body: Body) -> Float[Array, "..."]:
    """Expected diastolic pressure [dyn/cm²]; of age, height and sex."""
    return _pressure(body, _DIASTOLIC)


def stroke_volume(body: Body) -> Float[Array, "..."]:
    """Stroke volume at rest [cm³]; of weight and height."""
    return STROKE_INDEX * body_surface_area(body)


def left_ventricular_mass(body: Body) -> Float[Array, "..."]:
    """Mass of the left ventricle, the median of its height [g]."""
    (height,) = _known(body, "height")
    return jnp.interp(height, real(_HEIGHTS), real(_LV_MASSES))


def coronary_flow(body: Body) -> Float[Array, "..."]:
    """Flow of both coronary arteries at rest [cm³/s]; of height."""
    mass = (1.0 + RIGHT_VENTRICLE) * left_ventricular_mass(body)
    return MYOCARDIAL_FLOW * mass * ML_PER_MIN


def right_share(dominance: Dominance) -> float:
    """Share of the right coronary artery in the flow of both [-].

    Args:
        dominance: which artery feeds the lower wall of the left ventricle.
    """
    return (_SEGMENTS[dominance] + RIGHT_VENTRICLE) / (1.0 + RIGHT_VENTRICLE)


def territory_flow(
    body: Body, artery: Literal["left", "right"], dominance: Dominance
) -> Float[Array, "..."]:
    """Flow of one coronary artery at rest [cm³/s]; of height.

    Args:
        body: the patient.
        artery: left or right.
        dominance: see `right_share`.
    """
    share = right_share(dominance)
    return coronary_flow(body) * (share if artery == "right" else 1.0 - share)


def _pressure(body: Body, table: tuple) -> Float[Array, "..."]:
    age, height, male = _known(body, "age_years", "height", "male")
    a = jnp.clip(age, *_PRESSURE_AGES) - 10.0
    z = height_score(height, age, male)
    z = jnp.clip(z, -_HEIGHT_SCORES, _HEIGHT_SCORES)
    girl, boy = (
        alpha
        + sum(beta * a**j for j, beta in enumerate(ages, 1))
        + sum(gamma * z**j for j, gamma in enumerate(scores, 1))
        for alpha, ages, scores in table
    )
    return jnp.where(male > 0.5, boy, girl) * MMHG
