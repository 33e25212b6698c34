"""State of a model between two steps."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxfsi.core.ports.port import PortState
from jaxfsi.core.step.model import Model
from lumped.parameters import Parameter


class Start(NamedTuple):
    """What the last step tells the solver of the next; the solution does not depend on it.

    Attributes:
        u: what the velocity was beyond its linear extrapolation [cm/s].
        p: the same of the pressure [dyn/cm²].
        remainder: share of the residual that its first linear system left because the equations are
            not linear.
    """

    u: Float[Array, "3 nodes"]
    p: Float[Array, " nodes"]
    remainder: Float[Array, ""]


class State(NamedTuple):
    """Fields and ports at one time.

    Attributes:
        t: time [s].
        u: velocity [cm/s].
        a: acceleration [cm/s²].
        d: displacement of the wall [cm].
        p: pressure [dyn/cm²].
        d_mesh: displacement of the fluid's mesh [cm].
        u_before: velocity one step earlier, for extrapolation [cm/s].
        p_before: pressure one step earlier [dyn/cm²].
        d_before: displacement of the wall one step earlier [cm].
        start: what the last step tells about where the next one starts.
        blocks: internal state of each port, such as that of its block; empty where it has none.
        P_port: pressure of each port [dyn/cm²].
        Q_port: flow out of each port [cm³/s].
    """

    t: Float[Array, ""]
    u: Float[Array, "3 nodes"]
    a: Float[Array, "3 nodes"]
    d: Float[Array, "3 nodes"]
    p: Float[Array, " nodes"]
    d_mesh: Float[Array, "3 nodes"]
    u_before: Float[Array, "3 nodes"]
    p_before: Float[Array, " nodes"]
    d_before: Float[Array, "3 nodes"]
    start: Start
    blocks: tuple[Float[Array, " _"], ...]
    P_port: Float[Array, " ports"]
    Q_port: Float[Array, " ports"]

    @property
    def port_states(self) -> tuple[PortState, ...]:
        """Each port between two steps."""
        return tuple(
            PortState(x, self.P_port[i], self.Q_port[i]) for i, x in enumerate(self.blocks)
        )


def initial_state(
    model: Model,
    *,
    t: Parameter = 0.0,
    p: Parameter = 0.0,
    blocks: tuple[Float[Array, " _"] | None, ...] | None = None,
) -> State:
    """At rest, undeformed, under a uniform pressure.

    Args:
        model: the model.
        t: time [s].
        p: pressure of the blood [dyn/cm²].
        blocks: internal state of each port; None: at rest.
    """
    zero = jnp.zeros((3, model.n_nodes))
    pressure = jnp.where(model.in_fluid, jnp.asarray(p, float), 0.0)
    states = []
    for i, port in enumerate(model.ports):
        given = None if blocks is None else blocks[i]
        states.append(port.initial_state() if given is None else jnp.asarray(given, float))
    n_ports = len(model.ports)
    return State(
        t=jnp.asarray(t, float),
        u=zero,
        a=zero,
        d=zero,
        p=pressure,
        d_mesh=zero,
        u_before=zero,
        p_before=pressure,
        d_before=zero,
        start=Start(zero, jnp.zeros(model.n_nodes), jnp.zeros(())),
        blocks=tuple(states),
        P_port=jnp.full(n_ports, jnp.asarray(p, float)),
        Q_port=jnp.zeros(n_ports),
    )
