"""Loads on the wall: pressures that follow it, and dead forces."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.bending import mid_edges
from jaxfsi.core.laws.interface import MidEdgeInterface, mid_edge_load
from jaxfsi.core.step.model import Model
from jaxfsi.mesh import Mesh, tet_faces
from lumped.parameters import Parameter

Field = Float[Array, "3 nodes"]

NO_WALL = "the model has no wall, so that nothing can be in equilibrium; give one"


class PressureLoad(NamedTuple):
    """A pressure on triangles of the wall.

    Attributes:
        faces: triangles pointing out of the wall.
        p: pressure at all nodes of the model, of which those of the faces count [dyn/cm²].
        edges: unknowns of the edges opposite to the corners; None where edges do not bow.
    """

    faces: Int[Array, "3 faces"]
    p: Float[Array, " nodes"]
    edges: Int[Array, "3 faces"] | None = None


class Loads(NamedTuple):
    """What acts on the wall.

    Attributes:
        pressures: pressures, which follow the wall.
        force: dead forces on the nodes [dyn]; None: none.
    """

    pressures: tuple[PressureLoad, ...] = ()
    force: Field | None = None


def pressure_load(
    mesh: Mesh, label: str, p: Parameter | Float[np.ndarray, " nodes"], model: Model
) -> PressureLoad:
    """A pressure on a labelled surface of the wall.

    Args:
        mesh: the mesh of the model.
        label: name of the surface; where blood and wall meet, the wall's side is meant.
        p: pressure [dyn/cm²], a number or one value a node of the mesh.
        model: the model.

    Raises:
        ValueError: the model has no wall, or the surface is not one of it.
    """
    if model.wall is None:
        raise ValueError(NO_WALL)
    faces = np.asarray(mesh.labelled(label))
    sides = tet_faces(np.asarray(model.solid_tets, np.int64).T).reshape(-1, 3)
    ours, theirs = np.sort(sides, axis=1), np.sort(faces, axis=1)
    n = len(mesh.points)
    key = [(f[:, 0] * n + f[:, 1]) * n + f[:, 2] for f in (ours, theirs)]
    order = np.argsort(key[0])
    place = np.minimum(np.searchsorted(key[0][order], key[1]), len(order) - 1)
    found = order[place]
    if not len(faces) or np.any(key[0][found] != key[1]):
        raise ValueError(
            f"the faces named {label!r} are not all faces of the wall. Load a surface of the wall,"
            " such as interface or outer_wall."
        )
    value = jnp.broadcast_to(jnp.asarray(p, float), (n,))
    ordered = sides[found].T
    edges = mid_edges(model.element, ordered)
    return PressureLoad(jnp.asarray(ordered), jnp.pad(value, (0, model.n_nodes - n)), edges)


def load_forces(loads: Loads, d: Field, model: Model) -> Field:
    """Forces of the loads on the nodes of the deformed wall [dyn].

    Faces count as flat between their corners.
    """
    total = jnp.zeros_like(d) if loads.force is None else loads.force
    x = model.x + d
    for faces, p, edges in loads.pressures:
        a, b, c = (x[:, faces[i]] for i in range(3))
        area = jnp.cross(b - a, c - a, axis=0) / 2.0
        whole = p[faces[0]] + p[faces[1]] + p[faces[2]]
        for k in range(3):  # ∫ p N_k over a triangle is (p_k + Σ p) A/12
            total = total.at[:, faces[k]].add(-(p[faces[k]] + whole) / 12.0 * area)
        if edges is not None:
            total = total - mid_edge_load(p, x, MidEdgeInterface(faces, edges))
    return total
