"""Prestress: the stress with which the imaged wall, undeformed, carries the blood's pressure.

The image shows the vessel under load. S₀ is sought such that the wall is in equilibrium with the
loads f at zero displacement, ∫ S₀ : ∇v dV = f(v). The fixed point of Hsu & Bazilevs raises the load
in small steps, adds the stress of each step's displacement to S₀ and takes the displacement back.
Stresses of small displacements are those of Hooke's law, so that, whatever the steps::

    S₀ = C : ε(e),     ∫ ε(v) : C : ε(e) dV = f(v)

which is one linear system; S₀ then carries f alone. In one large step instead, the axial stress of
a pipe that is held at its ends comes out 29 % higher than in small ones
(`verification.prestressed_pipe`), and as the stress so far takes part in carrying each correction,
four fifths of the displacement of its slowest mode are left from pass to pass.

Source: Hsu & Bazilevs 2011, Blood vessel tissue prestress modeling for vascular FSI, section 3.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxfsi.core.elements.bending import BendingPrestress
from jaxfsi.core.laws.materials import LinearElastic
from jaxfsi.core.laws.wall_balance import second_stress, wall_geometry
from jaxfsi.core.solve.wall_factor import WallFactor
from jaxfsi.core.statics.equilibrium import RESULTS, small_equilibrium
from jaxfsi.core.statics.loads import Field, Loads, load_forces
from jaxfsi.core.step.model import Model
from lumped.device import quick_jit

_load_forces = quick_jit(load_forces)


class Prestress(NamedTuple):
    """A wall under stress.

    Attributes:
        model: the model with its prestress.
        e: displacement whose Hookean stress the prestress is [cm].
        result: see `statics.RESULTS`.
    """

    model: Model
    e: Float[Array, "3 nodes"]
    result: RESULTS


@quick_jit
def _stress(d: Field, model: Model) -> Float[Array, "3 3 points tets"] | BendingPrestress:
    assert model.wall is not None
    shape = wall_geometry(model.x, model.element)
    return second_stress(d, model.wall.material, model.element, shape)


def prestressed(
    model: Model,
    loads: Loads,
    factor: WallFactor,
    *,
    tolerance: float = 1e-7,
    throw: bool = True,
) -> Prestress:
    """Give a wall the stress with which it carries loads undeformed.

    Args:
        model: the model; a prestress that it has is replaced. The tissue outside, undeformed too,
            carries nothing.
        loads: what acts on the wall in the image.
        factor: see `statics.static_factor`.
        tolerance: forces out of balance over loads.
        throw: raise where the equilibrium is not found; otherwise the result says so.

    Raises:
        ValueError: the model has no wall.
        RuntimeError: the equilibrium was not found and `throw` is set.
    """
    if model.wall is None:
        raise ValueError("the model has no wall that could carry a prestress; give it one")
    hooke = LinearElastic.of_moduli(*model.wall.material.moduli)
    small = eqx.tree_at(
        lambda m: (m.wall.material, m.wall.support_stiffness, m.prestress),
        model,
        (hooke, 0.0, None),
        is_leaf=lambda leaf: leaf is None,
    )
    force = _load_forces(loads, jnp.zeros_like(model.x), model)
    found = small_equilibrium(small, force, factor, tolerance=tolerance, throw=throw)
    S = _stress(found.d, small)
    carried = eqx.tree_at(lambda m: m.prestress, model, S, is_leaf=lambda leaf: leaf is None)
    return Prestress(carried, found.d, found.result)
