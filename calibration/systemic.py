"""The systemic circulation behind the aorta: a three-element Windkessel from clinic data.

    R_s = (⅔ P_diastolic + ⅓ P_systolic) / CO,   C_s = SV / (P_systolic − P_diastolic),   R_c = 10.

The characteristic impedance of the aorta, for R_c in place of 10::

    Z = ρ c / A,   c² = E h / (2 ρ r (1 − ν²))

Source: Puelz et al. 2024 (arXiv 2405.01703), section 2.2; of Z and c: Nichols & O'Rourke,
McDonald's Blood Flow in Arteries, chapter 3 (Moens-Korteweg, a thin tube that keeps its length).
In the paper R_s is the whole mean pressure over the cardiac output, R_c comes on top of it. With
SV = CO·T the product R_s C_s is T·MAP/(P_systolic − P_diastolic): a flow-driven run forgets its
start only slowly.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lumped import RCR
from lumped.parameters import Parameter, is_traced, nan_unless, numbers_in_range, real

R_CHARACTERISTIC = 10.0
"""Characteristic resistance of the aorta [dyn·s/cm⁵], the same for all patients of the source."""


def systemic_windkessel(
    P_systolic: Parameter,
    P_diastolic: Parameter,
    cardiac_output: Parameter,
    stroke_volume: Parameter,
    *,
    R_characteristic: Parameter = R_CHARACTERISTIC,
) -> RCR:
    """The Windkessel of the aortic outlet at rest.

    All arguments are differentiated. A batch goes through `jax.vmap`.

    Args:
        P_systolic: systolic aortic pressure [dyn/cm²].
        P_diastolic: diastolic aortic pressure [dyn/cm²], below the systolic one.
        cardiac_output: mean flow [cm³/s], above zero; 40..150 in adults.
        stroke_volume: volume ejected in a beat [cm³], above zero.
        R_characteristic: resistance in series [dyn·s/cm⁵].

    Returns:
        The block with R_proximal = R_c, R_distal = R_s, C = C_s; NaN in all three where a traced
        argument lies outside its range.

    Raises:
        ValueError: the pressures are swapped, or output or volume is not positive.
    """
    P_systolic, P_diastolic = real(P_systolic), real(P_diastolic)
    flow, volume = real(cardiac_output), real(stroke_volume)
    above = {
        "P_systolic [dyn/cm²]": P_systolic,
        "P_diastolic [dyn/cm²]": P_diastolic,
        "cardiac_output [cm³/s]": flow,
        "stroke_volume [cm³]": volume,
    }
    least = {"R_characteristic [dyn·s/cm⁵]": R_characteristic}
    usable = numbers_in_range(above=above, least=least) & (P_systolic > P_diastolic)
    if not is_traced(P_systolic, P_diastolic) and np.any(P_systolic <= P_diastolic):
        raise ValueError(
            f"P_systolic = {P_systolic} does not lie above P_diastolic = {P_diastolic} [dyn/cm²]. "
            "Were the two swapped?"
        )
    factor = nan_unless(usable)
    return RCR(
        R_proximal=R_characteristic * factor,
        C=volume / (P_systolic - P_diastolic) * factor,
        R_distal=(2.0 * P_diastolic + P_systolic) / 3.0 / flow * factor,
    )


def characteristic_impedance(
    area: Parameter, rho: Parameter, E: Parameter, nu: Parameter, thickness_per_radius: Parameter
) -> Float[Array, ""]:
    """Characteristic impedance of a thin elastic tube [dyn·s/cm⁵].

    A resistance of this size at the end of a tube sends no wave back. All arguments are
    differentiated.

    Args:
        area: of the lumen [cm²].
        rho: density of the blood [g/cm³].
        E: Young's modulus of the wall [dyn/cm²].
        nu: Poisson's ratio [-], 0..0.5.
        thickness_per_radius: wall thickness over lumen radius [-].

    Returns:
        The impedance; NaN where a traced argument lies outside its range.

    Raises:
        ValueError: an argument is not finite and positive, or nu lies outside its range.
    """
    area, rho, E, nu, share = map(real, (area, rho, E, nu, thickness_per_radius))
    above = {
        "area [cm²]": area,
        "rho [g/cm³]": rho,
        "E [dyn/cm²]": E,
        "thickness_per_radius [-]": share,
    }
    usable = numbers_in_range(above=above) & (nu >= 0.0) & (nu <= 0.5)
    if not is_traced(nu) and not np.all((nu >= 0.0) & (nu <= 0.5)):
        raise ValueError(f"Poisson's ratio nu = {nu} must lie from 0 to 0.5. Try 0.45.")
    safe = [jnp.where(usable, value, 1.0) for value in (area, rho, E, share)]
    area, rho, E, share = safe
    speed = jnp.sqrt(E * share / (2.0 * rho * (1.0 - jnp.where(usable, nu, 0.0) ** 2)))
    return rho * speed / area * nan_unless(usable)
