"""Developed flow through a straight lumen, by Galerkin's method on linear tetrahedra.

The velocity w along the axis of a lumen of length L, driven by a pressure drop ΔP::

    −μ ∇²w = ΔP/L,  w = 0 on the wall,   Q = ∫ w/L

| section | flow for a unit ΔP/(μ L) |
|---|---|
| ellipse, half axes a and b | π a³b³/(4 (a² + b²)) |
| rectangle, sides a ≥ b | a b³/12 (1 − 192 b/(π⁵ a) Σ_{n odd} tanh(nπa/(2b))/n⁵) |

Under a drop that oscillates, ΔP e^(iωt)::

    iωρ w − μ ∇²w = ΔP/L

| section | flow for a unit ΔP/(μ L), with λ² = ωρ/μ |
|---|---|
| pipe of radius R | Womersley's, `womersley.impedance_per_length` |
| rectangle | Σ_{m,n odd} 64 a b/(π⁴ m² n²)/(π² (m²/a² + n²/b²) + iλ²) |

Solved without the core, so that what is read of a flow can be checked apart from it.

Source: White 2006, Viscous fluid flow, eqs. 3-47 and 3-48; `developed_flow` is linear elements
(Zienkiewicz & Taylor 2000) with a sparse direct solver.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Complex, Float, Int
from scipy.sparse.linalg import splu

from jaxfsi.core.laws.viscosity import Newtonian
from jaxfsi.fields.viscous_loss import viscous_loss
from jaxfsi.mesh import INTERFACE
from jaxfsi.meshing import strip
from jaxfsi.verification.round_tube import round_tube
from jaxfsi.verification.womersley import impedance_per_length

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


class OscillatingFlow(NamedTuple):
    """An oscillating flow; the real part of each times e^(iωt).

    Attributes:
        u: velocity [cm/s].
        Q: flow [cm³/s].
    """

    u: Complex[np.ndarray, "3 nodes"]
    Q: complex


def ellipse_flow(a: float, b: float) -> float:
    """Flow through an ellipse of half axes a and b [cm] for a unit ΔP/(μ L) [cm⁴]."""
    return float(np.pi * a**3 * b**3 / (4.0 * (a**2 + b**2)))


def rectangle_flow(a: float, b: float) -> float:
    """Flow through a rectangle of sides a and b [cm] for a unit ΔP/(μ L) [cm⁴]."""
    a, b = max(a, b), min(a, b)
    series = np.sum(np.tanh(_TERMS * np.pi * a / (2.0 * b)) / _TERMS**5)
    return float(a * b**3 / 12.0 * (1.0 - 192.0 * b / (np.pi**5 * a) * series))


def oscillating_pipe_flow(radius: float, wave: float) -> complex:
    """Flow through a pipe for a unit ΔP/(μ L) e^(iωt) [cm⁴] (`womersley.impedance_per_length`).

    Args:
        radius: of the pipe [cm].
        wave: ωρ/μ [1/cm²].
    """
    return 1.0 / impedance_per_length(radius, wave, 1.0, 1.0)


def oscillating_rectangle_flow(a: float, b: float, wave: float) -> complex:
    """Flow through a rectangle of sides a and b [cm] for a unit ΔP/(μ L) e^(iωt) [cm⁴].

    Args:
        a: one side [cm].
        b: the other [cm].
        wave: ωρ/μ [1/cm²].
    """
    m, n = np.meshgrid(_TERMS, _TERMS)
    decay = np.pi**2 * ((m / a) ** 2 + (n / b) ** 2) + 1j * wave
    return complex(np.sum(64.0 * a * b / (np.pi**4 * m**2 * n**2) / decay))


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
    stiffness, _, share = _matrices(lumen)
    free = np.setdiff1d(np.arange(len(share)), lumen.wall)
    w = np.zeros(len(share))
    force = dP / (mu * lumen.length) * share[free]
    w[free] = splu(stiffness[free][:, free].tocsc()).solve(force)
    return DevelopedFlow(np.stack([0.0 * w, 0.0 * w, w]), float(share @ w) / lumen.length)


def oscillating_flow(lumen: StraightLumen, wave: float) -> OscillatingFlow:
    """The developed flow of linear elements under a drop of e^(iωt) dyn/cm², for μ = 1.

    Args:
        lumen: where.
        wave: ωρ/μ [1/cm²]; Womersley's number is R times its root.
    """
    stiffness, mass, share = _matrices(lumen)
    free = np.setdiff1d(np.arange(len(share)), lumen.wall)
    w = np.zeros(len(share), complex)
    matrix = (stiffness + 1j * wave * mass)[free][:, free].tocsc()
    w[free] = splu(matrix).solve(share[free] / lumen.length + 0j)
    return OscillatingFlow(np.stack([0.0 * w, 0.0 * w, w]), complex(share @ w) / lumen.length)


def oscillating_defect(flow: OscillatingFlow, lumen: StraightLumen) -> complex:
    """η of an oscillating flow of μ = 1, with complex squares: its share of Q is lost to the mesh.

    Q is a(w, w)/ΔP with a(v, w) = iωρ ∫ v w + μ ∫ ∇v·∇w, and so Q − Q_h = a(e, e)/ΔP of the error
    e, whose gradient `jaxfsi.fields.viscous_loss` recovers; ∫ e² is of higher order.
    """
    x, tets = jnp.asarray(lumen.points.T), jnp.asarray(lumen.tets.T)

    def defect(u: Float[np.ndarray, "3 nodes"]) -> float:
        return float(jnp.sum(viscous_loss(jnp.asarray(u), x, tets, Newtonian(1.0)).defect))

    real, imaginary = defect(np.real(flow.u)), defect(np.imag(flow.u))
    both = defect(np.real(flow.u) + np.imag(flow.u))
    return complex(real - imaginary, both - real - imaginary)


def _matrices(
    lumen: StraightLumen,
) -> tuple[sp.csr_matrix, sp.csr_matrix, Float[np.ndarray, " nodes"]]:
    """∫ ∇N_a·∇N_b, ∫ N_a N_b and ∫ N_a."""
    x, tets, n = lumen.points, lumen.tets, len(lumen.points)
    edges = x[tets[:, 1:]] - x[tets[:, :1]]
    others = np.swapaxes(np.linalg.inv(edges), 1, 2)
    grad = np.concatenate([-np.sum(others, axis=1, keepdims=True), others], axis=1)
    volume = np.abs(np.linalg.det(edges)) / 6.0
    rows, columns = np.repeat(tets, 4, axis=1).ravel(), np.tile(tets, (1, 4)).ravel()

    def assembled(local: Float[np.ndarray, "tets 4 4"]) -> sp.csr_matrix:
        return sp.csr_matrix((local.ravel(), (rows, columns)), shape=(n, n))

    stiffness = assembled(np.einsum("tai,tbi,t->tab", grad, grad, volume))
    mass = assembled(np.multiply.outer(volume / 20.0, np.ones((4, 4)) + np.eye(4)))
    return stiffness, mass, np.bincount(tets.ravel(), np.repeat(volume / 4.0, 4), n)
