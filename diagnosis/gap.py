"""The gap between a predicted and a measured pressure ratio, in measurement errors.

    z = (predicted − measured) / sd,    p = erfc(|z|/√2)    (two-sided, normal errors).

A small p means that measurement error alone does not explain the gap; it does not tell the cause.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.scipy.special import erfc
from jaxtyping import Array, Float

from lumped.parameters import Parameter, is_traced, nan_unless, numbers_in_range, real

RATIO_SD = 0.02
"""Standard deviation of a predicted less a measured ratio from measurement alone [-].

Two measurements of FFR in one artery minutes apart differ with a standard deviation of 0.018
(190 pairs; Johnson et al. 2015, JACC Cardiovasc Interv 8:1018); rounded up. A difference of two
fits here: the prediction rests on a measured resting ratio and is compared with a second one.
"""


class RatioGap(NamedTuple):
    """Difference of a prediction from a measurement.

    Attributes:
        difference: predicted less measured [-].
        z: the difference in standard deviations [-].
        p_value: probability of a difference at least as large from measurement error alone [-].
    """

    difference: Float[Array, "*batch"]
    z: Float[Array, "*batch"]
    p_value: Float[Array, "*batch"]


def ratio_gap(predicted: Parameter, measured: Parameter, sd: Parameter = RATIO_SD) -> RatioGap:
    """Compare a predicted with a measured pressure ratio.

    All arguments are differentiated; arrays of one shape are compared one by one.

    Args:
        predicted: predicted FFR or resting ratio [-].
        measured: the measured one [-].
        sd: standard deviation of their difference from measurement [-], above zero.

    Raises:
        ValueError: sd is not positive or a ratio not finite; traced ones give NaN.
    """
    if not is_traced(sd) and not np.all(np.isfinite(sd) & (np.asarray(sd) > 0.0)):
        raise ValueError(
            f"The standard deviation sd = {sd} must be positive. Leave it out for {RATIO_SD}."
        )
    finite = {"The predicted ratio": predicted, "The measured ratio": measured}
    usable = numbers_in_range(above={"sd": sd}, finite=finite)
    difference = (real(predicted) - real(measured)) * nan_unless(usable)
    z = difference / real(sd)
    return RatioGap(difference, z, erfc(jnp.abs(z) / jnp.sqrt(2.0)))
