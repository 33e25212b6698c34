"""Resistance of a lumen by a reduced law: ΔP = R0 Q + K Q|Q|, from its cross-sections alone.

The pressure drop from the aorta to the distal end of the lumen is, for a flow Q [cm³/s]::

    ΔP = R0 Q + ½ ρ Q² ( K_c / A_o² + K_d / A_n² + K_e (1/A_n − 1/A_d)² + 1/A_d² − 1/A_u² )
         viscous         contraction  development      expansion              velocity head

A_u, A_o, A_n, A_d: areas upstream (the aorta), of the ostium, of the narrowest cross-section and of
the distal end. Pressures are static, as a catheter measures them: the velocity head at
the distal end is part of the drop, that at the inlet is not.

Viscous part. Fully developed flow, R0 = ∫ μ/G ds, with the conductance of a cross-section

    G = A⁴ / (16 π² I_p),        for an ellipse π A³B³ / (4 (A² + B²)) with semi-axes A, B.

The ellipse is exact (White, Viscous Fluid Flow, chapter 3). For other shapes it is
Saint-Venant's approximation for torsion, carried over to ducts by Bahrami, Yovanovich and Culham
2006, J Fluids Eng 128:1036: the shape is replaced by the ellipse of the same area and the
same polar moment I_p. Measured against finite-element solutions of the Poisson problem on all 84
frames of a real anomalous coronary (rest and dobutamine, diastole and systole), the error is

    ellipse of the same area and      G, all frames    G, slit frames  sum of 1/G over a vessel
    polar moment (used here)          −0.7 .. +3.3 %   −0.7 .. +0.8 %  −0.6 .. +0.1 %
    ratio of principal moments        −0.0 .. +10 %    +0.5 .. +8.0 %  −4.2 .. −1.4 %
    ratio of calipers (Feret)         −0.5 .. +10 %    +0.1 .. +9.9 %  −3.0 .. −1.5 %
    perimeter                         −3.8 .. +5.9 %   −3.8 .. +5.9 %  −2.4 .. +0.6 %

(slit: ratio of principal axes above 3). An ellipse with the calipers themselves as axes errs by
−11 to +22 %.

Contraction. K_c = ζ (1 − A_o/A_u)^¾, ζ = 0.5 for a sharp edge flush with the wall (Idelchik,
Handbook of Hydraulic Resistance, chapters 3 and 4); `contraction_coefficient` gives ζ for an
oblique take-off.

Development. The flat profile of the entrance turns parabolic and loses more than developed flow.
With the viscous drop Λ = R0 Q/(½ ρ Q²/A_n²) of the vessel, in velocity heads of its narrowest
section, Muzychka and Yovanovich 2009, J Fluids Eng 131:111105, join the short-duct limit and
developed flow, for any shape, as

    K_d = √(Λ² + E²) − Λ,   E² = 3.44² ζ⁺ P²/A_n,   ζ⁺ = μ L/(ρ Q),

P the perimeter there and L the length of narrowest section that has the same resistance as the
vessel. K_d includes the growth of kinetic energy of the profile. It falls slowly with Q; the law
has constant coefficients, so K_d is taken at `Q_reference`.

Expansion. Borda-Carnot, K_e = 1: the jet from the narrowest section mixes out before the distal
end. Without any recovery of pressure K_e = (A_d + A_n)/(A_d − A_n). Young and Tsai 1973, J Biomech
6:395, fit K_e = 1.52 to blunt stenoses with contraction, development and expansion in one; use
that with ``K_contraction=0, development=0`` for their law.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jaxfsi import Lumen
from lumped.parameters import is_traced, nan_unless, numbers_in_range
from lumped.units import ML_PER_MIN

_SHORT_DUCT = 3.44
"""Shapiro, Siegel and Kline 1954: apparent friction of a flat profile, f Re = 3.44/√x⁺."""

Q_REFERENCE = 100.0 * ML_PER_MIN
"""Flow at which the development loss is taken [cm³/s]: between rest and hyperaemia of an adult
right coronary. Half or twice that flow moves K by less than a tenth on a real patient."""


def _as_float(x: ArrayLike) -> Array:
    return jnp.asarray(x, dtype=float)


def _safe_sqrt(x: Float[Array, "*t"]) -> Float[Array, "*t"]:
    """Square root of x ≥ 0 whose derivative at 0 is 0 instead of infinite."""
    return jnp.where(x > 0.0, jnp.sqrt(jnp.where(x > 0.0, x, 1.0)), 0.0)


class PressureFlowLaw(eqx.Module):
    """ΔP = R0 Q + K Q|Q|, a resistance that grows with flow.

    Both coefficients are differentiated. They are not negative and not both zero, but for a small
    negative K where a lumen widens. The methods take one law; a batch of laws goes through
    `jax.vmap`. Traced coefficients outside their range give NaN.

    Attributes:
        R0: resistance at zero flow [dyn·s/cm⁵].
        K: quadratic coefficient [dyn·s²/cm⁸].
    """

    R0: Float[Array, "*batch"] = eqx.field(converter=_as_float)
    K: Float[Array, "*batch"] = eqx.field(converter=_as_float)

    def __check_init__(self):
        if is_traced(self.R0, self.K):
            return
        R0, K = np.asarray(self.R0), np.asarray(self.K)
        finite = np.isfinite(R0) & np.isfinite(K)
        if not np.all(finite & (R0 >= 0.0) & ((R0 > 0.0) | (K > 0.0))):
            raise ValueError(
                f"The law R0 = {R0} dyn·s/cm⁵, K = {K} dyn·s²/cm⁸ is that of no artery: R0 must "
                "not be negative, and one of the two positive. Check the signs of flow and drop."
            )

    def pressure_drop(self, Q: Float[ArrayLike, "*t"]) -> Float[Array, "*t"]:
        """Pressure drop at a flow Q [cm³/s], in dyn/cm²; odd in Q."""
        Q = _as_float(Q)
        return self.R0 * Q + self.K * Q * jnp.abs(Q)

    def tangent(self, dP: Float[ArrayLike, "*t"]) -> Float[Array, "*t"]:
        """Slope dΔP/dQ at a pressure drop dP [dyn/cm²], in dyn·s/cm⁵.

        R0 + 2 K|Q| = √(R0² + 4 K|ΔP|). At 40 mmHg it is the resistance of the linear law of Puelz
        et al. (arXiv 2405.01703); at a resting drop of a few mmHg it overstates the resistance.
        """
        square = self.R0**2 + 4.0 * self.K * jnp.abs(_as_float(dP))
        lawful = (self.R0 >= 0.0) & ((self.R0 > 0.0) | (self.K > 0.0)) & (square >= 0.0)
        return _safe_sqrt(square) * nan_unless(lawful)

    def secant(self, dP: Float[ArrayLike, "*t"]) -> Float[Array, "*t"]:
        """Resistance ΔP/Q at a pressure drop dP [dyn/cm²], in dyn·s/cm⁵; R0 at dP = 0."""
        return (self.R0 + self.tangent(dP)) / 2.0

    def flow(self, dP: Float[ArrayLike, "*t"]) -> Float[Array, "*t"]:
        """Flow at a pressure drop dP [dyn/cm²], in cm³/s; odd in dP.

        The root of the quadratic with the sum in its denominator loses no digits at small dP.
        """
        resistance = self.secant(dP)
        blocked = resistance == 0.0  # a purely quadratic law at no drop
        return jnp.where(blocked, 0.0, _as_float(dP) / jnp.where(blocked, 1.0, resistance))


class LumenLosses(eqx.Module):
    """The parts of the pressure drop over a lumen.

    Attributes:
        a_frames: share of each cross-section in the viscous resistance [dyn·s/cm⁵]; it shows
            where along s the resistance sits and sums to R0.
        b_contraction: sudden contraction from the aorta into the ostium [dyn·s²/cm⁸].
        b_development: development of the velocity profile [dyn·s²/cm⁸].
        b_expansion: expansion behind the narrowest cross-section [dyn·s²/cm⁸].
        b_head: velocity head at the distal end less that upstream [dyn·s²/cm⁸]; negative where
            the lumen ends wider than it begins.
        s_narrowest: position of the narrowest cross-section [cm].
    """

    a_frames: Float[Array, " frames"]
    b_contraction: Float[Array, ""]
    b_development: Float[Array, ""]
    b_expansion: Float[Array, ""]
    b_head: Float[Array, ""]
    s_narrowest: Float[Array, ""]

    @property
    def a_viscous(self) -> Float[Array, ""]:
        """Resistance of fully developed flow [dyn·s/cm⁵]."""
        return jnp.sum(self.a_frames)

    @property
    def b_entrance(self) -> Float[Array, ""]:
        """Loss at the entrance, contraction and development [dyn·s²/cm⁸]."""
        return self.b_contraction + self.b_development

    @property
    def law(self) -> PressureFlowLaw:
        """The sum of all parts."""
        return PressureFlowLaw(
            R0=self.a_viscous, K=self.b_entrance + self.b_expansion + self.b_head
        )


def conductance(lumen: Lumen) -> Float[Array, " frames"]:
    """Conductance G of fully developed flow, Q = (G/μ) (−dP/ds), of each cross-section [cm⁴].

    G = A⁴ / (16 π² I_p) (Bahrami et al. 2006; exact for an ellipse).
    """
    return lumen.area**4 / (16.0 * jnp.pi**2 * lumen.polar_moment)


def contraction_coefficient(take_off_angle: Float[ArrayLike, ""]) -> Float[Array, ""]:
    """Loss coefficient of a sharp-edged entrance at an angle to the wall [-].

    ζ = 0.5 + 0.3 cos δ + 0.2 cos² δ (Weisbach; Idelchik, Handbook of Hydraulic Resistance,
    chapter 3): 0.5 for a perpendicular take-off, up to 1 for one that runs along the wall.

    Args:
        take_off_angle: δ between the vessel and the wall of the aorta [rad], 0..π/2.

    Returns:
        ζ; NaN where a traced angle lies outside its range.

    Raises:
        ValueError: the angle lies outside its range.
    """
    angle = _as_float(take_off_angle)
    inside = (angle >= 0.0) & (angle <= np.pi / 2.0 + 1e-9)
    if not is_traced(angle) and not np.all(inside):
        raise ValueError(
            f"A take-off angle of {angle} rad must lie from 0 (along the wall) to π/2. Is it in "
            "degrees?"
        )
    cosine = jnp.cos(angle)
    return (0.5 + 0.3 * cosine + 0.2 * cosine**2) * nan_unless(inside)


def viscous_resistance(lumen: Lumen, *, mu: Float[ArrayLike, ""]) -> Float[Array, " frames"]:
    """Viscous resistance attributed to each cross-section [dyn·s/cm⁵].

    Trapezoidal rule for ∫ μ/G ds: a cross-section counts for half the way to its neighbours.

    Args:
        lumen: cross-sections.
        mu: viscosity of blood [P].
    """
    ds = jnp.diff(lumen.s)
    weights = (jnp.pad(ds, (1, 0)) + jnp.pad(ds, (0, 1))) / 2.0
    return _as_float(mu) * weights / conductance(lumen)


def _contraction(
    area: Float[Array, ""], area_upstream: Float[Array, ""], K: Float[Array, ""]
) -> Float[Array, ""]:
    # Times the inverse: the quotient by an infinite area has no finite derivative.
    blocked = 1.0 - area * (1.0 / area_upstream)
    narrows = blocked > 0.0
    share = jnp.where(narrows, jnp.where(narrows, blocked, 1.0) ** 0.75, 0.0)
    return K * share / area**2


def lumen_losses(
    lumen: Lumen,
    *,
    mu: Float[ArrayLike, ""],
    rho: Float[ArrayLike, ""],
    Q_reference: Float[ArrayLike, ""] = Q_REFERENCE,
    area_upstream: Float[ArrayLike, ""] = float("inf"),
    K_contraction: Float[ArrayLike, ""] = 0.5,
    K_expansion: Float[ArrayLike, ""] = 1.0,
    development: Float[ArrayLike, ""] = 1.0,
) -> LumenLosses:
    """The parts of the pressure drop over a lumen, see the equations of this module.

    Everything but the choice of the narrowest cross-section is differentiated.

    Args:
        lumen: cross-sections from the ostium downstream, ending in the distal reference.
        mu: viscosity of blood [P], 0.03..0.05.
        rho: density of blood [g/cm³].
        Q_reference: flow at which the development loss is taken [cm³/s], > 0.
        area_upstream: area upstream of the first cross-section [cm²]; infinite for the aorta.
        K_contraction: coefficient ζ of the contraction into the first cross-section [-].
        K_expansion: coefficient K_e of the expansion behind the narrowest cross-section [-].
        development: factor on the development loss [-]; 0 leaves it out.

    Returns:
        The parts; NaN where a traced number lies outside its range.

    Raises:
        ValueError: a number lies outside its range.
    """
    mu, rho, Q_reference, area_upstream = map(_as_float, (mu, rho, Q_reference, area_upstream))
    area = lumen.area
    above = {"mu [P]": mu, "rho [g/cm³]": rho, "Q_reference [cm³/s]": Q_reference}
    in_order = numbers_in_range(above={**above, "area of the lumen [cm²]": area})
    fits = (area_upstream > 0.0) & jnp.all(jnp.diff(lumen.s) > 0.0)
    if not is_traced(fits) and not bool(fits):
        raise ValueError(
            f"A lumen at s = {np.asarray(lumen.s)} cm behind an area of {area_upstream} cm² has no "
            "resistance: s must ascend and the area upstream be positive. Leave the area out for "
            "the aorta."
        )
    factor = nan_unless(jnp.all(in_order) & fits)
    mu, rho = mu * factor, rho * factor
    a_frames = viscous_resistance(lumen, mu=mu)
    a = jnp.sum(a_frames)
    n = jnp.argmin(area)
    area_n, area_distal = area[n], area[-1]
    dynamic = rho / 2.0

    length = a * conductance(lumen)[n] / mu
    viscous_heads = a * area_n**2 / (dynamic * Q_reference)
    short_duct = _SHORT_DUCT**2 * mu * length / (rho * Q_reference)
    short_duct = short_duct * lumen.perimeter[n] ** 2 / area_n
    K_development = _as_float(development) * (
        jnp.sqrt(viscous_heads**2 + short_duct) - viscous_heads
    )

    return LumenLosses(
        a_frames=a_frames,
        b_contraction=dynamic * _contraction(area[0], area_upstream, _as_float(K_contraction)),
        b_development=dynamic * K_development / area_n**2,
        b_expansion=dynamic * _as_float(K_expansion) * (1.0 / area_n - 1.0 / area_distal) ** 2,
        b_head=dynamic * (1.0 / area_distal**2 - (1.0 / area_upstream) ** 2),
        s_narrowest=lumen.s[n],
    )


def lumen_law(
    lumen: Lumen,
    *,
    mu: Float[ArrayLike, ""],
    rho: Float[ArrayLike, ""],
    Q_reference: Float[ArrayLike, ""] = Q_REFERENCE,
    area_upstream: Float[ArrayLike, ""] = float("inf"),
    K_contraction: Float[ArrayLike, ""] = 0.5,
    K_expansion: Float[ArrayLike, ""] = 1.0,
    development: Float[ArrayLike, ""] = 1.0,
) -> PressureFlowLaw:
    """Pressure-flow law of a lumen; arguments as in `lumen_losses`."""
    return lumen_losses(
        lumen,
        mu=mu,
        rho=rho,
        Q_reference=Q_reference,
        area_upstream=area_upstream,
        K_contraction=K_contraction,
        K_expansion=K_expansion,
        development=development,
    ).law
