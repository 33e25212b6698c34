"""A network as an ordinary differential equation: its algebraic unknowns eliminated.

Index-1 networks only: the closures must determine node pressures and port flows from the states.
For linear networks the elimination is done once,

    ẋ = A x + B v(t),     w = C x + D v(t),     v(t) = (1, waveforms of the network at t),

w being the algebraic unknowns (node pressures, then port flows).
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lumped.march import newton, tangent_solve
from lumped.network import Network, jacobian
from lumped.parameters import Parameter, is_traced

NOT_INDEX_ONE = (
    "The network is not an ordinary differential equation: two compliances, or a compliance and a "
    "pressure source, share a node without a resistance between them (or an inertance or a second "
    "flow source follows a flow source). Merge them, put a resistance between them, or use "
    "`Shooting`, `march` or `Fourier(reduce=False)`, which do not need it. Elements: {}."
)


class StateSpace(eqx.Module):
    """Matrices of a linear network; make it with `state_space`.

    Attributes:
        A: state matrix [1/s], shape (n, n).
        B: sources to states, shape (n, k).
        C: states to algebraic unknowns, shape (a, n).
        D: sources to algebraic unknowns, shape (a, k).
        network: the network, for its waveforms.
    """

    A: Float[Array, "n n"]
    B: Float[Array, "n k"]
    C: Float[Array, "a n"]
    D: Float[Array, "a k"]
    network: Network

    def sources(self, t: Float[Array, " s"]) -> Float[Array, "s k"]:
        """v(t) at several times [s]."""
        rows = [jax.vmap(waveform)(t) for waveform in self.network.waveforms()]
        return jnp.stack([jnp.ones(t.shape[0]), *rows], axis=1)


def forcing_matrix(network: Network) -> Float[Array, "m k"]:
    """E of a linear network's residual(t, 0) = E v(t), v(t) = (1, waveforms at t)."""

    def forcing(values):
        zero = jnp.zeros(network.n_unknowns)
        return network.with_sources(list(values)).residual(0.0, zero)

    silent = jnp.zeros(len(network.waveforms()))
    return jnp.concatenate([forcing(silent)[:, None], jax.jacfwd(forcing)(silent)], axis=1)


def state_space(network: Network) -> StateSpace:
    """Eliminate the algebraic unknowns of a linear network.

    Raises:
        ValueError: the network is nonlinear, or (outside jit) not of index 1.
    """
    if not network.is_linear:
        raise ValueError(
            "The network has a quadratic loss and no state matrix. Use `field` or `Shooting`."
        )
    n = network.n_states
    H = jacobian(network, 0.0, jnp.zeros(network.n_unknowns))
    mass = network.mass()[:, None]
    F_x, F_w = H[:n, :n] / mass, H[:n, n:] / mass
    G_x, G_w = H[n:, :n], H[n:, n:]
    _require_index_one(network, G_w)
    inverse = jnp.linalg.inv(G_w)
    E = forcing_matrix(network)
    C, D = -inverse @ G_x, -inverse @ E[n:]
    return StateSpace(A=F_x + F_w @ C, B=E[:n] / mass + F_w @ D, C=C, D=D, network=network)


def is_index_one(network: Network) -> bool:
    """Whether the closures determine the algebraic unknowns (concrete networks only)."""
    z = jnp.full(network.n_unknowns, 0.1)
    n = network.n_states
    return _determines(np.asarray(jacobian(network, 0.0, z)[n:, n:]))


def _determines(G_w: np.ndarray) -> bool:
    # parameters that are not finite are reported by their ranges
    return not np.all(np.isfinite(G_w)) or is_regular(G_w)


def is_regular(matrix: np.ndarray) -> bool:
    """Whether a square matrix of a network has full rank; not where an entry is not finite."""
    if not np.all(np.isfinite(matrix)):
        return False
    # rows and columns carry pressures or flows: equilibrate before judging the rank
    scaled = matrix / np.maximum(np.abs(matrix).max(axis=1, keepdims=True), 1e-300)
    scaled = scaled / np.maximum(np.abs(scaled).max(axis=0, keepdims=True), 1e-300)
    return bool(np.linalg.svd(scaled, compute_uv=False)[-1] > 1e-12)


def _require_index_one(network: Network, G_w: Array) -> None:
    if is_traced(G_w) or _determines(np.asarray(G_w)):
        return
    raise ValueError(NOT_INDEX_ONE.format(", ".join(network.names)))


def field(network: Network) -> Callable[[Any, Float[Array, " n"], Any], Float[Array, " n"]]:
    """The vector field ẋ = f(t, x) of an index-1 network, in the signature diffrax expects.

    Args:
        network: the network. It is also accepted as `args` of the field, which then replaces this
            one (same structure), so that parameters can be traced: `field(network)(t, x, other)`.

    Raises:
        ValueError: (outside jit) the network is not of index 1.
    """
    n = network.n_states
    if not is_traced(*jax.tree.leaves(network)):
        z = jnp.full(network.n_unknowns, 0.1)
        _require_index_one(network, jacobian(network, 0.0, z)[n:, n:])

    def vector_field(t: Any, x: Float[Array, " n"], args: Any = None) -> Float[Array, " n"]:
        model = network if args is None else args
        w = algebraic(t, model, x)
        return model.residual(t, jnp.concatenate([x, w]))[:n] / model.mass()

    return vector_field


@jax.jit
def algebraic(t: Parameter, network: Network, x: Float[Array, " n"]) -> Float[Array, " a"]:
    """Node pressures and port flows that belong to states x at time t.

    Newton's method on the closures, with derivatives by the implicit-function theorem; exact after
    one step for linear networks.
    """
    n = network.n_states

    def closures(w):
        return network.residual(t, jnp.concatenate([x, w]))[n:]

    def correction(w):
        return jnp.linalg.solve(jax.jacfwd(closures)(w), closures(w))

    guess = jnp.ones(network.n_unknowns - n)  # the derivative of a quadratic loss vanishes at rest
    if network.is_linear:
        return guess - correction(guess)
    return jax.lax.custom_root(
        closures, guess, lambda _, w: newton(correction, w)[0], tangent_solve
    )
