"""Normal diameters of the aortic root by body surface area.

With the body surface area A [m²] the logarithm of a diameter [cm] is a normal number::

    log d = β_0 + β_1 A + β_2 A² + β_3 A³ ± √MSE

for A up to 2 m², beyond which the value at 2 is taken.

Source: Pettersen et al. 2008, J Am Soc Echocardiogr 21:922 (782 children of 0 to 18 years,
ultrasound, inner edges in systole), whose A is that of Haycock et al. 1978.
"""

from typing import Literal

import jax.numpy as jnp
from jaxtyping import Array, Float

from lumped.parameters import Parameter, real

Level = Literal["annulus", "sinus", "junction"]

_TABLE: dict[Level, tuple[tuple[float, float, float, float], float]] = {
    "annulus": ((-0.874, 2.708, -1.841, 0.452), 0.010),
    "sinus": ((-0.500, 2.537, -1.707, 0.420), 0.012),
    "junction": ((-0.759, 2.643, -1.797, 0.442), 0.018),
}
_LARGEST = 2.0


def aortic_root_diameter(level: Level, body_surface_area_m2: Parameter) -> Float[Array, "..."]:
    """Median diameter of the aortic root [cm].

    Args:
        level: annulus, sinus (of Valsalva) or sinotubular junction.
        body_surface_area_m2: body surface area [m²].
    """
    A = jnp.minimum(real(body_surface_area_m2), _LARGEST)
    return jnp.exp(sum(beta * A**j for j, beta in enumerate(_TABLE[level][0])))


def aortic_root_log_sd(level: Level) -> float:
    """Standard deviation of the logarithm of that diameter [-]."""
    return _TABLE[level][1] ** 0.5
