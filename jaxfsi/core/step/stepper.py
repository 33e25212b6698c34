"""What is prepared once for steps of one length: factors and the accuracy asked for."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxfsi.core.laws.mesh_motion import MeshMotion, mesh_motion
from jaxfsi.core.solve.preconditioner import Preconditioner, preconditioner
from jaxfsi.core.step.generalized_alpha import GeneralizedAlpha, generalized_alpha
from jaxfsi.core.step.model import Model
from jaxfsi.nominal import MAX_ITERATIONS, MAX_SYSTEMS


class Stepper(eqx.Module):
    """Everything prepared for steps of one length with one model.

    Attributes:
        dt: length of a step [s].
        motion: of the blood's mesh; None where the wall is rigid.
        preconditioner: of the linear systems.
        method: coefficients in time (static).
        tolerance: by how much the residual of the extrapolated state is reduced (static).
        max_iterations: iterations of GMRES at most (static).
        max_systems: linear systems a step at most (static).
    """

    dt: Float[Array, ""]
    motion: MeshMotion | None
    preconditioner: Preconditioner
    method: GeneralizedAlpha = eqx.field(static=True)
    tolerance: float = eqx.field(static=True)
    max_iterations: int = eqx.field(static=True)
    max_systems: int = eqx.field(static=True)


def prepare(
    dt: float,
    model: Model,
    *,
    rho_infinity: float = 0.5,
    tolerance: float = 1e-3,
    max_iterations: int = MAX_ITERATIONS,
    max_systems: int = MAX_SYSTEMS,
) -> Stepper:
    """Make the factors for steps of length dt [s]; the model's numbers must be concrete.

    Where a function of the numbers of a model is differentiated, batched or compiled, the stepper
    is made outside it, with a nearby model: the factors steer the iterations alone, and what they
    converge to is that of the model given to `march`.

    Args:
        dt: length of a step [s].
        model: the model.
        rho_infinity: damping of the highest frequency, see `generalized_alpha`.
        tolerance: by how much the residual of the extrapolated state is reduced; ten times
            that may be left by coefficients of an earlier iterate (`newton.SLACK`).
        max_iterations: iterations of GMRES at most.
        max_systems: linear systems a step at most.

    Raises:
        ValueError: dt or an option is out of range, or numbers of the model are traced.
    """
    if not dt > 0.0:
        raise ValueError(f"dt = {dt} s is not positive; a cardiac cycle takes about 1000 steps")
    if not 0.0 < tolerance < 1.0:
        raise ValueError(f"tolerance = {tolerance} is not between 0 and 1; 1e-3 is usual")
    method = generalized_alpha(rho_infinity)
    try:
        motion = mesh_motion(model) if model.moves_mesh else None
        factors = preconditioner(dt, model, method)
    except (jax.errors.TracerArrayConversionError, jax.errors.ConcretizationTypeError) as error:
        raise ValueError(
            "the model holds numbers that JAX traces, and the factors need concrete ones. Call"
            " prepare outside the function that grad, vmap or jit takes, with a model of nearby"
            " numbers."
        ) from error
    return Stepper(
        jnp.asarray(dt, float),
        motion,
        factors,
        method,
        tolerance,
        max_iterations,
        max_systems,
    )
