"""Linear tetrahedra as arrays: gradients of the shape functions, gather and scatter.

Component arrays come first and the long axis last: a nodal vector field is ``(3, nodes)``. Element
kernels work on tuples of arrays with one value an element, and sums over corners and directions
are written out: XLA on a CPU makes one loop over the elements of that, and is three times slower
with the same sums taken as reductions over a short axis.

With the edges eₖ = xₖ − x₀ of an element, det = e₁·(e₂×e₃) = 6 V and::

    ∇N₁ = e₂×e₃/det,  ∇N₂ = e₃×e₁/det,  ∇N₃ = e₁×e₂/det,  ∇N₀ = −(∇N₁ + ∇N₂ + ∇N₃)

Source: Zienkiewicz & Taylor 2000, The Finite Element Method, vol. 1, section 6.
"""

import functools
import operator
from collections.abc import Iterable, Sequence
from typing import NamedTuple, Protocol, TypeVar, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from lumped.device import on_cpu

Tree = TypeVar("Tree")


IN_BOUNDS = "promise_in_bounds"
"""Nodes of elements exist: their indices are not checked in each kernel."""


def gathered(field: Float[Array, " n"], index: Int[Array, "*places"]) -> Float[Array, "*places"]:
    """Entries of a field at indices that exist."""
    return field.at[index].get(mode=IN_BOUNDS, wrap_negative_indices=False)


Corners = tuple[Float[Array, " tets"], ...]
"""Values of a scalar field at the four corners of the elements."""


class Geometry(NamedTuple):
    """Shape of the elements.

    Attributes:
        grad: each component of the gradients of the four shape functions [1/cm].
        volume: signed volumes [cm³].
    """

    grad: tuple[Corners, Corners, Corners]
    volume: Float[Array, " tets"]


def added(terms: Iterable[Float[Array, "*shape"]]) -> Float[Array, "*shape"]:
    """Sum of a few arrays."""
    return functools.reduce(operator.add, terms)


@runtime_checkable
class _Elements(Protocol):
    """Any elements that have a volume."""

    @property
    def volume(self) -> Float[Array, " elements"]: ...


def fusion_barrier(values: Tree, shape: _Elements) -> Tree:
    """The same values, computed once and stored.

    XLA on a CPU repeats whatever leads to a value in every loop that uses it, and a kernel with
    thirty results that use the same stress would compute it thirty times. The branches of a
    condition are the boundary that it respects. Between the coefficients of the blood's equations
    and its residual, and before the forces of the corners, it halves the time of a residual;
    around every stage it costs more than it saves. An accelerator would wait for the host at each
    condition, and gets none.

    Args:
        values: arrays of element values.
        shape: of the elements; tells whether there are any, which is not known when compiling.
    """
    if not shape.volume.size or not on_cpu():
        return values
    return jax.lax.cond(
        shape.volume[0] != 0.0, lambda v: v, lambda v: jax.tree.map(jnp.zeros_like, v), values
    )


@eqx.filter_custom_jvp
def derivative_barrier(values: Tree, shape: Geometry) -> Tree:
    """The same values; where they are differentiated, `fusion_barrier` with all that leads to them.

    Between two stages of a kernel it costs nothing in the kernel itself. In its derivative the
    values of the first stage, and in reverse mode their cotangents, are computed once.
    """
    del shape
    return values


@derivative_barrier.def_jvp
def _(primals, tangents):
    values, shape = primals
    # the identity as a solve: a linear function whose transpose can be chosen
    change = jax.lax.custom_linear_solve(
        lambda v: v, tangents[0], lambda _, v: v, lambda _, v: fusion_barrier(v, shape)
    )
    return fusion_barrier(values, shape), change


def corners(field: Float[Array, " nodes"], tets: Int[Array, "4 tets"]) -> Corners:
    """Values of a scalar field at the corners of the elements."""
    return tuple(gathered(field, tets))


def vector_corners(
    field: Float[Array, "3 nodes"], tets: Int[Array, "4 tets"]
) -> tuple[Corners, Corners, Corners]:
    """Values of each component of a vector field at the corners of the elements."""
    return corners(field[0], tets), corners(field[1], tets), corners(field[2], tets)


def total(values: Corners) -> Float[Array, " tets"]:
    """Sum over the corners."""
    return values[0] + values[1] + values[2] + values[3]


def geometry(x: Float[Array, "3 nodes"], tets: Int[Array, "4 tets"]) -> Geometry:
    """Gradients and volumes of linear tetrahedra with node positions x [cm]."""
    corner = vector_corners(x, tets)
    e = [[corner[j][i] - corner[j][0] for j in range(3)] for i in (1, 2, 3)]
    normals = [_cross(e[1], e[2]), _cross(e[2], e[0]), _cross(e[0], e[1])]
    det = added(e[0][j] * normals[0][j] for j in range(3))
    others = [[n / det for n in normal] for normal in normals]
    first = [-added(others[i][j] for i in range(3)) for j in range(3)]
    g_x, g_y, g_z = ((first[j], *(others[i][j] for i in range(3))) for j in range(3))
    return Geometry((g_x, g_y, g_z), det / 6.0)


def _cross(a: Sequence[Array], b: Sequence[Array]) -> list[Array]:
    return [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]


def scatter(
    values: Sequence[Float[Array, " elements"]],
    nodes: Int[Array, "places elements"],
    n_nodes: int,
) -> Float[Array, " nodes"]:
    """Sum the contributions of all elements to each node.

    Args:
        values: one array for each place of an element.
        nodes: of each place.
        n_nodes: number of nodes.
    """
    zero = jnp.zeros(n_nodes, values[0].dtype)
    return zero.at[nodes.reshape(-1)].add(
        jnp.concatenate(values), mode=IN_BOUNDS, wrap_negative_indices=False
    )


def gradient(
    values: Corners, shape: Geometry
) -> tuple[Float[Array, " tets"], Float[Array, " tets"], Float[Array, " tets"]]:
    """Gradient of a nodal field on each element, one array a direction."""
    g = shape.grad
    x, y, z = (
        g[j][0] * values[0] + g[j][1] * values[1] + g[j][2] * values[2] + g[j][3] * values[3]
        for j in range(3)
    )
    return x, y, z


def area_vectors(
    x: Float[Array, "3 nodes"], faces: Int[Array, "3 faces"]
) -> Float[Array, "3 faces"]:
    """Normal of each triangle times its area [cm²], outwards where the faces are oriented so."""
    corner = x[:, faces]
    return jnp.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0], axis=0) / 2.0


def flux(
    u: Float[Array, "3 nodes"], x: Float[Array, "3 nodes"], faces: Int[Array, "3 faces"]
) -> Float[Array, ""]:
    """∫ u·n over the triangles [cm³/s]."""
    return jnp.sum(jnp.mean(u[:, faces], axis=1) * area_vectors(x, faces))


def face_load(
    traction: Float[Array, "3 faces"], faces: Int[Array, "3 faces"], n_nodes: int
) -> Float[Array, "3 nodes"]:
    """Nodal forces of a force per face, shared equally by its corners [dyn]."""
    third = jnp.broadcast_to(traction[:, None, :] / 3.0, (3, *faces.shape))
    zero = jnp.zeros(n_nodes, traction.dtype)
    return jnp.stack([zero.at[faces.reshape(-1)].add(f.reshape(-1)) for f in third])
