"""Velocity of the blood under given forces: relaxation with the scalar operator of momentum.

Momentum has the same operator A for each component, and besides what couples the components (see
`solve.blood_tangent`). With the diagonal D of all of it, and N, the entries of A beside its own
diagonal, each sweep is::

    v ← v + ω (D⁻¹ (r − N v) − v),     v = D⁻¹ r at first

Where flow crosses ten elements in a step, as in a slit, N is as large as D, and the diagonal alone
leaves it to GMRES to carry along what the flow carries. Four sweeps take a fifteenth of an
iteration there and save a fifth to a quarter of them, nearly as many as the exact inverse of the
whole operator (71 iterations with the diagonal alone, 50 with sweeps, 46 exactly at the worst
moment of a patient's beat; what is left is the Schur complement's). Where flow crosses less than an
element, as in a tube, they save none and are left out.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxfsi.core.elements.linear import gathered
from jaxfsi.core.elements.stencil import apply, columns_of_pairs

SWEEPS = 4
"""Sweeps where flow crosses elements."""

OMEGA = 0.75
"""Damping ω of a sweep. Rows of N sum up to 1.3 of D: with 0.9 some states of a patient diverge."""

CROSSED = 1.5
"""Mean of D over that of blood at rest from which on flow crosses elements."""

PAIRS = tuple((a, b) for a in range(4) for b in range(4) if a != b)
"""Rows and columns of the entries of an element that N has."""


class Relaxation(eqx.Module):
    """The stencil N and where it lies.

    Attributes:
        nodes: the blood's own nodes, whose velocity is unknown.
        neighbour: place among them of each column; the node's own where a column is not used.
        entry: place in N of the entries `PAIRS` of each element, beyond its end where one of the
            two nodes is another.
        mirror: place in N of each entry's transpose.
        N: zero until renewed.
        crosses: whether flow crosses elements, so that sweeps are worth it; not until renewed.
    """

    nodes: Int[Array, " own"]
    neighbour: Int[Array, "columns own"]
    entry: Int[Array, "12 tets"]
    mirror: Int[Array, "columns own"]
    N: Float[Array, "columns own"]
    crosses: Bool[Array, ""]


def relaxation(
    tets: Int[np.ndarray, "tets 4"],
    own: Bool[np.ndarray, " nodes"],
    *,
    dtype: type = np.float32,
) -> Relaxation:
    """Stencil of the blood's elements.

    Args:
        tets: nodes of the blood's elements.
        own: nodes whose velocity is relaxed.
        dtype: precision of N.
    """
    nodes = np.flatnonzero(own)
    place = np.full(len(own), -1)
    place[nodes] = np.arange(len(nodes))
    row, column = (place[tets[:, [pair[k] for pair in PAIRS]]] for k in (0, 1))
    inside = (row >= 0) & (column >= 0)
    neighbour, rank = columns_of_pairs(row[inside], column[inside], len(nodes))
    entry = np.full(row.shape, neighbour.size)
    entry[inside] = rank * len(nodes) + row[inside]
    mirror = np.arange(neighbour.size).reshape(neighbour.shape)
    k, i = np.nonzero(neighbour != np.arange(len(nodes)))
    _, back = columns_of_pairs(neighbour[k, i], i, len(nodes))
    mirror[k, i] = back * len(nodes) + neighbour[k, i]
    return Relaxation(
        jnp.asarray(nodes, jnp.int32),
        jnp.asarray(neighbour, jnp.int32),
        jnp.asarray(entry.T, jnp.int32),
        jnp.asarray(mirror, jnp.int32),
        jnp.zeros(neighbour.shape, dtype),
        jnp.asarray(False),
    )


def renewed(
    known: Relaxation, A: tuple[Float[Array, " tets"], ...], stiffened: Float[Array, ""]
) -> Relaxation:
    """The same with another operator.

    Args:
        known: of any operator.
        A: the sixteen entries of each element, row by row.
        stiffened: mean of D over that of blood at rest.
    """
    crosses = stiffened > CROSSED

    def assembled() -> Float[Array, "columns own"]:
        values = jnp.stack([A[4 * a + b] for a, b in PAIRS]).astype(known.N.dtype)
        flat = jnp.zeros_like(known.N).reshape(-1).at[known.entry].add(values, mode="drop")
        return flat.reshape(known.N.shape)

    N = jax.lax.cond(crosses, assembled, lambda: known.N)
    return eqx.tree_at(lambda k: (k.N, k.crosses), known, (N, crosses))


def transposed(known: Relaxation) -> Relaxation:
    """The same with the transposed operator."""

    def mirrored() -> Float[Array, "columns own"]:
        return gathered(known.N.reshape(-1), known.mirror)

    N = jax.lax.cond(known.crosses, mirrored, lambda: known.N)
    return eqx.tree_at(lambda k: k.N, known, N)


def relaxed(
    known: Relaxation,
    inverse_diagonal: Float[Array, "3 nodes"],
    r: Float[Array, "3 nodes"],
    *,
    sweeps: int = SWEEPS,
) -> Float[Array, "3 nodes"]:
    """Velocity of the blood's own nodes under the forces r, zero elsewhere.

    Args:
        known: the operator.
        inverse_diagonal: D⁻¹, zero but at those nodes.
        r: forces.
        sweeps: how many, where flow crosses elements.
    """

    def swept() -> Float[Array, "3 nodes"]:
        own_inverse, own_r = inverse_diagonal[:, known.nodes], r[:, known.nodes]

        def sweep(_: int, v: Float[Array, "3 own"]) -> Float[Array, "3 own"]:
            carried = jnp.stack([apply(known.N, known.neighbour, component) for component in v])
            return v + OMEGA * (own_inverse * (own_r - carried) - v)

        v = jax.lax.fori_loop(0, sweeps, sweep, own_inverse * own_r)
        return jnp.zeros_like(r).at[:, known.nodes].set(v)

    return jax.lax.cond(known.crosses, swept, lambda: inverse_diagonal * r)
