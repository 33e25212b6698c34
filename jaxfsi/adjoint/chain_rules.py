"""From derivatives by model and start to derivatives by what both are made from.

With ∂r/∂model and ∂r/∂start of a number r of a run, the derivative by a parameter p is::

    dr/dp = ∂r/∂model · dmodel/dp + ∂r/∂start · dstart/dp

What p does to ports and start is differentiated forwards; what nodes, moduli and the pressure in
the image do through the prestress is pulled back through its fixed point.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxfsi.core.statics.equilibrium import RESULTS, static_factor
from jaxfsi.core.statics.loads import Loads, pressure_load
from jaxfsi.core.statics.prestress import prestressed
from jaxfsi.core.step.model import Model
from jaxfsi.mesh import OUTER_WALL, Mesh


def along_leaves(
    made: Callable[[Any], Any], numbers: Any, cotangent: Any
) -> list[tuple[tuple[Any, ...], float]]:
    """Derivatives by the logarithm of each leaf of a tree of numbers.

    Args:
        made: what is made of the numbers; of it the inexact arrays count.
        numbers: tree of scalars.
        cotangent: derivative by each array that is made.

    Returns:
        Path of each leaf, and p dr/dp.
    """

    @eqx.filter_jit
    def along(direction: Any) -> Float[Array, ""]:
        def arrays(numbers: Any) -> Any:
            return eqx.filter(made(numbers), eqx.is_inexact_array)

        change = jax.jvp(arrays, (numbers,), (direction,))[1]
        products = jax.tree.map(lambda g, d: jnp.sum(g * d), cotangent, change)
        return sum(jax.tree.leaves(products), jnp.zeros(()))

    leaves, tree = jax.tree.flatten(numbers)
    paths = [path for path, _ in jax.tree_util.tree_flatten_with_path(numbers)[0]]
    found = []
    for i, path in enumerate(paths):
        only = [v if k == i else jnp.zeros_like(v) for k, v in enumerate(leaves)]
        found.append((path, float(along(jax.tree.unflatten(tree, only)))))
    return found


class PrestressDerivative(NamedTuple):
    """Derivative of a number of a run through the prestress.

    Attributes:
        x: by the nodes [1/cm], shape (3, n).
        E: by Young's modulus [cm²/dyn].
        nu: by Poisson's ratio [-].
        P_image: by the pressure in the image [cm²/dyn].
    """

    x: Any
    E: Any
    nu: Any
    P_image: Any


def elastic(model: Any) -> Any:
    """Material of the wall, which has E and nu whatever its law."""
    return model.wall.material


def through_prestress(
    by_model: Model, model: Model, mesh: Mesh, P_image: float
) -> PrestressDerivative:
    """What nodes, E, nu and the pressure in the image do through the prestress.

    Args:
        by_model: derivative by each number of the model.
        model: the model.
        mesh: its mesh.
        P_image: pressure of the blood in the image [dyn/cm²].

    Raises:
        ValueError: nothing holds a part of the wall.
        RuntimeError: the equilibrium of the prestress, or its derivative, was not found.
    """
    if model.prestress is None:
        return PrestressDerivative(jnp.zeros_like(model.x), 0.0, 0.0, 0.0)
    factor = static_factor(model)

    def stress(numbers: tuple[Array, ...]) -> tuple[Any, RESULTS]:
        x, E, nu, P = numbers
        free = eqx.tree_at(
            lambda m: (m.x, elastic(m).E, elastic(m).nu, m.P_ambient, m.prestress),
            model,
            (x, E, nu, P, None),
            is_leaf=lambda leaf: leaf is None,
        )
        pull = pressure_load(mesh, OUTER_WALL, -P, free)
        found = prestressed(free, Loads((pull,)), factor, throw=False)
        assert found.model.prestress is not None
        return found.model.prestress, found.result

    @eqx.filter_jit
    def pulled(numbers, cotangent):
        _, pull_back, result = jax.vjp(stress, numbers, has_aux=True)
        return pull_back(cotangent)[0], result

    law = elastic(model)
    numbers = (model.x, *(jnp.asarray(v, float) for v in (law.E, law.nu, P_image)))
    slopes, result = pulled(numbers, by_model.prestress)
    if result != RESULTS.successful:
        raise RuntimeError(f"The prestress cannot be differentiated. {RESULTS[result]}")
    if not all(bool(jnp.all(jnp.isfinite(slope))) for slope in slopes):
        raise RuntimeError(
            "The derivative through the prestress is not finite: its linear system was not solved,"
            " or the derivative by the prestress is not finite itself. Check mesh and moduli of the"
            " wall, and shorten the steps of the run."
        )
    return PrestressDerivative(*slopes)


def recalibrated(
    stress: dict[str, float], rest: dict[str, float], shared: Callable[[str], bool] = lambda _: True
) -> dict[str, float]:
    """Derivatives under stress with α tuned so that the resting ratio is met anew.

    Args:
        stress: ∂ log ratio / ∂ log p under stress.
        rest: the same at rest.
        shared: which parameters the run at rest has as well.
    """
    gain = stress["alpha"] / rest["alpha"]
    return {
        name: value - (gain * rest.get(name, 0.0) if shared(name) else 0.0)
        for name, value in stress.items()
        if name != "alpha"
    }
