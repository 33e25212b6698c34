"""Baseline `amortised`: a network that gives the posterior of cause and size by features at once.

Neural posterior estimation: on simulations (c, φ, features) from the prior a network maximises

    E[ln q(c, φ | features)],    q = softmax(ℓ)_c · N(φ; m_c, s_c²),

whose maximum over all q is the posterior given the features. A cause without a size (none, unknown)
has the first factor alone. Sizes are over the root mean square that the catalogue expects.

Source: Papamakarios & Murray 2016 (NeurIPS 29); Cranmer, Brehmer & Louppe 2020 (PNAS 117:30055).
Steps: Adam (Kingma & Ba 2015) with weights that decay (Loshchilov & Hutter 2019).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

WIDTH, DEPTH, STEPS_TOGETHER = 96, 2, 64

RATE, DECAY, NOISE = 1e-3, 0.1, 0.1
"""Length of a step, decay of the weights a step over it, noise of features while training [sd]."""

PATIENCE = 40
"""Passes without a gain on the simulations held out after which training ends."""


class PosteriorNetwork(eqx.Module):
    """q(c, φ | features).

    Attributes:
        centre, scale: of the features; they are not trained.
        layers: from standardised features to ℓ, m and ln s.
    """

    centre: Float[Array, " k"]
    scale: Float[Array, " k"]
    layers: eqx.nn.MLP

    def __call__(
        self, features: Float[Array, " k"], noise: Float[Array, " k"] | None = None
    ) -> tuple[Float[Array, " c"], Float[Array, " c"], Float[Array, " c"]]:
        """Ln q of every cause, and mean and standard deviation of its size if it acts."""
        x = (features - self.centre) / self.scale
        x = jnp.clip(jnp.where(jnp.isfinite(x), x, 0.0), -6.0, 6.0)
        x = x if noise is None else x + noise
        logits, mean, log_sd = jnp.split(self.layers(x), 3)
        return jax.nn.log_softmax(logits), mean, jnp.exp(jnp.clip(log_sd, -5.0, 3.0))


def blank(n_features: int, n_causes: int, key: Array) -> PosteriorNetwork:
    """An untrained network."""
    layers = eqx.nn.MLP(n_features, 3 * n_causes, WIDTH, DEPTH, jax.nn.silu, key=key)
    return PosteriorNetwork(jnp.zeros(n_features), jnp.ones(n_features), layers)


def loss(
    network: PosteriorNetwork,
    features: Float[Array, "n k"],
    cause: Int[Array, " n"],
    size: Float[Array, " n"],
    noise: Float[Array, "n k"],
) -> Float[Array, ""]:
    """Mean of −ln q; of causes whose size is NaN the first factor alone."""
    log_q, mean, sd = jax.vmap(network)(features, noise)
    own = jax.tree.map(lambda leaf: leaf[jnp.arange(cause.size), cause], (log_q, mean, sd))
    sized = jnp.isfinite(size)
    z = (jnp.where(sized, size, 0.0) - own[1]) / own[2]
    normal = -0.5 * z**2 - jnp.log(own[2]) - 0.5 * jnp.log(2.0 * jnp.pi)
    return -jnp.mean(own[0] + jnp.where(sized, normal, 0.0))


class _State(eqx.Module):
    """State of the training: a network, running means of its slopes and their squares, steps."""

    network: PosteriorNetwork
    first: eqx.nn.MLP
    second: eqx.nn.MLP
    count: Float[Array, ""]
    key: Array


@eqx.filter_jit
def _pass(state: _State, rows: Int[Array, "s b"], data: tuple[Array, Array, Array]) -> _State:
    """One pass over the simulations, in steps of rows, by Adam."""
    arrays, static = eqx.partition(state, eqx.is_array)

    def step(arrays: _State, at: Array) -> tuple[_State, None]:
        now = eqx.combine(arrays, static)
        key, own = jax.random.split(now.key)
        features, cause, size = (leaf[at] for leaf in data)
        noise = NOISE * jax.random.normal(own, features.shape)

        def of_layers(layers: eqx.nn.MLP) -> Array:
            network = eqx.tree_at(lambda n: n.layers, now.network, layers)
            return loss(network, features, cause, size, noise)

        slopes = eqx.filter_grad(of_layers)(now.network.layers)
        weights, fixed = eqx.partition(now.network.layers, eqx.is_inexact_array)
        count = now.count + 1.0
        first = jax.tree.map(lambda m, g: 0.9 * m + 0.1 * g, now.first, slopes)
        second = jax.tree.map(lambda v, g: 0.999 * v + 0.001 * g**2, now.second, slopes)

        def moved(w: Array, m: Array, v: Array) -> Array:
            unit = m / (1.0 - 0.9**count) / (jnp.sqrt(v / (1.0 - 0.999**count)) + 1e-8)
            return w - RATE * (unit + DECAY * w)

        layers = eqx.combine(jax.tree.map(moved, weights, first, second), fixed)
        network = eqx.tree_at(lambda n: n.layers, now.network, layers)
        return eqx.filter(_State(network, first, second, count, key), eqx.is_array), None

    arrays, _ = jax.lax.scan(step, arrays, rows)
    return eqx.combine(arrays, static)


def trained(
    features: Float[np.ndarray, "n k"],
    cause: Int[np.ndarray, " n"],
    size: Float[np.ndarray, " n"],
    n_causes: int,
    *,
    passes: int = 600,
    seed: int = 0,
) -> PosteriorNetwork:
    """A network trained on simulations; a fifth is held out and tells when to end.

    Args:
        features: of the simulations; NaN counts as their mean.
        cause: position of each cause.
        size: of each, over its expected root mean square; NaN without one.
        n_causes: number of causes.
        passes: at most so many.
        seed: of weights, split and order.
    """
    rng = np.random.default_rng(seed)
    order = rng.permutation(cause.size)
    held, own = order[: cause.size // 5], order[cause.size // 5 :]
    network = blank(features.shape[1], n_causes, jax.random.key(seed))
    known = np.ma.masked_invalid(features)
    centre, spread = np.ma.filled(known.mean(axis=0), 0.0), np.ma.filled(known.std(axis=0), 1.0)
    spread = np.where(spread > 1e-9, spread, 1.0)
    network = eqx.tree_at(
        lambda n: (n.centre, n.scale), network, (jnp.asarray(centre), jnp.asarray(spread))
    )
    data = jnp.asarray(features), jnp.asarray(cause), jnp.asarray(size)
    zero = jax.tree.map(jnp.zeros_like, eqx.filter(network.layers, eqx.is_inexact_array))
    state = _State(network, zero, zero, jnp.zeros(()), jax.random.key(seed + 1))
    together = min(STEPS_TOGETHER, own.size)
    test = eqx.filter_jit(loss)
    unseen = data[0][held], data[1][held], data[2][held]
    best, least, since = network, np.inf, 0
    for _ in range(passes):
        mixed = rng.permutation(own)[: own.size // together * together]
        state = _pass(state, jnp.asarray(mixed.reshape(-1, together)), data)
        now = float(test(state.network, *unseen, jnp.zeros_like(unseen[0])))
        since += 1
        if now < least:
            best, least, since = state.network, now, 0
        if since > PATIENCE:
            break
    return best
