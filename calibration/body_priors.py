"""What is expected of a patient from the body alone: each number, its spread and its source.

`PRIORS` is the catalogue. A prior is a distribution whose median follows from the numbers of the
body that it names; `body_priors` gives those for which the body is known. A case takes them where
it gives no number of its own, and the uncertainty of FFR draws from them.

| spread | of | why |
|---|---|---|
| 13 % | period | 64 to 100 beats/min in 90 % of 465 resting children of 6 to 8 years |
| 10.5 to 11.6 mmHg | pressures | residuals of the Fourth Report |
| 15 % | stroke volume | Katori 1979: abnormal where 30 % off |
| 19 % | mass of the left ventricle | coefficient of variation of Foster et al. 2008 |
| 35 % | coronary flow | that of the mass, and 29 % between means of PET studies: 0.69 |
| | | (Yates et al. 2000, infants), 0.72, 1.02 and 1.26 mL/min/g (adults) |

The rate of supine children at rest may lie below that of seated ones: in the study of 6 to 8 years
by 12 %, one standard deviation.
"""

from collections.abc import Callable
from typing import Literal, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from calibration.aortic_root import Level, aortic_root_diameter, aortic_root_log_sd
from calibration.body import (
    Body,
    Dominance,
    body_surface_area,
    coronary_flow,
    diastolic_pressure,
    left_ventricular_mass,
    resting_period,
    right_share,
    stroke_volume,
    systolic_pressure,
)
from calibration.spreads import AbstractSpread, LogNormal, Normal
from jaxfsi.anatomy import coronary_diameter, coronary_diameter_sd
from lumped import ML_PER_MIN, MM, MMHG
from lumped.parameters import real

Need = Literal["weight_kg", "height", "age_years", "male"]

PERIOD_LOG_SD = 0.13
STROKE_LOG_SD = 0.15
MASS_LOG_SD = 0.19
FLOW_LOG_SD = 0.35
_SYSTOLIC_SD, _DIASTOLIC_SD = (10.4855, 10.7128), (10.9573, 11.6032)


class Prior(NamedTuple):
    """A number that the body tells.

    Attributes:
        name: its name.
        text: what it is.
        unit: in which it is shown.
        factor: that unit in CGS.
        needs: numbers of the body that it follows from.
        spread: its distribution [CGS].
        source: where median and spread come from.
    """

    name: str
    text: str
    unit: str
    factor: float
    needs: tuple[Need, ...]
    spread: Callable[[Body, Dominance], AbstractSpread]
    source: str


_OSTCHEGA = "Ostchega et al. 2011, Natl Health Stat Report 41; spread: Seppälä et al. 2014"
_FOURTH = "Fourth Report 2004, Pediatrics 114:555, appendix B"
_STROKE = "Jegier et al. 1963; spread: Katori 1979"
_FLOW = (
    "0.9 mL/min/g (PET at rest) and the mass of the heart by height, Foster et al. 2008,"
    " Circulation 117:2769"
)
_SHARE = f"{_FLOW}; share of the artery by dominance, Cerqueira et al. 2002"
_DALLAIRE = "Dallaire & Dahdah 2011, J Am Soc Echocardiogr 24:60"
_PETTERSEN = "Pettersen et al. 2008, J Am Soc Echocardiogr 21:922"


def _sd_of_sex(body: Body, sds: tuple[float, float]) -> Float[Array, "..."]:
    return jnp.where(real(body.male) > 0.5, sds[1], sds[0]) * MMHG


def _flow(artery: Literal["left", "right"]) -> Callable[[Body, Dominance], AbstractSpread]:
    def spread(body: Body, dominance: Dominance) -> AbstractSpread:
        share = right_share(dominance)
        share = share if artery == "right" else 1.0 - share
        return LogNormal(share * coronary_flow(body), FLOW_LOG_SD)

    return spread


