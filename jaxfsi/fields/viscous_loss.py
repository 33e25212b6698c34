"""Viscous loss of a flow on linear tetrahedra, and the part of it that the mesh adds.

The dissipation of a velocity u_h, its defect by recovery of the gradient, and the power that the
unresolved velocity u′ = −τ_M r of the stabilised equations takes (`core.laws.fluid`)::

    E = ∫ 2μ D(u_h):D(u_h),     D(u) = ½ (∇u + ∇uᵀ)
    η = ∫ 2μ |G − D(u_h)|²,     G_i = Σ_e V_e D_e / Σ_e V_e  over the elements e about node i
    S = ∫ |u′|²/τ_M,            r = ρ c·∇u + ∇p

D(u_h) is constant on each element, G linear. The pressure drop of a slow flow is a compliance: of
all velocities that obey the wall the true one passes most blood, and what u_h lacks is the energy
of its error, which η estimates. S gives back: the flow through a port is that of u_h and of u′,
which runs down the pressure gradient. So, with the flow Q and the drop ΔP of a run::

    at the same drop    Q_true  = Q + (η − S)/ΔP
    at the same flow    ΔP_true = ΔP − (E + S)/Q · (η − S)/(E + η)

With Galerkin's method S = 0. To first order the latter is ΔP − (η − S)/Q; the form above is the one
that agrees with the former, as η belongs to the drop of u_h.

It holds where viscosity makes the drop. Where inertia does, E grows as a finer mesh shows thinner
boundary layers, and S is what stabilisation takes from jets and at bends: the drop cannot be mended
so, but E, η and S say how much of it the mesh resolves. In the ramp of the bundled patient at a
drop of 31 mmHg (shares of ΔP Q; the rest is the velocity head that leaves):

| tetrahedra of the blood | Q cm³/s | E/Q² dyn·s/cm⁵ | E | η | S |
|---|---|---|---|---|---|
| 12 550 | 6.17 | 839 | .12 | .03 | .72 |
| 74 910 | 7.22 | 1 407 | .24 | .04 | .69 |

Estimated over true error of the flow at a given drop (Galerkin, developed flow; 2, 3, 4, 6 and 8
elements across; - : no node lies inside the lumen somewhere, and the flow is 60 to 90 % off):

| section and mesh | this one | patches | parabolas |
|---|---|---|---|
| duct 4 x 1, even | 1.05 .91 1.0 1.0 1.0 | .94 .83 .94 .95 .96 | .94 .94 1.0 1.0 1.0 |
| the same, nodes moved | .96 .87 .95 .96 .96 | .90 .82 .92 .94 .95 | .89 .91 1.0 1.0 1.0 |
| duct 4 x 1, Netgen | .81 .86 .93 .98 .99 | .71 .77 .86 .91 .93 | .81 .87 .95 .98 .97 |
| ellipse 4 x 1, Netgen | - - .92 .98 1.1 | - - .86 .94 1.0 | - - .99 1.0 1.1 |
| pipe, Netgen | - - - 1.07 .96 | - - - .95 .93 | - - - 1.1 1.0 |

Energies are ∫ |∇w|² there; 2 D:D counts ∂w/∂z twice, and Netgen's rows become .86 .91 1.1 1.1 1.2,
- - 1.0 1.1 1.25 and - - - 1.15 1.17. On an ellipse 4 x 1 in rings, with two elements across,
parabolas reach 2.3, this one 1.3. The wall does not spoil the average: the mean at a node of the
wall belongs to the middle of its elements, half an element off, and for a parabola that offset has
the very energy of the error.

Source: Zienkiewicz & Zhu 1987 (IJNME 24:337); the patches compared, 1992 (IJNME 33:1331); the
parabolas, Zhang & Naga 2005 (SIAM J Sci Comput 26:1192). The part of S is ours.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.linear import added, geometry, scatter
from jaxfsi.core.laws.fluid import Blood, lagged_coefficients, shear_rate, velocity_gradient
from jaxfsi.core.laws.viscosity import AbstractViscosity
from lumped.parameters import Parameter

_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))


class ViscousLoss(NamedTuple):
    """Viscous loss of a velocity.

    Attributes:
        rate: E of each element [erg/s].
        defect: η of each [erg/s].
    """

    rate: Float[Array, " tets"]
    defect: Float[Array, " tets"]


def viscous_loss(
    u: Float[Array, "3 nodes"],
    x: Float[Array, "3 nodes"],
    tets: Int[Array, "4 tets"],
    viscosity: AbstractViscosity,
) -> ViscousLoss:
    """Dissipation of a velocity, and its defect.

    Differentiable in the velocity, the positions and the viscosity.

    Args:
        u: velocity [cm/s].
        x: positions of all nodes at that time [cm].
        tets: elements of the blood.
        viscosity: law of the blood's viscosity, taken at the shear rate of each element.
    """
    shape = geometry(x, tets)
    g = velocity_gradient(u, tets, shape)
    V, twice_mu, n_nodes = shape.volume, 2.0 * viscosity(shear_rate(g)), x.shape[1]
    around = scatter([V] * 4, tets, n_nodes)
    around = jnp.where(around == 0.0, 1.0, around)  # nodes of the wall's inside
    rate = defect = jnp.zeros_like(V)
    for i, j in _PAIRS:
        count = 1.0 if i == j else 2.0
        D = (g[i][j] + g[j][i]) / 2.0
        G = scatter([V * D] * 4, tets, n_nodes) / around
        off = [G[nodes] - D for nodes in tets]
        rate = rate + count * D**2
        defect = defect + count / 20.0 * (added(o**2 for o in off) + added(off) ** 2)
    return ViscousLoss(twice_mu * V * rate, twice_mu * V * defect)


def unresolved_loss(
    dt: Parameter,
    u: Float[Array, "3 nodes"],
    p: Float[Array, " nodes"],
    x: Float[Array, "3 nodes"],
    tets: Int[Array, "4 tets"],
    blood: Blood,
) -> Float[Array, " tets"]:
    """S of each element [erg/s], of a steady flow on a mesh at rest.

    Args:
        dt: length of the steps that it was computed with, which τ_M depends on [s].
        u: velocity [cm/s].
        p: pressure [dyn/cm²].
        x: positions of all nodes at that time [cm].
        tets: elements of the blood.
        blood: what the blood is like.
    """
    shape, still = geometry(x, tets), jnp.zeros_like(u)
    found = lagged_coefficients(dt, u, still, p, still, blood, tets, shape)
    return shape.volume * added(part**2 for part in found.subscale) / found.tau_momentum


def flow_lost_to_mesh(dP: Parameter, eta: Parameter, S: Parameter = 0.0) -> Array:
    """(η − S)/ΔP: by how much the mesh makes the flow at a drop too small [cm³/s].

    Args:
        dP: the drop [dyn/cm²].
        eta: η, in all [erg/s].
        S: S, in all [erg/s]; none for Galerkin's method, or where inertia makes the drop.
    """
    return (jnp.asarray(eta) - S) / dP


def drop_added_by_mesh(Q: Parameter, E: Parameter, eta: Parameter, S: Parameter = 0.0) -> Array:
    """(E + S)/Q · (η − S)/(E + η): by how much it makes the drop of a flow too large [dyn/cm²].

    Args:
        Q: the flow [cm³/s].
        E: E, in all [erg/s].
        eta: η, in all [erg/s].
        S: see `flow_lost_to_mesh`.
    """
    return (jnp.asarray(E) + S) / Q * (jnp.asarray(eta) - S) / (jnp.asarray(E) + eta)
