"""The lumen of a vessel as a sequence of planar cross-sections.

Every cross-section is a closed polygon. Its area, perimeter and second moments are the exact
integrals over that polygon (Green's theorem), so they are smooth in the points and a derivative
with respect to the shape of the lumen needs nothing else::

    A   = ½ |Σ (xᵢ yᵢ₊₁ − xᵢ₊₁ yᵢ)|
    I_p = ∫ (x² + y²) dA about the centroid
    D_h = 4 A / (perimeter)

Source: Steger 1996, "On the calculation of arbitrary moments of polygons", TU München FGBV-96-05.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

_COARSE_DIRECTIONS = 90
_FINE_DIRECTIONS = 65


class EllipseAxes(NamedTuple):
    """Semi-axes of one ellipse per cross-section [cm]."""

    major: Float[Array, " frames"]
    minor: Float[Array, " frames"]


class Calipers(NamedTuple):
    """Largest and smallest distance of two parallel tangents (Feret diameters) [cm]."""

    major: Float[Array, " frames"]
    minor: Float[Array, " frames"]


class Lumen(eqx.Module):
    """Cross-sections of a vessel from its ostium (s = 0) downstream.

    Both fields are arrays and are differentiated; nothing is static but the shapes. A contour is
    not closed by a repeated point, and its sense of rotation does not matter.

    Attributes:
        contours: points of each cross-section in its own plane [cm].
        s: axial position of each cross-section, growing downstream from the ostium [cm].
    """

    contours: Float[Array, "frames points 2"]
    s: Float[Array, " frames"]

    @property
    def area(self) -> Float[Array, " frames"]:
        """Area of each cross-section [cm²]."""
        return polygon_area(self.contours)

    @property
    def perimeter(self) -> Float[Array, " frames"]:
        """Perimeter of each cross-section [cm]."""
        return polygon_perimeter(self.contours)

    @property
    def hydraulic_diameter(self) -> Float[Array, " frames"]:
        """Four times the area over the perimeter [cm]."""
        return 4.0 * self.area / self.perimeter

    @property
    def polar_moment(self) -> Float[Array, " frames"]:
        """Polar second moment of area about the centroid, ∫ r² dA [cm⁴]."""
        return polygon_polar_moment(self.contours)

    @property
    def calipers(self) -> Calipers:
        """Major and minor axis lengths as maximal and minimal caliper width [cm]."""
        return caliper_widths(self.contours)

    @property
    def equivalent_ellipse(self) -> EllipseAxes:
        """Semi-axes of the ellipse of the same area and the same polar moment [cm].

        With a b = A/π and a² + b² = 4 I_p/A: (a ± b)² = 4 I_p/A ± 2 A/π. No shape has a smaller
        polar moment than the disc of its area, so the lower sign never turns negative.
        """
        area = self.area
        mean_square = 4.0 * self.polar_moment / area
        total = jnp.sqrt(mean_square + 2.0 * area / jnp.pi)
        squared = mean_square - 2.0 * area / jnp.pi
        # A disc has a = b, where the square root has no derivative.
        distinct = squared > 0.0
        difference = jnp.where(distinct, jnp.sqrt(jnp.where(distinct, squared, 1.0)), 0.0)
        return EllipseAxes((total + difference) / 2.0, (total - difference) / 2.0)


def _edges(
    points: Float[Array, "frames points 2"],
) -> tuple[
    Float[Array, "frames points 2"],
    Float[Array, "frames points 2"],
    Float[Array, "frames points"],
]:
    following = jnp.roll(points, -1, axis=1)
    cross = points[..., 0] * following[..., 1] - following[..., 0] * points[..., 1]
    return points, following, cross


def polygon_area(contours: Float[Array, "frames points 2"]) -> Float[Array, " frames"]:
    """Area of each closed polygon [cm²], whatever its sense of rotation (shoelace formula)."""
    _, _, cross = _edges(contours - contours[:, :1, :])
    return jnp.abs(jnp.sum(cross, axis=1)) / 2.0


def polygon_perimeter(contours: Float[Array, "frames points 2"]) -> Float[Array, " frames"]:
    """Perimeter of each closed polygon [cm]."""
    squared = jnp.sum((jnp.roll(contours, -1, axis=1) - contours) ** 2, axis=2)
    # Two coinciding points make an edge of length zero, where the square root has no derivative.
    positive = squared > 0.0
    return jnp.sum(jnp.where(positive, jnp.sqrt(jnp.where(positive, squared, 1.0)), 0.0), axis=1)


def polygon_polar_moment(contours: Float[Array, "frames points 2"]) -> Float[Array, " frames"]:
    """Polar second moment of area of each closed polygon about its centroid [cm⁴].

    I_p = (1/12) Σ cᵢ (|pᵢ|² + pᵢ·pᵢ₊₁ + |pᵢ₊₁|²), cᵢ = pᵢ × pᵢ₊₁ (Steger 1996), with the origin
    moved to the centroid.
    """
    # The first point as origin keeps the sums from cancelling when the contour lies far out.
    points, following, cross = _edges(contours - contours[:, :1, :])
    doubled_area = jnp.sum(cross, axis=1)
    centroid = (
        jnp.sum((points + following) * cross[..., None], axis=1) / (3.0 * doubled_area)[:, None]
    )
    points, following, cross = _edges(points - centroid[:, None, :])
    squares = jnp.sum(points**2 + points * following + following**2, axis=2)
    return jnp.abs(jnp.sum(cross * squares, axis=1)) / 12.0


def _widths(
    contours: Float[Array, "frames points 2"], angles: Float[Array, "frames directions"]
) -> Float[Array, "frames directions"]:
    directions = jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=2)
    heights = jnp.einsum("fpk,fdk->fdp", contours, directions)
    return jnp.max(heights, axis=2) - jnp.min(heights, axis=2)


def caliper_widths(contours: Float[Array, "frames points 2"]) -> Calipers:
    """Largest and smallest caliper width of each cross-section [cm].

    The width w(θ) = max p·n(θ) − min p·n(θ) is searched on directions 2° apart and then 1/16°
    apart around the best of them. The direction itself is not differentiated. At the largest width
    its derivative does not enter (envelope theorem). The smallest width of a polygon lies at a kink
    of w, along an edge of its hull, and turns with that edge: its derivative is right where the
    outline is scaled or moved as a whole, not by single points. `fields.lumen_rings` follows the
    edge.

    Args:
        contours: points of each cross-section [cm].

    Returns:
        Major and minor caliper width of each cross-section [cm]. The major one is low by less
        than 1e-6 relative, the minor one high by less than (major) × 5e-4.
    """
    n_frames = contours.shape[0]
    step = jnp.pi / _COARSE_DIRECTIONS
    coarse = jnp.broadcast_to(
        step * jnp.arange(float(_COARSE_DIRECTIONS)), (n_frames, _COARSE_DIRECTIONS)
    )
    fine = jnp.linspace(-step, step, _FINE_DIRECTIONS)
    widths = jax.lax.stop_gradient(_widths(contours, coarse))

    def around(best: Array) -> Float[Array, "frames directions"]:
        angle = jnp.take_along_axis(coarse, best[:, None], axis=1)
        angles = angle + jnp.broadcast_to(fine, (n_frames, _FINE_DIRECTIONS))
        return _widths(contours, angles)

    major = jnp.max(around(jnp.argmax(widths, axis=1)), axis=1)
    minor = jnp.min(around(jnp.argmin(widths, axis=1)), axis=1)
    return Calipers(major, minor)
