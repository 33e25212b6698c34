"""Developed flow through a straight lumen, by Galerkin's method on linear tetrahedra.

The velocity w along the axis of a lumen of length L, driven by a pressure drop ΔP::

    −μ ∇²w = ΔP/L,  w = 0 on the wall,   Q = ∫ w/L

| section | flow for a unit ΔP/(μ L) |
|---|---|
| ellipse, half axes a and b | π a³b³/(4 (a² + b²)) |
| rectangle, sides a ≥ b | a b³/12 (1 − 192 b/(π⁵ a) Σ_{n odd} tanh(nπa/(2b))/n⁵) |

Solved without the core, so that what is read of a flow can be checked apart from it.

Source: White 2006, Viscous fluid flow, eqs. 3-47 and 3-48; `developed_flow` is linear elements
(Zienkiewicz & Taylor 2000) with a sparse direct solver.
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from scipy.sparse.linalg import splu

from jaxfsi.mesh import INTERFACE
from jaxfsi.meshing import strip
from jaxfsi.verification.round_tube import round_tube

_TERMS = np.arange(1, 400, 2)
_LAYERS = 4  # of elements along the axis, each as long as an element across is wide


class StraightLumen(NamedTuple):
    """A straight lumen along z.

    Attributes:
        points: nodes [cm].
        tets: elements.
        wall: nodes on the wall.
        length: of the lumen [cm].
        exact: its flow for a unit ΔP/(μ L) [cm⁴].
    """

    points: Float[np.ndarray, "nodes 3"]
    tets: Int[np.ndarray, "tets 4"]
    wall: Int[np.ndarray, " wall"]
    length: float
    exact: float


class DevelopedFlow(NamedTuple):
    """A developed flow.

    Attributes:
        u: velocity [cm/s].
        Q: flow [cm³/s].
    """

    u: Float[np.ndarray, "3 nodes"]
    Q: float


def ellipse_flow(a: float, b: float) -> float:
    """Flow through an ellipse of half axes a and b [cm] for a unit ΔP/(μ L) [cm⁴]."""
    return float(np.pi * a**3 * b**3 / (4.0 * (a**2 + b**2)))


def rectangle_flow(a: float, b: float) -> float:
    """Flow through a rectangle of sides a and b [cm] for a unit ΔP/(μ L) [cm⁴]."""
    a, b = max(a, b), min(a, b)
    series = np.sum(np.tanh(_TERMS * np.pi * a / (2.0 * b)) / _TERMS**5)
    return float(a * b**3 / 12.0 * (1.0 - 192.0 * b / (np.pi**5 * a) * series))


def elliptic_lumen(a: float, b: float, n_across: int) -> StraightLumen:
    """An ellipse in rings of elements; its polygon has the area of the ellipse.

    Args:
        a: half the long axis [cm].
        b: half the short axis [cm].
        n_across: elements across the short axis; an even number.
    """
    edge = 2.0 * b / n_across
    round_it = np.pi * (3.0 * (a + b) - np.sqrt((3.0 * a + b) * (a + 3.0 * b)))  # Ramanujan
    n_around = max(8, 2 * round(round_it / (2.0 * edge)))
    length = _LAYERS * edge
    mesh = round_tube(
        radius=1.0,
        length=length,
        n_around=n_around,
        n_axial=_LAYERS,
        n_rings=n_across // 2,
        grading=0.0,
    )
    points = mesh.points * np.array([a, b, 1.0])
    return StraightLumen(
        points, mesh.tets, np.unique(mesh.labelled(INTERFACE)), length, ellipse_flow(a, b)
    )


def rectangular_lumen(a: float, b: float, n_across: int) -> StraightLumen:
    """A rectangle of even right-angled elements.

    Args:
        a: long side [cm].
        b: short side [cm].
        n_across: elements across the short side.
    """
    edge = b / n_across
    n_long, length = round(a / edge), _LAYERS * edge
    mesh = strip(
        length=a, width=b, thickness=length, n_length=n_long, n_width=n_across, n_layers=_LAYERS
    )
    x, y, _ = mesh.points.T
    wall = (np.minimum(x, a - x) < 1e-9) | (np.minimum(y, b - y) < 1e-9)
    return StraightLumen(mesh.points, mesh.tets, np.nonzero(wall)[0], length, rectangle_flow(a, b))


def uneven(lumen: StraightLumen, amount: float, *, seed: int = 0) -> StraightLumen:
    """The lumen with its inner nodes moved at random by up to a share of an edge across."""
    x = lumen.points
    edge = lumen.length / _LAYERS
    move = amount * edge * np.random.default_rng(seed).uniform(-1.0, 1.0, x.shape)
    move[lumen.wall] = 0.0
    move[(x[:, 2] < 1e-9) | (x[:, 2] > lumen.length - 1e-9), 2] = 0.0
    return lumen._replace(points=x + move)


def developed_flow(lumen: StraightLumen, *, dP: float = 1.0, mu: float = 1.0) -> DevelopedFlow:
    """The developed flow of linear elements.

    Args:
        lumen: where.
        dP: pressure drop over its length [dyn/cm²].
        mu: viscosity [g/(cm·s)].
    """
    x, tets, n = lumen.points, lumen.tets, len(lumen.points)
    edges = x[tets[:, 1:]] - x[tets[:, :1]]
    others = np.swapaxes(np.linalg.inv(edges), 1, 2)
    grad = np.concatenate([-np.sum(others, axis=1, keepdims=True), others], axis=1)
    volume = np.abs(np.linalg.det(edges)) / 6.0
    local = np.einsum("tai,tbi,t->tab", grad, grad, mu * volume)
    rows, columns = np.repeat(tets, 4, axis=1).ravel(), np.tile(tets, (1, 4)).ravel()
    matrix = sp.csr_matrix((local.ravel(), (rows, columns)), shape=(n, n))
    share = np.bincount(tets.ravel(), np.repeat(volume / 4.0, 4), n)
    free = np.setdiff1d(np.arange(n), lumen.wall)
    w = np.zeros(n)
    w[free] = splu(matrix[free][:, free].tocsc()).solve(dP / lumen.length * share[free])
    return DevelopedFlow(np.stack([0.0 * w, 0.0 * w, w]), float(share @ w) / lumen.length)
