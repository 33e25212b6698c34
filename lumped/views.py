"""The four views of a boundary block, all derived from its one definition.

| view | function | used by |
|---|---|---|
| vector field | `block_field` | diffrax |
| implicit step P = Z Q + b | `implicit_step`, `advance` | the 3D core |
| transfer impedance Z(iω) | `transfer_impedance` | harmonics, wave analysis |
| direct-current network | `direct_current` | cycle means |

They agree for every linear block; a generic test drives all blocks through all of them.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from lumped.elements import AbstractElement
from lumped.march import step
from lumped.network import Network, connect, jacobian
from lumped.parameters import Parameter, in_range, nan_unless
from lumped.sources import FlowSource
from lumped.statespace import field
from lumped.waveforms import AbstractWaveform, Constant, Ramp


def driven(block: AbstractElement, flow: AbstractWaveform) -> Network:
    """The one-node network in which a flow source drives a block."""
    return connect({"source": (FlowSource(flow), "port"), "block": (block, "port")})


def block_field(
    block: AbstractElement, flow: AbstractWaveform
) -> Callable[[Any, Float[Array, " n"], Any], Float[Array, " n"]]:
    """Vector field ẋ = f(t, x, args) of a block driven by a flow, for diffrax."""
    return field(driven(block, flow))


class BlockStep(NamedTuple):
    """State and port pressure of a block after a step.

    Attributes:
        x: states at the end of the step.
        P: port pressure at the end of the step [dyn/cm²].
    """

    x: Float[Array, " n"]
    P: Float[Array, ""]


def advance(
    t: Parameter,
    dt: Parameter,
    x: Float[Array, " n"],
    block: AbstractElement,
    Q_old: Parameter,
    Q_new: Parameter,
    *,
    order: int = 2,
) -> BlockStep:
    """Advance a block over one step with given flows at its ends.

    Args:
        t: time at the start of the step [s].
        dt: length of the step [s].
        x: states at t, shape (n,).
        block: the block.
        Q_old: flow into the block at t [cm³/s].
        Q_new: flow into the block at t + dt [cm³/s].
        order: 1 is backward Euler; 2 takes the flow linear in time and solves the block with two
            Radau stages, so that the error is that of the flow's interpolation.
    """
    if order not in (1, 2):
        raise ValueError(f"The implicit step has order 1 or 2, not {order}.")
    ramp = Ramp(start=Q_old, slope=(Q_new - Q_old) / dt, t_start=t)
    network = driven(block, ramp)
    n = network.n_states
    guess = jnp.zeros(network.n_unknowns).at[:n].set(x)
    z = step(t, dt, network, guess, order=2 * order - 1).z
    return BlockStep(z[:n], z[network.pressure_index("port")])


def implicit_step(
    t: Parameter,
    dt: Parameter,
    x: Float[Array, " n"],
    block: AbstractElement,
    Q_old: Parameter,
    Q_guess: Parameter,
    *,
    order: int = 2,
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The port as a 3D solver sees it over one step: P(t + dt) = Z Q(t + dt) + b.

    Exact for linear blocks; for others the linearisation at `Q_guess`. With backward Euler the
    five-element block has Z = R_1 + 1/(C_a/dt + 1/(R_2 + 1/(C_im/dt + 1/R_3))).

    Args:
        t: time at the start of the step [s].
        dt: length of the step [s].
        x: states at t, shape (n,).
        block: the block.
        Q_old: flow into the block at t [cm³/s].
        Q_guess: flow at which to linearise [cm³/s]; of no consequence for linear blocks.
        order: 1 or 2, see `advance`.

    Returns:
        Z [dyn·s/cm⁵] and b [dyn/cm²].
    """

    def pressure(Q_new):
        return advance(t, dt, x, block, Q_old, Q_new, order=order).P

    Q = jnp.asarray(Q_guess, float)
    P, Z = jax.jvp(pressure, (Q,), (jnp.ones(()),))
    return Z, P - Z * Q


def transfer_impedance(block: AbstractElement, omega: Float[Array, " k"]) -> Complex[Array, " k"]:
    """Z(iω) = P̂/Q̂ of a linear block at angular frequencies ω [rad/s], in dyn·s/cm⁵.

    NaN where a traced parameter of the block lies outside its range.

    Raises:
        ValueError: the block is nonlinear.
    """
    _require_linear(block, "transfer impedance")
    network = driven(block, Constant(0.0))
    n, m = network.n_states, network.n_unknowns
    H = jacobian(network, 0.0, jnp.zeros(m))
    M = jnp.zeros((m, m)).at[:n, :n].set(jnp.diag(network.mass()))
    # a unit flow enters the closure of the source: Q + 1 = 0, the first row after the states
    unit = jnp.zeros(m, dtype=complex).at[n].set(1.0)
    pencil = jax.lax.complex(
        jnp.broadcast_to(-H, (omega.shape[0], m, m)), omega[:, None, None] * M[None]
    )
    z = jnp.linalg.solve(pencil, jnp.broadcast_to(unit, (omega.shape[0], m))[..., None])[..., 0]
    return z[:, network.pressure_index("port")] * nan_unless(in_range(block))


def direct_current(
    t: Parameter, block: AbstractElement
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The block at steady state, sources frozen at time t: P = R Q + P₀.

    Returns:
        R [dyn·s/cm⁵] and P₀ [dyn/cm²]; NaN where a traced parameter lies outside its range.

    Raises:
        ValueError: the block is nonlinear.
    """
    _require_linear(block, "resistance")

    def pressure(Q):
        network = driven(block, Constant(Q))
        zero = jnp.zeros(network.n_unknowns)
        z = jnp.linalg.solve(jacobian(network, t, zero), -network.residual(t, zero))
        return z[network.pressure_index("port")]

    P_0, R = jax.jvp(pressure, (jnp.zeros(()),), (jnp.ones(()),))
    factor = nan_unless(in_range(block))
    return R * factor, P_0 * factor


def _require_linear(block: AbstractElement, view: str) -> None:
    if not block.is_linear:
        raise ValueError(
            f"{type(block).__name__} is nonlinear and has no {view}. "
            "Linearise it with `implicit_step`."
        )
