"""Prestress: the stress with which the imaged wall, undeformed, carries the blood's pressure.

The image shows the vessel under load. S₀ is sought such that the wall is in equilibrium with the
pressure at zero displacement. The first pass deforms the wall without prestress and keeps the
second Piola-Kirchhoff stress of that deformation, the next ones do the same with what the stress
does not carry yet, r = f(0) − ∫ S₀ ∇N_a dV::

    S₀ ← S₀ + F⁻¹ P(F),     ∫ P(F) ∇N_a dV = r

In Hsu & Bazilevs's fixed point the wall has the stress so far in every pass. Of the displacement
K_g/(K + K_g) is left then, K_g being the stiffness from that stress: four fifths where a long pipe
whose wall pulls at its ends bends. Here what is left is squared from pass to pass: with a radius of
2 cm 0.45, 0.081, 0.0088, 1.3e-4, 3e-9 cm.

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
from jaxfsi.core.solid import deformation_gradients, elastic_stress, solid_residual
from jaxfsi.core.statics import RESULTS, Field, Loads, equilibrium, load_forces
from jaxfsi.core.wall_factor import WallFactor
from lumped.parameters import is_traced

_CORRECTED = 1e-3
"""Tolerance of the passes after the first: what they leave the next one takes."""


class Prestress(NamedTuple):
    """Result of the fixed point.

    Attributes:
        model: the model with its prestress.
        d: displacement under the loads that is left [cm].
        residuals: largest displacement of each pass (zero: none was needed) and what is left [cm].
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
        n_passes: passes, the first included.
        tolerance: forces out of balance over loads at which to stop, see `statics.equilibrium`.
        throw: raise where an equilibrium is not found; otherwise the result says so.

    Raises:
        ValueError: the model has no wall.
        RuntimeError: an equilibrium was not found and `throw` is set.
    """
    if model.wall is None:
        raise ValueError("the model has no wall that could carry a prestress; give it one")
    wall, nothing = model.wall, jnp.zeros_like(model.x)
    shape = geometry(model.x, model.solid_tets)
    bare = _with_stress(None, model)
    load = load_forces(loads, nothing, model)

    def stress(d: Field) -> Float[Array, "3 3 points solid_tets"]:
        F = deformation_gradients(d, model.element, shape)
        P = elastic_stress(F, wall.material, model.element, shape, model.n_nodes)
        return jnp.stack([_second(f, p) for f, p in zip(F, P, strict=True)], axis=2)

    def corrected(S, _):
        carried = solid_residual(nothing, nothing, nothing, wall, model.element, shape, S)
        rest = jnp.where(model.in_solid & ~model.held, load - carried, 0.0)

        def correct():
            loads = Loads(force=rest)
            d = equilibrium(bare, loads, factor, tolerance=_CORRECTED, throw=False).d
            return S + stress(d), jnp.max(jnp.abs(d))

        enough = jnp.sum(rest**2) <= tolerance**2 * jnp.sum(load**2)
        return jax.lax.cond(enough, lambda: (S, jnp.zeros(())), correct)

    S, residuals = model.prestress, jnp.zeros(0)
    if S is None:
        d = equilibrium(bare, loads, factor, tolerance=tolerance, throw=False).d
        S, residuals = stress(d), jnp.max(jnp.abs(d))[None]
    S, further = jax.lax.scan(corrected, S, length=n_passes - len(residuals))
    residuals = jnp.append(residuals, further)
    final = _with_stress(S, model)
    last = equilibrium(final, loads, factor, tolerance=tolerance, throw=False)
    if throw and not is_traced(residuals) and last.result != RESULTS.successful:
        raise RuntimeError(f"No prestress was found. {RESULTS[last.result]}")
    residuals = jnp.append(residuals, jnp.max(jnp.abs(last.d)))
    return Prestress(final, last.d, residuals, last.result)


def _with_stress(S: Float[Array, "3 3 points solid_tets"] | None, model: Model) -> Model:
    return eqx.tree_at(lambda m: m.prestress, model, S, is_leaf=lambda leaf: leaf is None)


def _second(F: Tensor, P: Tensor) -> Float[Array, "3 3 tets"]:
    """F⁻¹ P, made symmetric against round-off."""
    J, cofactor = determinant_and_cofactor(F)
    S = product(transposed(cofactor), P)
    return jnp.stack(
        [jnp.stack([(S[i][j] + S[j][i]) / (2.0 * J) for j in range(3)]) for i in range(3)]
    )
