"""A 0D network: elements joined at nodes, as one differential-algebraic system.

Unknowns z = (states x of all elements, pressure of every node, flow of every port). Equations:

    M ẋ = f(t, z)                    rows of the states
    0   = g(t, z)                    one row a port: closures of the elements
    0   = Σ Q over the ports of a node    one row a node: conservation of volume

The assembly is independent of the kinds of the elements.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from lumped.elements import AbstractElement
from lumped.parameters import Parameter
from lumped.waveforms import AbstractWaveform, Constant


class Network(eqx.Module):
    """Elements joined at nodes; make one with `connect`.

    Attributes:
        elements: the elements, in order; their parameters are the network's array leaves.
        names: name of each element (static).
        ports: node names of each element's ports, in port order (static).
    """

    elements: tuple[AbstractElement, ...]
    names: tuple[str, ...] = eqx.field(static=True)
    ports: tuple[tuple[str, ...], ...] = eqx.field(static=True)

    @property
    def nodes(self) -> tuple[str, ...]:
        """Node names in order of first appearance."""
        return tuple(dict.fromkeys(node for nodes in self.ports for node in nodes))

    @property
    def n_states(self) -> int:
        """Number of differential unknowns."""
        return sum(len(element.state_names) for element in self.elements)

    @property
    def n_unknowns(self) -> int:
        """Number of all unknowns: states, node pressures, port flows."""
        return self.n_states + len(self.nodes) + sum(len(nodes) for nodes in self.ports)

    @property
    def is_linear(self) -> bool:
        """Whether every element is linear with constant coefficients."""
        return all(element.is_linear for element in self.elements)

    def __getitem__(self, name: str) -> Any:
        """The element of that name."""
        return self.elements[self._position(name)]

    def mass(self) -> Float[Array, " n"]:
        """Diagonal of M: capacitances and inertances of all states."""
        return jnp.concatenate([element.mass() for element in self.elements])

    def residual(self, t: Parameter, z: Float[Array, " m"]) -> Float[Array, " m"]:
        """Right-hand sides of all equations: rates, closures, conservation at the nodes.

        Args:
            t: time [s].
            z: all unknowns, shape (n_unknowns,).
        """
        nodes, n_x = self.nodes, self.n_states
        at = {node: n_x + k for k, node in enumerate(nodes)}
        rates, closures = [], []
        balance: dict[str, Any] = dict.fromkeys(nodes, 0.0)
        i_x, i_q = 0, n_x + len(nodes)
        for element, ports in zip(self.elements, self.ports, strict=True):
            x = z[i_x : i_x + len(element.state_names)]
            P = jnp.stack([z[at[node]] for node in ports])
            Q = z[i_q : i_q + len(ports)]
            rates.append(element.rate(t, x, P, Q))
            closures.append(element.closure(t, x, P, Q))
            for k, node in enumerate(ports):
                balance[node] = balance[node] + Q[k]
            i_x, i_q = i_x + len(element.state_names), i_q + len(ports)
        return jnp.concatenate([*rates, *closures, jnp.stack([balance[node] for node in nodes])])

    def waveforms(self) -> list[AbstractWaveform]:
        """All functions of time inside the elements, in order."""
        return [leaf for leaf in jax.tree.leaves(self, is_leaf=_is_waveform) if _is_waveform(leaf)]

    def with_sources(self, values: Sequence[Parameter]) -> "Network":
        """The network with its waveforms replaced by constants, in the order of `waveforms`."""
        remaining = iter(values)

        def replace(leaf: Any) -> Any:
            return Constant(next(remaining)) if _is_waveform(leaf) else leaf

        return jax.tree.map(replace, self, is_leaf=_is_waveform)

    def external_pressure(self, t: Parameter) -> Float[Array, " n"]:
        """Pressure outside the wall of each state [dyn/cm²]."""
        return jnp.concatenate([element.external_pressure(t) for element in self.elements])

    def breakpoints(self, period: Parameter) -> Float[Array, " k"]:
        """Breakpoints of all waveforms, folded into [0, period] and sorted, with both ends [s]."""
        marks = [jnp.mod(waveform.breakpoints(), period) for waveform in self.waveforms()]
        ends = [jnp.zeros(1), jnp.reshape(jnp.asarray(period, float), (1,))]
        return jnp.sort(jnp.concatenate([*ends, *marks]))

    def state_index(self, name: str, state: str) -> int:
        """Position of an element's state in z."""
        k = self._position(name)
        before = sum(len(element.state_names) for element in self.elements[:k])
        return before + self.elements[k].state_names.index(state)

    def pressure_index(self, node: str) -> int:
        """Position of a node's pressure in z."""
        if node not in self.nodes:
            raise KeyError(f"No node '{node}'. The network has {', '.join(self.nodes)}.")
        return self.n_states + self.nodes.index(node)

    def flow_index(self, name: str, port: int = 0) -> int:
        """Position of the flow into an element's port in z."""
        k = self._position(name)
        return self.n_states + len(self.nodes) + sum(len(p) for p in self.ports[:k]) + port

    def _position(self, name: str) -> int:
        if name not in self.names:
            raise KeyError(f"No element '{name}'. The network has {', '.join(self.names)}.")
        return self.names.index(name)


def _is_waveform(leaf: Any) -> bool:
    return isinstance(leaf, AbstractWaveform)


def connect(elements: Mapping[str, tuple[Any, ...]]) -> Network:
    """Join elements at nodes.

    Args:
        elements: for each name the element and the node of each of its ports, for example
            ``{"inlet": (PressureSource(P), "aorta"), "ostium": (vessel, "aorta", "distal")}``.

    Returns:
        The network.

    Raises:
        ValueError: an element has another number of ports than nodes were given, or a node has
            a single port, so that no flow can pass through it.
    """
    if not elements:
        raise ValueError("A network needs elements. Give at least a source and a block.")
    seen: dict[str, list[str]] = {}
    for name, entry in elements.items():
        if not (isinstance(entry, tuple) and isinstance(entry[0], AbstractElement)):
            raise ValueError(
                f"Entry '{name}' is {entry!r}. Give a tuple: the element, then its nodes."
            )
        element, *nodes = entry
        if len(nodes) != element.n_ports:
            raise ValueError(
                f"Element '{name}' ({type(element).__name__}) has {element.n_ports} port(s) but "
                f"{len(nodes)} node(s) were given. Name one node for each port."
            )
        for node in nodes:
            seen.setdefault(node, []).append(name)
    loose = {node: users[0] for node, users in seen.items() if len(users) == 1}
    if loose:
        text = ", ".join(f"'{node}' (of '{name}')" for node, name in loose.items())
        raise ValueError(
            f"Only one port meets at node {text}. Connect a second element there: a block, a "
            "vessel or a source."
        )
    return Network(
        elements=tuple(entry[0] for entry in elements.values()),
        names=tuple(elements),
        ports=tuple(tuple(entry[1:]) for entry in elements.values()),
    )


@jax.jit
def jacobian(network: Network, t: Parameter, z: Float[Array, " m"]) -> Float[Array, "m m"]:
    """∂residual/∂z at (t, z)."""
    return jax.jacfwd(network.residual, argnums=1)(jnp.asarray(t, float), z)
