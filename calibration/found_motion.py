"""Lumen of a loaded wall in one state with its derivative by the stiffness, found step by step.

One compiled function finds an equilibrium and the derivative of the lumen by the logarithms of the
free parameters, all at the factor of that stiffness. The search sets out from a displacement nearby
or raises the load, in steps that double after success and halve after failure. What is not found is
None, after a few seconds, and never a number.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from calibration.free_parameter import FreeParameter, read, write
from calibration.loaded_wall import LoadedWall, WallStiffness

LEAST_STEP = 1.0 / 16.0
"""Part of the load below which a step is not halved again."""


class FoundMotion(NamedTuple):
    """Lumen of a state over that of the image.

    Attributes:
        log: logarithms of the ratios of area and minor axis in each ring.
        slope: their derivatives by the logarithms of the free parameters.
        d: displacement of the wall [cm].
    """

    log: Float[Array, "2 rings"]
    slope: Float[Array, "2 rings n"]
    d: Float[Array, "3 nodes"]


@eqx.filter_jit
def _attempted(
    wall: LoadedWall,
    stiffness: WallStiffness,
    free: tuple[FreeParameter, ...],
    P: Float[Array, " nodes"],
    start: Float[Array, "3 nodes"],
) -> FoundMotion:
    """The state, not a number where it was not found."""

    def logarithms(u):
        motion, d = wall.state(write(stiffness, free, jnp.exp(u)), P, start)
        return jnp.log(jnp.stack(motion)), d

    u = jnp.log(read(stiffness, free))
    log, along, d = jax.linearize(logarithms, u, has_aux=True)
    # One after the other: GMRES of several right-hand sides at once copies all its vectors.
    columns = jax.lax.map(along, jnp.eye(len(free)))
    return FoundMotion(log, jnp.moveaxis(columns, 0, -1), d)


def found_motion(
    wall: LoadedWall,
    stiffness: WallStiffness,
    free: tuple[FreeParameter, ...],
    P: Float[Array, " nodes"],
    *,
    near: Float[Array, "3 nodes"] | None = None,
) -> FoundMotion | None:
    """Lumen of one state and its derivative; None where no equilibrium was found.

    Args:
        wall: the wall.
        stiffness: of it.
        free: by what the lumen is differentiated, on scale "log".
        P: pressure in the lumens less that of the image, at all nodes [dyn/cm²].
        near: displacement from which the whole load is tried, once; None: the load is raised from
            none.
    """
    stiffness = jax.tree.map(lambda v: jnp.asarray(v, float), stiffness)
    wall, P = wall.factored(stiffness), jnp.asarray(P, float)
    if near is not None:
        return _sound(_attempted(wall, stiffness, free, P, near))
    d, done, step = jnp.zeros_like(wall.model.x), 0.0, 1.0
    while step >= LEAST_STEP:
        share = min(done + step, 1.0)
        found = _sound(_attempted(wall, stiffness, free, share * P, d))
        if found is None:
            step /= 2.0
        elif share == 1.0:
            return found
        else:
            d, done, step = found.d, share, 2.0 * step
    return None


def _sound(found: FoundMotion) -> FoundMotion | None:
    return found if all(bool(jnp.all(jnp.isfinite(part))) for part in found) else None
