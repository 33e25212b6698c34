"""Oscillating flow in rigid and elastic tubes: profile, impedance and wave speed in closed form.

With Λ = i^(3/2) α, α = R √(ωρ/μ), F = 2 J₁(Λ)/(Λ J₀(Λ)) and everything ∝ e^(iωt − ikz)::

    w(r) = −∂p/∂z/(iωρ) (1 − J₀(Λ r/R)/J₀(Λ)),    Q = −∂p/∂z π R²/(iωρ) (1 − F)

In an elastic tube of inner radius R, outer radius b and ν = 0 stresses along and around the wall do
not depend on each other, so that it does not matter how its ends are held. Its compliance is
Lamé's, not that of a membrane, and the blood drags it along::

    k²/ω² = ρ C'/(πR²)/(1 − F + F g),     g = (ρRF/2)/(ρ_s h' − E h' k²/ω² + ρRF/2)
    C' = 2πR/(1/S − ρ_s h' ω²),  S = R (b² + R²)/(E (b² − R²)),  h' = (b² − R²)/(2R)

g is the velocity of the wall over that of the blood without friction. The inviscid limit is the
speed of Moens and Korteweg for a thick wall, c² = πR²/(ρC').

Source: Womersley 1955, Phil. Mag. 46:199; Womersley 1957, WADC TR 56-614, and Cox 1968, Biophys. J.
8:691 (thick walls), here for ν = 0.
"""

import numpy as np
from jaxtyping import Complex, Float
from scipy.special import jve


def womersley_number(radius: float, omega: float, rho: float, mu: float) -> float:
    """α = R √(ωρ/μ)."""
    return float(radius * np.sqrt(omega * rho / mu))


def friction_factor(alpha: float) -> complex:
    """F = 2 J₁(Λ)/(Λ J₀(Λ)): the share of the flow that friction takes away."""
    argument = 1j**1.5 * alpha
    return complex(2.0 * jve(1, argument) / (argument * jve(0, argument)))


def velocity_shape(
    r: Float[np.ndarray, " points"], radius: float, alpha: float
) -> Complex[np.ndarray, " points"]:
    """1 − J₀(Λ r/R)/J₀(Λ) at distances r from the axis [cm]."""
    argument, share = 1j**1.5 * alpha, np.asarray(r) / radius
    # Scaled by exp(−|Im|), so that large arguments do not overflow.
    decay = np.exp(abs(argument.imag) * (share - 1.0))
    return 1.0 - decay * jve(0, argument * share) / jve(0, argument)


def impedance_per_length(radius: float, omega: float, rho: float, mu: float) -> complex:
    """−(∂p/∂z)/Q of a rigid tube [dyn·s/cm⁶]."""
    F = friction_factor(womersley_number(radius, omega, rho, mu))
    return 1j * omega * rho / (np.pi * radius**2 * (1.0 - F))


def static_compliance(radius: float, thickness: float, E: float) -> float:
    """S: displacement of the inner wall a pressure at ν = 0 [cm³/dyn] (Lamé)."""
    inner, outer = radius**2, (radius + thickness) ** 2
    return radius * (outer + inner) / (E * (outer - inner))


def wave_number(
    omega: float,
    *,
    radius: float,
    thickness: float,
    E: float,
    rho_s: float,
    rho_f: float,
    mu: float,
) -> complex:
    """K of pressure waves in an elastic tube with ν = 0 [1/cm]; its speed is ω/Re k.

    Args:
        omega: angular frequency [rad/s].
        radius: of the lumen [cm].
        thickness: of the wall [cm].
        E: Young's modulus of the wall [dyn/cm²].
        rho_s: its density [g/cm³].
        rho_f: density of the blood [g/cm³].
        mu: viscosity of the blood [g/(cm·s)].
    """
    h = ((radius + thickness) ** 2 - radius**2) / (2.0 * radius)
    S = static_compliance(radius, thickness, E)
    per_length = 2.0 * np.pi * radius / (1.0 / S - rho_s * h * omega**2)
    F = friction_factor(womersley_number(radius, omega, rho_f, mu))
    drag = rho_f * radius * F / 2.0
    slowness_square = rho_f * per_length / (np.pi * radius**2) / (1.0 - F)
    for _ in range(50):  # a contraction: the wall hardly moves along
        g = drag / (rho_s * h - E * h * slowness_square + drag)
        slowness_square = rho_f * per_length / (np.pi * radius**2) / (1.0 - F + F * g)
    return complex(omega * np.sqrt(slowness_square))
