"""A 0D vessel seen from its two ends: recorded pressures and flows, parameters, equations.

A resistance in series with an inertance L, and a capacitor C between them::

    P_in --- R_viscous + K_stenosis |Q_in| ---+--- L --- P_out
                                              C
                                            ground

    momentum    P_in - P_out - (R + K |Q_in|) Q_in - L dQ_out/dt = 0
    mass        Q_in - Q_out - C d/dt [P_in - (R + K |Q_in|) Q_in] = 0

with d/dt (R Q + K |Q| Q) = (R + 2 K |Q|) dQ/dt. Source: svZeroDSolver, block BloodVessel.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

import lumped  # noqa: F401  (switches JAX to double precision)


class VesselRecord(eqx.Module):
    """Pressures, flows and time derivatives at both ends of every vessel. All differentiable.

    Attributes:
        P_in: pressure at the inlet [dyn/cm²].
        Q_in: flow into the vessel [cm³/s].
        P_out: pressure at the outlet [dyn/cm²].
        Q_out: flow out of the vessel [cm³/s].
        dP_in: rate of `P_in` [dyn/(cm²·s)].
        dQ_in: rate of `Q_in` [cm³/s²].
        dQ_out: rate of `Q_out` [cm³/s²].
    """

    P_in: Float[Array, "vessels samples"] = eqx.field(converter=jnp.asarray)
    Q_in: Float[Array, "vessels samples"] = eqx.field(converter=jnp.asarray)
    P_out: Float[Array, "vessels samples"] = eqx.field(converter=jnp.asarray)
    Q_out: Float[Array, "vessels samples"] = eqx.field(converter=jnp.asarray)
    dP_in: Float[Array, "vessels samples"] = eqx.field(converter=jnp.asarray)
    dQ_in: Float[Array, "vessels samples"] = eqx.field(converter=jnp.asarray)
    dQ_out: Float[Array, "vessels samples"] = eqx.field(converter=jnp.asarray)

    def __check_init__(self):
        shapes = {name: jnp.shape(value) for name, value in vars(self).items()}
        if len(set(shapes.values())) > 1 or len(self.P_in.shape) != 2:
            raise ValueError(
                f"The arrays of a vessel record differ in shape or are not tables: {shapes}. "
                "Give every quantity as (vessels, samples), on the same instants."
            )


class VesselParameters(eqx.Module):
    """Parameters of every vessel. All differentiable.

    Attributes:
        R_viscous: resistance at vanishing flow [dyn·s/cm⁵].
        C: compliance [cm⁵/dyn].
        L: inertance [dyn·s²/cm⁵].
        K_stenosis: quadratic loss, ΔP = K Q·abs(Q) [dyn·s²/cm⁸].
    """

    R_viscous: Float[Array, " vessels"] = eqx.field(converter=jnp.asarray)
    C: Float[Array, " vessels"] = eqx.field(converter=jnp.asarray)
    L: Float[Array, " vessels"] = eqx.field(converter=jnp.asarray)
    K_stenosis: Float[Array, " vessels"] = eqx.field(converter=jnp.asarray)

    def as_table(self) -> Float[Array, "vessels 4"]:
        """The columns R_viscous, C, L, K_stenosis."""
        return jnp.stack([self.R_viscous, self.C, self.L, self.K_stenosis], axis=-1)


def vessel_residuals(
    parameters: VesselParameters, record: VesselRecord
) -> tuple[Float[Array, "vessels samples"], Float[Array, "vessels samples"]]:
    """Residuals of the momentum [dyn/cm²] and mass [cm³/s] equations at every sample."""
    return jax.vmap(residuals_of_one)(parameters.as_table(), record)


def synthetic_record(
    parameters: VesselParameters,
    t: Float[Array, " samples"],
    P_in: Callable[[Float[Array, ""]], Float[Array, ""]],
    Q_in: Callable[[Float[Array, ""]], Float[Array, ""]],
) -> VesselRecord:
    """Record that obeys the vessel equations exactly, from waveforms at the inlet.

    Args:
        parameters: parameters of every vessel.
        t: instants of the samples [s].
        P_in: pressure at the inlet as a function of time [dyn/cm²], twice differentiable.
        Q_in: flow at the inlet as a function of time [cm³/s], twice differentiable.

    Returns:
        Outlet pressure and flow of every vessel, with all derivatives exact.
    """

    def one(theta: Float[Array, "4"]) -> tuple[Float[Array, " samples"], ...]:
        R, C, L, K = theta

        def capacitor_pressure(s: Float[Array, ""]) -> Float[Array, ""]:
            return P_in(s) - (R + K * jnp.abs(Q_in(s))) * Q_in(s)

        def Q_out(s: Float[Array, ""]) -> Float[Array, ""]:
            return Q_in(s) - C * jax.grad(capacitor_pressure)(s)

        dQ_out = jax.vmap(jax.grad(Q_out))(t)
        return (
            jax.vmap(P_in)(t),
            jax.vmap(Q_in)(t),
            jax.vmap(capacitor_pressure)(t) - L * dQ_out,
            jax.vmap(Q_out)(t),
            jax.vmap(jax.grad(P_in))(t),
            jax.vmap(jax.grad(Q_in))(t),
            dQ_out,
        )

    return VesselRecord(*jax.vmap(one)(parameters.as_table()))


# One vessel: its record has no leading axis, theta = (R, C, L, K).


def equation_columns(
    record: VesselRecord,
) -> tuple[Float[Array, "samples 4"], Float[Array, "samples 4"]]:
    """Factors of (1, R, L, K) in the momentum and of (1, C, CR, CK) in the mass residual."""
    Q, magnitude = record.Q_in, jnp.abs(record.Q_in)
    momentum = (record.P_in - record.P_out, -Q, -record.dQ_out, -magnitude * Q)
    mass = (Q - record.Q_out, -record.dP_in, record.dQ_in, 2.0 * magnitude * record.dQ_in)
    return jnp.stack(momentum, axis=1), jnp.stack(mass, axis=1)


def apply_columns(
    momentum: Float[Array, "rows 4"], mass: Float[Array, "rows 4"], theta: Float[Array, "4"]
) -> tuple[Float[Array, " rows"], Float[Array, " rows"]]:
    """Both residuals from factors of `equation_columns`, or from linear combinations of them."""
    R, C, L, K = theta
    one = jnp.ones_like(R)
    return momentum @ jnp.stack([one, R, L, K]), mass @ jnp.stack([one, C, C * R, C * K])


def residuals_of_one(
    theta: Float[Array, "4"], record: VesselRecord
) -> tuple[Float[Array, " samples"], Float[Array, " samples"]]:
    """Residuals of the momentum [dyn/cm²] and mass [cm³/s] equations of one vessel."""
    return apply_columns(*equation_columns(record), theta)
