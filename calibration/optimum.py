"""What a fit returns: the optimum, its uncertainty, and what the data determine."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float, Int

from calibration.free_parameter import FreeParameter
from calibration.identifiability import Identifiability

Data = Callable[[Any], Float[Array, " k"]]
"""A function of the model that returns residuals in units of their standard deviation."""


class PlainFunction(eqx.Module):
    """A Python function as data, kept static so that results pass through `jax.jit`."""

    function: Callable[[Any], Array] = eqx.field(static=True)

    def __call__(self, model: Any) -> Array:
        """The function's residuals."""
        return self.function(model)


class FitArrays(eqx.Module):
    """The arrays of a fit; see `Fit`."""

    u: Float[Array, "*b n"]
    values: Float[Array, "*b n"]
    slope: Float[Array, "*b n"]
    residual: Float[Array, "*b k"]
    prior_residual: Float[Array, "*b n"]
    jacobian: Float[Array, "*b k n"]
    prior_jacobian: Float[Array, "*b n n"]
    covariance_scaled: Float[Array, "*b n n"]
    at_bound: Int[Array, "*b n"]
    identifiability: Identifiability
    start_costs: Float[Array, "*b s"]
    iterations: Int[Array, "*b"]
    result: optx.RESULTS


class Fit(eqx.Module):
    """An optimum with its uncertainty. Fits of a batch carry a leading axis.

    Scaled variables are log x for scale "log" and x/size for "linear".

    Attributes:
        model: the model at the optimum.
        free: the parameters that were fitted.
        data: the experiments.
        outcome: all arrays; the fields below are read from it.
        solver: the solver that was used, None for the default.

    Properties:
        values: the optimum [units of the parameters].
        residual: data residuals in units of sd; chi2 is their sum of squares.
        covariance: of the values (delta method); `covariance_scaled` of the scaled variables.
            Parameters at a bound are held: their rows are zero. Undetermined ones have infinity.
        jacobian: ∂residual/∂(scaled variables), data only.
        identifiability: what the data alone determine, priors and bounds apart.
        at_bound: −1 or +1 for parameters that ended at their lower or upper bound, else 0.
        start_costs: chi2 + prior reached from each start; infinite where the solver failed.
        result: `optimistix.RESULTS`.
    """

    model: Any
    free: tuple[FreeParameter, ...]
    data: tuple[Data, ...]
    outcome: FitArrays
    solver: Any = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters, in order."""
        return tuple(parameter.name for parameter in self.free)

    @property
    def values(self) -> Float[Array, "*b n"]:
        """The optimum [units of the parameters]."""
        return self.outcome.values

    @property
    def residual(self) -> Float[Array, "*b k"]:
        """Data residuals in units of their standard deviation."""
        return self.outcome.residual

    @property
    def chi2(self) -> Float[Array, "*b"]:
        """Sum of squares of the data residuals."""
        return jnp.sum(self.outcome.residual**2, axis=-1)

    @property
    def cost(self) -> Float[Array, "*b"]:
        """Minimised cost: chi2 plus the squared residuals of the priors."""
        return self.chi2 + jnp.sum(self.outcome.prior_residual**2, axis=-1)

    @property
    def jacobian(self) -> Float[Array, "*b k n"]:
        """∂residual/∂(scaled variables), data only."""
        return self.outcome.jacobian

    @property
    def covariance_scaled(self) -> Float[Array, "*b n n"]:
        """Laplace covariance of the scaled variables, priors included."""
        return self.outcome.covariance_scaled

    @property
    def covariance(self) -> Float[Array, "*b n n"]:
        """Laplace covariance of the values, to first order."""
        slope = jax.lax.stop_gradient(self.outcome.slope)
        return self.covariance_scaled * slope[..., :, None] * slope[..., None, :]

    @property
    def sd_scaled(self) -> Float[Array, "*b n"]:
        """Standard deviations of the scaled variables: relative ones for scale "log"."""
        return jnp.sqrt(jnp.diagonal(self.covariance_scaled, axis1=-2, axis2=-1))

    @property
    def sd(self) -> Float[Array, "*b n"]:
        """Standard deviations of the values, to first order."""
        return self.sd_scaled * jnp.abs(jax.lax.stop_gradient(self.outcome.slope))

    @property
    def identifiability(self) -> Identifiability:
        """What the data alone determine."""
        return self.outcome.identifiability

    @property
    def at_bound(self) -> Int[Array, "*b n"]:
        """−1 or +1 for parameters at their lower or upper bound, else 0."""
        return self.outcome.at_bound

    @property
    def start_costs(self) -> Float[Array, "*b s"]:
        """Cost reached from each start."""
        return self.outcome.start_costs

    @property
    def iterations(self) -> Int[Array, "*b"]:
        """Steps of the solver, from the best start on."""
        return self.outcome.iterations

    @property
    def result(self) -> optx.RESULTS:
        """Successful, or the reason why not."""
        return self.outcome.result

    def interval(self, sds: float = 1.96) -> Float[Array, "*b n 2"]:
        """Values `sds` standard deviations of the scaled variable to either side."""
        width = sds * self.sd_scaled
        logarithmic = np.array([parameter.scale == "log" for parameter in self.free])
        ends = [
            jnp.where(
                logarithmic, self.values * jnp.exp(sign * width), self.values + sign * sds * self.sd
            )
            for sign in (-1.0, 1.0)
        ]
        return jnp.stack(ends, axis=-1)

    def messages(self) -> tuple[str, ...]:
        """Findings in plain words: bounds reached, what the data do not determine (one fit)."""
        lines = []
        for parameter, side, value in zip(self.free, self.at_bound, self.values, strict=True):
            if int(side) != 0:
                which = "upper" if int(side) > 0 else "lower"
                lines.append(
                    f"{parameter.name} ended at its {which} bound {float(value):.4g}: the data "
                    "push beyond. Widen the bound, or look for what the model lacks."
                )
        return (*lines, *self.identifiability.sentences())
