"""What a finer mesh would give, from two or three meshes.

A number f of a run on a mesh with n elements across the lumen has the error C n⁻ᵖ. With the number
f₂ of a second mesh, coarser or finer, r = n/n₂ and the order p::

    f_∞ = f + (f − f₂)/(rᵖ − 1)

and with three meshes p follows from them. Two meshes do not tell p: what other orders give is the
band in which f_∞ lies. The grid convergence index is GCI = F |f − f_∞|/f, with F = 1.25 where p was
observed.

Source: Celik et al. 2008 (J Fluids Eng 130:078001), eqs. 3 to 7, as ASME V&V 20 has it; the band of
orders is ours.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import root_scalar

from lumped.parameters import Parameter

SAFETY = 1.25
"""F, where the order was observed on three meshes."""

LEAST_RATIO = 1.2
"""Least ratio of elements across of two meshes; below it their difference is scatter."""

_ORDERS = (0.05, 12.0)


class MeshBand(NamedTuple):
    """A number on a mesh, and where its value without mesh error lies.

    Attributes:
        value: on the mesh.
        expected: without mesh error, with the usual order.
        low: least over the orders.
        high: largest over the orders.
    """

    value: Float[Array, ""]
    expected: Float[Array, ""]
    low: Float[Array, ""]
    high: Float[Array, ""]


class ThreeMeshes(NamedTuple):
    """What three meshes say.

    Attributes:
        order: p; NaN where the numbers do not converge monotonically.
        expected: f_∞; NaN likewise.
        gci: grid convergence index of the finest mesh [-]; NaN likewise.
    """

    order: float
    expected: float
    gci: float


def extrapolated(
    value: Parameter, second: Parameter, ratio: Parameter, order: Parameter
) -> Float[Array, ""]:
    """The number without mesh error.

    Differentiable in all arguments.

    Args:
        value: the number on a mesh.
        second: on the second one.
        ratio: elements across the lumen of the mesh over those of the second one, not 1.
        order: p.
    """
    value = jnp.asarray(value, float)
    return value + (value - second) / (jnp.asarray(ratio, float) ** order - 1.0)


def mesh_band(
    value: Parameter, second: Parameter, ratio: float, orders: tuple[float, float, float]
) -> MeshBand:
    """Where the number without mesh error lies.

    Args:
        value: the number on a mesh.
        second: on the second one.
        ratio: see `extrapolated`.
        orders: least, usual and largest order.

    Raises:
        ValueError: the meshes are too much alike.
    """
    check_ratio(ratio)
    low, usual, high = (extrapolated(value, second, ratio, p) for p in orders)
    return MeshBand(
        jnp.asarray(value, float), usual, jnp.minimum(low, high), jnp.maximum(low, high)
    )


def check_ratio(ratio: float) -> None:
    """Refuse two meshes that are too much alike.

    Raises:
        ValueError: says how far they must be apart.
    """
    if not max(ratio, 1.0 / ratio) >= LEAST_RATIO:
        raise ValueError(
            f"a mesh has {ratio:.2f} times the elements across the lumen of the second one, allowed"
            f" from {LEAST_RATIO:g}, or up to its inverse: choose meshes that are further apart"
        )


def three_meshes(
    values: tuple[float, float, float], across: tuple[float, float, float]
) -> ThreeMeshes:
    """Observed order, extrapolated value and index.

    Args:
        values: the number on three meshes, the coarsest first.
        across: their elements across the lumen, ascending.

    Raises:
        ValueError: two meshes are too much alike.
    """
    coarse, middle, fine = (float(value) for value in values)
    r_coarse, r_fine = across[1] / across[0], across[2] / across[1]
    for ratio in (r_coarse, r_fine):
        check_ratio(ratio)
    first, second = coarse - middle, middle - fine

    def missed(p: float) -> float:
        # both differences are those of C n⁻ᵖ
        return first * (1.0 - r_fine**-p) - second * (r_coarse**p - 1.0)

    if not (first * second > 0.0 and missed(_ORDERS[0]) * missed(_ORDERS[1]) < 0.0):
        return ThreeMeshes(np.nan, np.nan, np.nan)
    order = float(root_scalar(missed, bracket=_ORDERS).root)
    expected = float(extrapolated(fine, middle, r_fine, order))
    return ThreeMeshes(order, expected, SAFETY * abs(expected / fine - 1.0))
