"""Generalised-α: one step in time of second order with chosen damping of high frequencies.

With ρ∞ the factor by which the highest frequency shrinks in a step::

    α_m = (3 − ρ∞)/(2 (1 + ρ∞)),  α_f = 1/(1 + ρ∞),  γ = ½ + α_m − α_f,  β = (1 + α_m − α_f)²/4
    u⁺ = u + Δt ((1 − γ) a + γ a⁺)
    d⁺ = d + Δt u + Δt² ((½ − β) a + β a⁺)

and the equations hold for u, d, p at t + α_f Δt and a at t + α_m Δt.

Source: Jansen, Whiting & Hulbert 2000, eqs. 13-24; Bazilevs et al. 2008, eqs. 75-87.
"""

from typing import NamedTuple

from jaxtyping import Array, Float

from lumped.parameters import Parameter

Field = Float[Array, "3 nodes"]


class GeneralizedAlpha(NamedTuple):
    """Coefficients of the method.

    Attributes:
        alpha_m: where the acceleration is taken.
        alpha_f: where everything else is taken.
        gamma: weight of the new acceleration in the velocity.
        beta: weight of the new acceleration in the displacement.
    """

    alpha_m: float
    alpha_f: float
    gamma: float
    beta: float

    def acceleration(self, dt: Parameter, u: Field, a: Field, u_new: Field) -> Field:
        """Acceleration at the end of a step that changes u to u_new [cm/s²]."""
        return (u_new - u) / (self.gamma * dt) - (1.0 - self.gamma) / self.gamma * a

    def displacement(self, dt: Parameter, d: Field, u: Field, a: Field, a_new: Field) -> Field:
        """Displacement at the end of a step [cm]."""
        return d + dt * u + dt**2 * ((0.5 - self.beta) * a + self.beta * a_new)

    def weights(self, dt: Parameter) -> tuple[Parameter, Parameter, Parameter]:
        """Derivatives of the a, u and d in the equations with respect to the new velocity."""
        per_dt = 1.0 / (self.gamma * dt)
        return (
            self.alpha_m * per_dt,
            self.alpha_f,
            self.alpha_f * self.beta * dt**2 * per_dt,
        )


def generalized_alpha(rho_infinity: float = 0.5) -> GeneralizedAlpha:
    """Coefficients for a damping ρ∞ in [0, 1].

    Raises:
        ValueError: ρ∞ is out of range.
    """
    if not 0.0 <= rho_infinity <= 1.0:
        raise ValueError(
            f"rho_infinity = {rho_infinity} is not between 0 and 1; 0.5 is usual, 1 damps nothing."
        )
    alpha_m = (3.0 - rho_infinity) / (2.0 * (1.0 + rho_infinity))
    alpha_f = 1.0 / (1.0 + rho_infinity)
    return GeneralizedAlpha(
        alpha_m,
        alpha_f,
        0.5 + alpha_m - alpha_f,
        (1.0 + alpha_m - alpha_f) ** 2 / 4.0,
    )
