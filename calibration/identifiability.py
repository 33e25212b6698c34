"""Which combinations of parameters the data determine, and how well.

With the residuals r in units of their standard deviation and the scaled variables u (log x, or x
in units of its size) let J = ∂r/∂u = U S Vᵀ. Along the direction v_k of u-space the data fix the
parameters to ±1/s_k; where s_k = 0 they say nothing, and any multiple of v_k may be added. The
covariance of the Laplace approximation is (JᵀJ)⁻¹ = V S⁻² Vᵀ.

Source: Bard 1974, Nonlinear Parameter Estimation, chapter 7; the choice of reference parameters
is the pivoted elimination of Golub & Van Loan 2013, sec. 5.4.2.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from calibration.gauss_newton import RANK_TOLERANCE
from lumped import HaemodynamicCondition, Shooting, Surrogate, mean_state, pressure_ratio
from lumped.parameters import Parameter

PRESENT = 1e-6
"""Components of a unit direction below this size count as zero."""


class Identifiability(eqx.Module):
    """Parameters that data with a given whitened Jacobian determine.

    The arrays carry no derivatives: a singular value decomposition has none where two singular
    values meet. Differentiate the Jacobian itself instead.

    Attributes:
        names: the parameters (static).
        logarithmic: whether each is scaled by its logarithm (static).
        singular_values: of the Jacobian, descending, one for each parameter, shape (n,).
        directions: rows are the matching directions in scaled variables, shape (n, n).
        rank: number of combinations of parameters that the data determine.
        condition: largest over smallest singular value; infinite where rank < n.
        sd: standard deviation of each scaled variable, all free; infinite where undetermined.
        correlation: of the scaled variables; for undetermined ones that of the limit.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    logarithmic: tuple[bool, ...] = eqx.field(static=True)
    singular_values: Float[Array, " n"]
    directions: Float[Array, "n n"]
    rank: Int[Array, ""]
    condition: Float[Array, ""]
    sd: Float[Array, " n"]
    correlation: Float[Array, "n n"]

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of the parameters that the data alone do not determine."""
        return tuple(n for n, sd in zip(self.names, self.sd, strict=True) if np.isinf(sd))

    def sentences(self, weak: float = 1.0) -> tuple[str, ...]:
        """The findings in plain words (concrete values only, of a single fit).

        Args:
            weak: directions known to no better than this (in scaled variables: 1 is a factor of
                e) are called poorly determined.
        """
        n, rank = len(self.names), int(self.rank)
        directions = np.asarray(self.directions)
        spread = 1.0 / np.maximum(np.asarray(self.singular_values), 1e-300)
        if rank == n:
            lines = [f"The data determine all {n} parameters."]
        else:
            lines = [f"The data determine {rank} of {n} combinations of the parameters."]
        if 1 == rank < n and all(self.logarithmic):
            pivot = np.max(np.abs(directions[0]))
            product = self._product(directions[0])
            lines.append(
                f"Only {product} is determined, to {_factor(spread[0] / pivot)}; "
                "what leaves it unchanged leaves the data unchanged."
            )
        lines += self._undetermined_sentences(directions[:rank])
        for k in range(rank):
            if spread[k] > weak:
                product = self._product(directions[k])
                lines.append(f"Poorly determined: {product}, only to {_factor(spread[k])}.")
        correlation = np.asarray(self.correlation)
        for i in range(n):
            for j in range(i):
                alike = abs(correlation[i, j]) > 0.99
                if alike and np.isfinite(self.sd[i]) and np.isfinite(self.sd[j]):
                    pair = f"{self.names[j]} and {self.names[i]}"
                    lines.append(
                        f"{pair} can hardly be told apart (correlation {correlation[i, j]:.4f})."
                    )
        return tuple(lines)

    def _product(self, direction: np.ndarray) -> str:
        """A direction as a product of powers, the largest exponent being 1."""
        pivot = int(np.argmax(np.round(np.abs(direction), 9)))
        exponents = direction / direction[pivot]
        above = [_power(n, e) for n, e in zip(self.names, exponents, strict=True) if e > PRESENT]
        below = [_power(n, -e) for n, e in zip(self.names, exponents, strict=True) if e < -PRESENT]
        text = " · ".join(above)
        return text if not below else f"{text} / ({' · '.join(below)})"

    def _undetermined_sentences(self, determined: np.ndarray) -> list[str]:
        """One sentence for each parameter that others can compensate, or that has no effect."""
        references = _references(determined)
        lines = []
        for j, name in enumerate(self.names):
            if j in references or len(references) == len(self.names):
                continue
            share = np.zeros(0)
            if references:
                share = np.linalg.solve(determined[:, references], determined[:, j])
            parts = [
                f"{-c:+.3g} {self._percent(i)}"
                for i, c in zip(references, share, strict=True)
                if abs(c) > PRESENT
            ]
            if parts:
                lines.append(
                    f"{name} cannot be told from {_listed(self._named(references, share))}: "
                    f"+1 {self._percent(j)} is made up for by {_listed(parts)}."
                )
            else:
                lines.append(f"{name} has no effect on the data.")
        return lines

    def _percent(self, i: int) -> str:
        return f"% {'in' if self.logarithmic[i] else 'of its size in'} {self.names[i]}"

    def _named(self, references: list[int], share: np.ndarray) -> list[str]:
        chosen = zip(references, share, strict=True)
        return [self.names[i] for i, c in chosen if abs(c) > PRESENT]


def _listed(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def _power(name: str, exponent: float) -> str:
    return name if abs(exponent - 1.0) < 1e-6 else f"{name}^{exponent:.3g}"


def _factor(spread: float) -> str:
    """A standard deviation of a logarithm in words."""
    if spread < 0.2:
        return f"±{100 * spread:.2g} %"
    return f"a factor of {np.exp(min(spread, 700.0)):.2g}"


def _references(determined: np.ndarray) -> list[int]:
    """Parameters to express others by: pivots of the elimination of the determined directions."""
    rest = determined.copy()
    chosen: list[int] = []
    for _ in range(determined.shape[0]):
        size = np.round(np.linalg.norm(rest, axis=0), 9)
        pivot = int(np.argmax(size))
        column = rest[:, pivot] / np.linalg.norm(rest[:, pivot])
        rest = rest - np.outer(column, column @ rest)
        chosen.append(pivot)
    return sorted(chosen)


def identifiability(
    jacobian: Float[Array, "m n"],
    names: Sequence[str],
    *,
    logarithmic: Sequence[bool] | None = None,
) -> Identifiability:
    """Analyse which parameters data with this Jacobian determine.

    Args:
        jacobian: ∂(residual in units of sd)/∂(scaled variable), shape (m, n).
        names: the n parameters.
        logarithmic: whether each scaled variable is a logarithm; by default all are.
    """
    flags = (True,) * len(names) if logarithmic is None else tuple(logarithmic)
    s, V, determined = _decompose(jax.lax.stop_gradient(jacobian))
    _, sd = _covariance(s, V, determined)
    limit, _ = _covariance(jnp.maximum(s, RANK_TOLERANCE * s[0] + 1e-300), V, s >= 0.0)
    size = jnp.sqrt(jnp.diag(limit))
    smallest = jnp.where(determined[-1], s[-1], 1.0)
    return Identifiability(
        names=tuple(names),
        logarithmic=flags,
        singular_values=s,
        directions=V,
        rank=jnp.sum(determined),
        condition=jnp.where(determined[-1], s[0] / smallest, jnp.inf),
        sd=sd,
        correlation=limit / (size[:, None] * size[None, :]),
    )


def laplace_covariance(
    jacobian: Float[Array, "m n"], held: Bool[Array, " n"]
) -> Float[Array, "n n"]:
    """Covariance (JᵀJ)⁻¹ of the scaled variables, with some of them held.

    Held parameters get zeros. Undetermined ones get infinity on the diagonal; the other entries
    then belong to the determined directions. Nothing is NaN.

    Args:
        jacobian: ∂(residual and prior residual)/∂(scaled variable).
        held: parameters that do not vary, such as those at a bound.
    """
    J = jax.lax.stop_gradient(jacobian) * (1.0 - held.astype(float))[None, :]
    # a row of its own keeps a held parameter from counting as undetermined
    own = jnp.diag(held.astype(float)) * (jnp.max(jnp.abs(J)) + 1e-300)
    covariance, sd = _covariance(*_decompose(jnp.concatenate([J, own])))
    free = 1.0 - held.astype(float)
    covariance = jnp.where(jnp.diag(jnp.isinf(sd)), jnp.inf, covariance)
    return jnp.where((free[:, None] * free[None, :]) > 0.0, covariance, 0.0)


def _decompose(
    jacobian: Float[Array, "m n"],
) -> tuple[Float[Array, " n"], Float[Array, "n n"], Bool[Array, " n"]]:
    """Singular values, directions (rows) and which are determined; a QR first, for tall ones."""
    n = jacobian.shape[1]
    finite = jnp.where(jnp.all(jnp.isfinite(jacobian)), jacobian, 0.0)
    padded = jnp.concatenate([finite, jnp.zeros((n, n))])
    _, s, V = jnp.linalg.svd(jnp.linalg.qr(padded, mode="r"))
    return s, V, (s > RANK_TOLERANCE * s[0]) & (s > 0.0)


def _covariance(
    s: Float[Array, " n"], V: Float[Array, "n n"], determined: Bool[Array, " n"]
) -> tuple[Float[Array, "n n"], Float[Array, " n"]]:
    """V S⁻² Vᵀ over the determined directions, and sd with infinity for undetermined ones."""
    inverse = jnp.where(determined, 1.0 / jnp.where(determined, s, 1.0), 0.0)
    rows = inverse[:, None] * V
    covariance = rows.T @ rows
    lost = jnp.any((jnp.abs(V) > PRESENT) & ~determined[:, None], axis=0)
    return covariance, jnp.where(lost, jnp.inf, jnp.sqrt(jnp.diag(covariance)))


class RatioIdentifiability(eqx.Module):
    """Which parameters of a surrogate the pressure ratio of one condition determines.

    Attributes:
        ratio: mean distal over mean aortic pressure [-].
        names: the parameters (static).
        sensitivities: d log(ratio)/d log(parameter) [-], shape (n,).
        identifiability: what the ratio determines; its rank is 1 at most.
    """

    ratio: Float[Array, ""]
    names: tuple[str, ...] = eqx.field(static=True)
    sensitivities: Float[Array, " n"]
    identifiability: Identifiability

    def sentences(self) -> tuple[str, ...]:
        """The findings in plain words (concrete values only)."""
        slope = dict(zip(self.names, np.asarray(self.sensitivities), strict=True))
        total = slope["R_1"] + slope["R_2"] + slope["R_3"]
        is_divider = np.allclose([slope["R0"], total], [-slope["alpha"], slope["alpha"]], atol=1e-9)
        lines = []
        if is_divider and abs(slope["alpha"]) > PRESENT:
            lines.append(
                "The ratio determines only alpha · R_total / R0 with R_total = R_1 + R_2 + R_3: "
                "R0, alpha and the shares of R_1, R_2, R_3 cannot be told apart."
            )
        silent = [name for name, value in slope.items() if abs(value) < PRESENT]
        if silent:
            verb = "has" if len(silent) == 1 else "have"
            lines.append(f"{_listed(silent)} {verb} no effect on it: measure waveforms for these.")
        return tuple(lines) if lines else self.identifiability.sentences()


RATIO_PARAMETERS = ("R0", "alpha", "R_1", "R_2", "R_3", "C_a", "C_im", "C0")


def ratio_identifiability(
    surrogate: Surrogate, condition: HaemodynamicCondition, sd: Parameter
) -> RatioIdentifiability:
    """Which of R0, alpha, R_1, R_2, R_3, C_a, C_im, C0 (and K) the pressure ratio determines.

    For the linear surrogate mean P_distal/mean P_aorta is a resistor divider: the Jacobian is
    one row with entries −(1 − ratio), +(1 − ratio), (1 − ratio) R_i/R_total and zeros.

    Args:
        surrogate: the patient's parameters.
        condition: where the ratio is measured.
        sd: standard deviation of the ratio [-].
    """
    linear = surrogate.K is None
    names = RATIO_PARAMETERS if linear else (*RATIO_PARAMETERS, "K")

    def leaves(model):
        bed = model.coronary
        own = [model.R0, model.alpha, bed.R_1, bed.R_2, bed.R_3, bed.C_a, bed.C_im, model.C0]
        return own if linear else [*own, model.K]

    def ratio(u):
        network = eqx.tree_at(
            leaves, surrogate, [value * jnp.exp(u[i]) for i, value in enumerate(leaves(surrogate))]
        ).network(condition)
        if not linear:
            return pressure_ratio(Shooting()(network, condition.period))
        mean = mean_state(network, condition.period)
        return mean[network.pressure_index("distal")] / mean[network.pressure_index("aorta")]

    value, slope = jax.jit(lambda u: (ratio(u), jax.jacfwd(ratio)(u)))(jnp.zeros(len(names)))
    return RatioIdentifiability(
        ratio=value,
        names=names,
        sensitivities=slope / value,
        identifiability=identifiability(slope[None, :] / sd, names),
    )
