"""Cross-sections of a lumen as rings of material points, differentiable in the motion of the wall.

A plane across the artery crosses edges of the lumen's triangles. These points move with the wall;
the ring that they make is measured in the plane on which it encloses most::

    a = ½ Σ p_k × p_(k+1),    area = |a|,    outline: the ring seen along a

The area is that of a plane cut to second order in the angle by which points leave their plane.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxfsi.anatomy.sections import plane_axes, surface_ring
from jaxfsi.fields.lumen_sections import Planes
from jaxfsi.lumen import polygon_area
from jaxfsi.mesh import INTERFACE, Mesh


class LumenSize(NamedTuple):
    """Size of the lumen in each ring.

    Attributes:
        area: [cm²].
        minor: smallest caliper width [cm].
    """

    area: Float[Array, " rings"]
    minor: Float[Array, " rings"]


class LumenRings(eqx.Module):
    """Rings of points on the edges of a lumen; short ones repeat their last point.

    Attributes:
        s: distance of each ring from the ostium [cm].
        low: first end of the edge of each point.
        high: its second end.
        share: place between them, 0 at the first.
        axis: a direction in the plane of each ring.
    """

    s: Float[Array, " rings"]
    low: Int[Array, "rings points"]
    high: Int[Array, "rings points"]
    share: Float[Array, "rings points"]
    axis: Float[Array, "rings 3"]

    def outlines(self, x: Float[Array, "3 nodes"]) -> Float[Array, "rings points 2"]:
        """The rings in their planes [cm].

        Args:
            x: positions of the nodes [cm].
        """
        p = jnp.moveaxis(x[:, self.low] * (1.0 - self.share) + x[:, self.high] * self.share, 0, 2)
        p = p - jnp.mean(p, axis=1, keepdims=True)
        normal = jnp.sum(jnp.cross(p, jnp.roll(p, -1, axis=1)), axis=1)
        normal = normal / jnp.linalg.norm(normal, axis=1, keepdims=True)
        along = jnp.sum(self.axis * normal, axis=1, keepdims=True)
        first = self.axis - along * normal
        first = first / jnp.linalg.norm(first, axis=1, keepdims=True)
        axes = jnp.stack([first, jnp.cross(normal, first)], axis=1)
        return jnp.einsum("rpi,rki->rpk", p, axes)

    def size(self, x: Float[Array, "3 nodes"]) -> LumenSize:
        """Area and minor axis of each ring.

        Args:
            x: positions of the nodes [cm].
        """
        outlines = self.outlines(x)
        return LumenSize(polygon_area(outlines), _smallest_width(outlines))


def _smallest_width(outlines: Float[Array, "rings points 2"]) -> Float[Array, " rings"]:
    """Smallest caliper width of each outline [cm].

    It is found along an edge of the convex hull, and the hull's edges join points: of all pairs.
    The direction turns with its pair, which the derivative has to know.
    """
    way = outlines[:, :, None] - outlines[:, None]
    square = jnp.sum(way**2, axis=3)
    apart = square > 0.0
    length = jnp.sqrt(jnp.where(apart, square, 1.0))
    across = jnp.stack([-way[..., 1], way[..., 0]], axis=3) / length[..., None]
    heights = jnp.einsum("rpk,rijk->rijp", outlines, across)
    widths = jnp.max(heights, axis=3) - jnp.min(heights, axis=3)
    return jnp.min(jnp.where(apart, widths, jnp.inf), axis=(1, 2))


def lumen_rings(mesh: Mesh, planes: Planes) -> LumenRings:
    """Rings where planes cut the lumen of a mesh in its reference shape.

    Args:
        mesh: the mesh.
        planes: across the artery; one that finds no closed lumen is left out.

    Raises:
        ValueError: no plane finds the lumen.
    """
    triangles = mesh.labelled(INTERFACE)
    rings, s, axis = [], [], []
    for position, centre, normal in zip(planes.s, planes.centre, planes.normal, strict=True):
        try:
            ring = surface_ring(mesh.points, triangles, centre, normal)
        except ValueError:
            continue
        rings.append(ring)
        s.append(position)
        axis.append(plane_axes(normal)[0])
    if not rings:
        raise ValueError(
            "no plane across the artery finds its lumen in the mesh. Mesh the anatomy that the"
            " axis belongs to."
        )
    longest = max(len(ring.low) for ring in rings)
    low, high, share = (
        jnp.asarray(np.stack([np.pad(p, (0, longest - len(p)), mode="edge") for p in parts]))
        for parts in zip(*rings, strict=True)
    )
    return LumenRings(jnp.asarray(s), low, high, share, jnp.asarray(axis))
