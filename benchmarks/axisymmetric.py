"""Steady flow through the FDA's nozzle in (z, r), by another method than the core's.

Quadratic velocity and linear pressure on quadrilaterals (Taylor-Hood), Newton's method and a direct
solver, by scikit-fem. With velocity (u, v) along z and r, for all test functions (w, q)::

    ∫ (ρ (u·∇u)·w + 2μ D(u):D(w) + 2μ v w_r/r² − p ∇·w) r dz dr = 0,    ∫ q ∇·u r dz dr = 0
    ∇·u = ∂u/∂z + ∂v/∂r + v/r

with Poiseuille's flow at the inlet, no slip at the wall, no radial velocity on the axis and no
force at the outlet. The loss coefficient is that of `jaxfsi.verification.nozzle`. It is 3.40488,
3.40448, 3.40437 and 3.40427 with a `fineness` of 2, 3, 4 and 6 (90 seconds).

Source: Taylor & Hood 1973, Comput Fluids 1:73.
"""

from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from jaxfsi.verification.nozzle import (
    CONE,
    FLOW,
    INLET,
    MU,
    NARROW,
    OUTLET,
    RHO,
    THROAT,
    WIDE,
    loss_coefficient,
)

_DENSITY_STEPS = (0.0, 0.1, 0.3, 1.0)
"""Shares of the density, one solution the start of the next."""

_MOST_ITERATIONS, _CHANGE = 15, 1e-8


def axisymmetric_loss(fineness: int) -> float:
    """Loss coefficient of the nozzle.

    Args:
        fineness: 180 × its square quadrilaterals.

    Raises:
        RuntimeError: Newton's method did not converge.
    """
    from skfem import Basis, BilinearForm, ElementQuad1, ElementQuad2, ElementVector, LinearForm
    from skfem.helpers import ddot, div, dot, mul, sym_grad

    @BilinearForm
    def viscous(u: Any, v: Any, w: Any) -> Any:
        r = w.x[1]
        return 2.0 * MU * (r * ddot(sym_grad(u), sym_grad(v)) + u[1] * v[1] / r)

    @BilinearForm
    def continuity(u: Any, q: Any, w: Any) -> Any:
        return -q * (w.x[1] * div(u) + u[1])

    @LinearForm
    def convection(v: Any, w: Any) -> Any:
        return w.x[1] * dot(mul(w.at.grad, w.at), v)

    @BilinearForm
    def convection_derivative(u: Any, v: Any, w: Any) -> Any:
        return w.x[1] * dot(mul(u.grad, w.at) + mul(w.at.grad, u), v)

    mesh: Any = _mesh(fineness)
    velocity: Any = Basis(mesh, ElementVector(ElementQuad2()), intorder=6)
    pressure: Any = velocity.with_element(ElementQuad1())
    A, B = viscous.assemble(velocity), continuity.assemble(velocity, pressure)
    linear: Any = sp.block_array([[A, B.T], [B, None]]).tocsr()
    x, known = _boundary_values(velocity, pressure.N)
    free, n = np.flatnonzero(~known), velocity.N
    for share in _DENSITY_STEPS:
        for _ in range(_MOST_ITERATIONS):
            at = velocity.interpolate(x[:n])
            residual = linear @ x
            residual[:n] += share * RHO * convection.assemble(velocity, at=at)
            tangent = share * RHO * convection_derivative.assemble(velocity, at=at)
            tangent.resize(linear.shape)
            change: Any = spsolve((linear + tangent)[free][:, free].tocsc(), -residual[free])
            x[free] += change
            if np.max(np.abs(change)) < _CHANGE * np.max(np.abs(x)):
                break
        else:
            raise RuntimeError("the axisymmetric flow was not found: take a finer mesh")
    axis = np.flatnonzero(mesh.p[1] < 1e-12)
    axis = axis[np.argsort(mesh.p[0, axis])]
    P = x[n:][pressure.nodal_dofs[0, axis]]
    return loss_coefficient(mesh.p[0, axis], P)


def _boundary_values(velocity: Any, n_pressures: int) -> tuple[np.ndarray, np.ndarray]:
    """Start with the prescribed velocities, and which unknowns those are."""
    r = velocity.doflocs[1]
    radial = np.zeros(velocity.N, bool)
    for numbers in (velocity.nodal_dofs, velocity.facet_dofs, velocity.interior_dofs):
        radial[numbers[1::2]] = True
    edges = velocity.mesh.boundary_facets()
    middle = velocity.mesh.p[:, velocity.mesh.facets[:, edges]].mean(axis=1)
    open_or_axis = np.isclose(middle[0], OUTLET) | np.isclose(middle[1], 0.0)
    at_inlet = np.isclose(middle[0], INLET)
    wall = velocity.get_dofs(edges[~open_or_axis & ~at_inlet]).all()
    inlet = velocity.get_dofs(edges[at_inlet]).all()
    values = np.zeros(velocity.N + n_pressures)
    known = np.zeros(len(values), bool)
    known[wall], known[inlet] = True, True
    known[: velocity.N] |= radial & np.isclose(r, 0.0)
    along = inlet[~radial[inlet]]
    values[along] = 2.0 * FLOW / (np.pi * WIDE**2) * (1.0 - (r[along] / WIDE) ** 2)
    return values, known


def _mesh(n: int) -> Any:
    """Quadrilaterals in (z, r), small at the wall and at both ends of the throat."""
    from skfem import MeshQuad

    steps = np.linspace(0.0, 1.0, 6 * n + 1)
    at_ends = 0.4 * (1.0 - np.cos(np.pi * steps)) + 0.2 * steps
    half = np.linspace(0.0, 1.0, 8 * n + 1)[1:]
    middle = 0.5 * THROAT
    z = np.concatenate(
        [
            INLET + (CONE - INLET) * steps,
            CONE + (THROAT - CONE) * at_ends[1:],
            THROAT + (middle - THROAT) * half**1.5,
            middle * (1.0 - half) ** 2.0,
            OUTLET * np.linspace(0.0, 1.0, 16 * n + 1)[1:] ** 2.4,
        ]
    )
    across = np.linspace(0.0, 1.0, 3 * n + 1)
    s = np.concatenate([1.0 - (1.0 - across) ** 1.5, 1.0 + across[1:] ** 1.4])
    block = MeshQuad.init_tensor(z, s)
    z, s = block.p
    lumen = np.interp(z, [INLET, CONE, THROAT, 0.0], [WIDE, WIDE, NARROW, NARROW])
    r = np.where(s <= 1.0, s * lumen, NARROW + (s - 1.0) * (WIDE - NARROW))
    kept = (s[block.t].mean(axis=0) < 1.0) | (z[block.t].mean(axis=0) > 0.0)
    return MeshQuad(np.stack([z, r]), block.t).restrict(np.flatnonzero(kept))
