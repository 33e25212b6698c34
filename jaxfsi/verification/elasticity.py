"""Elastic materials as examples, and their stored energies.

`MATERIALS` drives the generic tests: a new material is tested by adding a line there and its
energy to `ENERGIES`.

With C = FᵀF, E = (C − I)/2, ε = sym(F − I), J = det F::

    linear                 W = λ/2 tr(ε)² + G ε:ε
    St. Venant-Kirchhoff   W = λ/2 tr(E)² + G E:E + κ_p/2 ((J² − 1)/2 − ln J)
    neo-Hookean            W = G/2 (J^(−2/3) tr C − 3) + κ/2 ((J² − 1)/2 − ln J)

Source: Bonet & Wood 2008, sections 6.4-6.5; Simo & Taylor 1991 for the volumetric part.
"""

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxfsi.core.laws.materials import (
    AbstractMaterial,
    LinearElastic,
    NeoHookean,
    SaintVenantKirchhoff,
)

YOUNG = 3e6
"""Young's modulus of the examples [dyn/cm²]."""

POISSON = 0.3
"""Poisson's ratio of the examples."""

MATERIALS: dict[str, AbstractMaterial] = {
    "linear": LinearElastic(YOUNG, POISSON),
    "st_venant_kirchhoff": SaintVenantKirchhoff(YOUNG, POISSON),
    "st_venant_kirchhoff_with_penalty": SaintVenantKirchhoff(YOUNG, POISSON, 2.5e6),
    "neo_hookean": NeoHookean(YOUNG, POISSON),
    "neo_hookean_nearly_incompressible": NeoHookean(YOUNG, 0.49),
}
"""Examples: an artery at the moduli of the tube wave."""


def _linear(m: LinearElastic, F: Float[Array, "3 3"]) -> Float[Array, ""]:
    lam = m.E * m.nu / ((1.0 + m.nu) * (1.0 - 2.0 * m.nu))
    G = m.E / (2.0 * (1.0 + m.nu))
    strain = (F + F.T) / 2.0 - jnp.eye(3)
    return lam / 2.0 * jnp.trace(strain) ** 2 + G * jnp.sum(strain**2)


def _volumetric(J: Float[Array, ""]) -> Float[Array, ""]:
    return (J**2 - 1.0) / 4.0 - jnp.log(J) / 2.0


def _st_venant_kirchhoff(m: SaintVenantKirchhoff, F: Float[Array, "3 3"]) -> Float[Array, ""]:
    lam = m.E * m.nu / ((1.0 + m.nu) * (1.0 - 2.0 * m.nu))
    G = m.E / (2.0 * (1.0 + m.nu))
    green = (F.T @ F - jnp.eye(3)) / 2.0
    hooke = lam / 2.0 * jnp.trace(green) ** 2 + G * jnp.sum(green**2)
    return hooke + m.volumetric_penalty * _volumetric(jnp.linalg.det(F))


def _neo_hookean(m: NeoHookean, F: Float[Array, "3 3"]) -> Float[Array, ""]:
    J, G = jnp.linalg.det(F), m.E / (2.0 * (1.0 + m.nu))
    kappa = m.E / (3.0 * (1.0 - 2.0 * m.nu))
    return G / 2.0 * (J ** (-2.0 / 3.0) * jnp.sum(F**2) - 3.0) + kappa * _volumetric(J)


ENERGIES: dict[type[AbstractMaterial], Callable[..., Float[Array, ""]]] = {
    LinearElastic: _linear,
    SaintVenantKirchhoff: _st_venant_kirchhoff,
    NeoHookean: _neo_hookean,
}
"""Stored energy of each material, (material, F) → W [dyn/cm²]."""


def _half_square(q: Float[Array, " n"]) -> Float[Array, " n"]:
    return q**2 / 2.0


def _dilatation(q: Float[Array, " n"]) -> Float[Array, " n"]:
    return (q**2 - 1.0) / 4.0 - jnp.log(q) / 2.0


VOLUME_ENERGIES: dict[type[AbstractMaterial], tuple[Callable[..., Float[Array, " n"]], ...]] = {
    LinearElastic: (_half_square,),
    SaintVenantKirchhoff: (_half_square, _dilatation),
    NeoHookean: (_dilatation,),
}
"""Energy U(q) at unit modulus of each measure of the volume of each material."""