def _coronary(side: Literal["left", "right"]) -> Callable[[Body, Dominance], AbstractSpread]:
    def spread(body: Body, _: Dominance) -> AbstractSpread:
        area = body_surface_area(body)
        return Normal(coronary_diameter(side, area), coronary_diameter_sd(side, area))

    return spread


def _root(level: Level) -> Callable[[Body, Dominance], AbstractSpread]:
    def spread(body: Body, _: Dominance) -> AbstractSpread:
        diameter = aortic_root_diameter(level, body_surface_area(body))
        return LogNormal(diameter, aortic_root_log_sd(level))

    return spread


_SIZE: tuple[Need, ...] = ("weight_kg", "height")
_CUFF: tuple[Need, ...] = ("age_years", "height", "male")

PRIORS: tuple[Prior, ...] = (
    Prior(
        "period", "length of a heart beat at rest", "s", 1.0, ("age_years",),
        lambda body, _: LogNormal(resting_period(body), PERIOD_LOG_SD), _OSTCHEGA,
    ),
    Prior(
        "P_systolic", "systolic pressure at rest", "mmHg", MMHG, _CUFF,
        lambda body, _: Normal(systolic_pressure(body), _sd_of_sex(body, _SYSTOLIC_SD)), _FOURTH,
    ),
    Prior(
        "P_diastolic", "diastolic pressure at rest", "mmHg", MMHG, _CUFF,
        lambda body, _: Normal(diastolic_pressure(body), _sd_of_sex(body, _DIASTOLIC_SD)), _FOURTH,
    ),
    Prior(
        "stroke_volume", "stroke volume at rest", "ml", 1.0, _SIZE,
        lambda body, _: LogNormal(stroke_volume(body), STROKE_LOG_SD), _STROKE,
    ),
    Prior(
        "left_ventricular_mass", "mass of the left ventricle", "g", 1.0, ("height",),
        lambda body, _: LogNormal(left_ventricular_mass(body), MASS_LOG_SD),
        "Foster et al. 2008, Circulation 117:2769",
    ),
    Prior(
        "coronary_flow", "flow of both coronary arteries at rest", "ml/min", ML_PER_MIN,
        ("height",), lambda body, _: LogNormal(coronary_flow(body), FLOW_LOG_SD), _FLOW,
    ),
    Prior(
        "left_flow", "flow of the left coronary artery at rest", "ml/min", ML_PER_MIN,
        ("height",), _flow("left"), _SHARE,
    ),
    Prior(
        "right_flow", "flow of the right coronary artery at rest", "ml/min", ML_PER_MIN,
        ("height",), _flow("right"), _SHARE,
    ),
    Prior(
        "left_diameter", "diameter of the left main artery", "mm", MM, _SIZE,
        _coronary("left"), _DALLAIRE,
    ),
    Prior(
        "right_diameter", "diameter of the right coronary artery", "mm", MM, _SIZE,
        _coronary("right"), _DALLAIRE,
    ),
    Prior(
        "annulus_diameter", "diameter of the aortic annulus", "mm", MM, _SIZE,
        _root("annulus"), _PETTERSEN,
    ),
    Prior(
        "sinus_diameter", "diameter of the aortic sinuses", "mm", MM, _SIZE,
        _root("sinus"), _PETTERSEN,
    ),
    Prior(
        "junction_diameter", "diameter of the sinotubular junction", "mm", MM, _SIZE,
        _root("junction"), _PETTERSEN,
    ),
)  # fmt: skip
"""The catalogue."""


def body_priors(body: Body, *, dominance: Dominance = "right") -> dict[str, AbstractSpread]:
    """Distribution of each number that the body tells, by name [CGS].

    Args:
        body: the patient; priors that need an unknown number are left out.
        dominance: which artery feeds the lower wall of the left ventricle.
    """
    return {
        prior.name: prior.spread(body, dominance)
        for prior in PRIORS
        if all(getattr(body, need) is not None for need in prior.needs)
    }
