"""Prestress: the stress with which the imaged wall, undeformed, carries the blood's pressure.

The image shows the vessel under load. S₀ is sought such that the wall is in equilibrium with the
pressure at zero displacement. Fixed point: find the equilibrium from the stress so far, keep the
second Piola-Kirchhoff stress that its deformation has added, take the deformation back, repeat::

    S₀ ← S₀ + F⁻¹ P(F)

Source: Hsu & Bazilevs 2011, Blood vessel tissue prestress modeling for vascular FSI, section 3.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxfsi.core.elements import geometry
from jaxfsi.core.materials import Tensor, determinant_and_cofactor, product, transposed
from jaxfsi.core.model import Model
from jaxfsi.core.solid import deformation_gradients, elastic_stress
from jaxfsi.core.statics import RESULTS, Loads, equilibrium
from jaxfsi.core.wall_factor import WallFactor
from lumped.parameters import is_traced


class Prestress(NamedTuple):
    """Result of the fixed point.

    Attributes:
        model: the model with its prestress.
        d: displacement under the loads that is left [cm].
        residuals: largest displacement after each pass [cm].
        result: see `statics.RESULTS`.
    """

    model: Model
    d: Float[Array, "3 nodes"]
    residuals: Float[Array, " passes"]
    result: RESULTS


def prestressed(
    model: Model,
    loads: Loads,
    factor: WallFactor,
    *,
    n_passes: int = 6,
    tolerance: float = 1e-7,
    throw: bool = True,
) -> Prestress:
    """Give a wall the stress with which it carries loads undeformed.

    Args:
        model: the model; a prestress that it has is where the search starts.
        loads: what acts on the wall in the image.
        factor: see `statics.static_factor`.
        n_passes: passes of the fixed point.
        tolerance: of the equilibria, see `statics.equilibrium`.
        throw: raise where an equilibrium is not found; otherwise the result says so.

    Raises:
        ValueError: the model has no wall.
        RuntimeError: an equilibrium was not found and `throw` is set.
    """
    if model.wall is None:
        raise ValueError("the model has no wall that could carry a prestress; give it one")
    material = model.wall.material
    shape = geometry(model.x, model.solid_tets)
    n_points = len(jax.eval_shape(lambda d: model.element.slopes(d, shape), model.x))
    start = model.prestress
    if start is None:
        start = jnp.zeros((3, 3, n_points, model.solid_tets.shape[1]))

    def once(carry, _):
        S, result = carry
        loaded = eqx.tree_at(lambda m: m.prestress, model, S, is_leaf=lambda leaf: leaf is None)
        end = equilibrium(loaded, loads, factor, tolerance=tolerance, throw=False)
        F = deformation_gradients(end.d, model.element, shape)
        P = elastic_stress(F, material, model.element, shape, model.n_nodes)
        added = jnp.stack([_second(f, p) for f, p in zip(F, P, strict=True)], axis=2)
        failed = RESULTS.where(result == RESULTS.successful, end.result, result)
        return (S + added, failed), (end.d, jnp.max(jnp.abs(end.d)))

    (S, result), (_, residuals) = jax.lax.scan(once, (start, RESULTS.successful), length=n_passes)
    final = eqx.tree_at(lambda m: m.prestress, model, S, is_leaf=lambda leaf: leaf is None)
    last = equilibrium(final, loads, factor, tolerance=tolerance, throw=False)
    result = RESULTS.where(result == RESULTS.successful, last.result, result)
    if throw and not is_traced(residuals) and result != RESULTS.successful:
        raise RuntimeError(f"No prestress was found. {RESULTS[result]}")
    return Prestress(final, last.d, jnp.append(residuals, jnp.max(jnp.abs(last.d))), result)


def _second(F: Tensor, P: Tensor) -> Float[Array, "3 3 tets"]:
    """F⁻¹ P, made symmetric against round-off."""
    J, cofactor = determinant_and_cofactor(F)
    S = product(transposed(cofactor), P)
    return jnp.stack(
        [jnp.stack([(S[i][j] + S[j][i]) / (2.0 * J) for j in range(3)]) for i in range(3)]
    )
