"""Periodic states of linear networks: by harmonics, and by exact propagation."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import expm
from jaxtyping import Array, Float

from lumped.elimination import modulus_bound, solve_small
from lumped.harmonics import from_harmonics, to_harmonics
from lumped.march import aligned_times, march
from lumped.network import Network, jacobian
from lumped.parameters import Parameter, nan_unless
from lumped.periodic_solution import (
    AbstractPeriodicSolver,
    PeriodicSolution,
    checked_result,
    finite_or_singular,
    largest_difference,
    mean_start,
)
from lumped.results import RESULTS, is_successful
from lumped.statespace import StateSpace, state_space

SMALL = 6
"""Largest number of states for which unrolled elimination beats a library call a frequency."""


SQUARINGS = 48
"""Most squarings of a matrix exponential: time constants down to 10⁻¹⁵ of the step."""


class Fourier(AbstractPeriodicSolver):
    """Harmonics of a linear network, (i ω_k I − A) x̂_k = B v̂_k; the mean is exact.

    The fast choice for batches. Where sources have slope kinks the error falls only with the
    square of the number of samples; `error_estimate` is the sum of the upper half of the spectrum.

    Attributes:
        n_samples: samples a period (static), a multiple of 4.
        reduce: eliminate the algebraic unknowns first (static). False solves the full pencil
            (i ω M − H), which networks of index 2 need.
    """

    n_samples: int = eqx.field(static=True, default=256)
    reduce: bool = eqx.field(static=True, default=True)

    def __check_init__(self):
        if self.n_samples < 4 or self.n_samples % 4:
            raise ValueError(f"n_samples = {self.n_samples} must be a multiple of 4. Try 256.")

    @property
    def needs_index_one(self) -> bool:
        """Whether the algebraic unknowns are eliminated first."""
        return self.reduce

    def __call__(self, network: Network, period: Parameter) -> PeriodicSolution:
        """Find the periodic state.

        Raises:
            ValueError: the network is nonlinear or, with `reduce`, not of index 1.
        """
        t = jnp.arange(self.n_samples) / self.n_samples * period
        omega = 2.0 * jnp.pi / period * jnp.arange(self.n_samples // 2 + 1, dtype=float)
        mean = mean_start(network, period)
        first = (self.n_samples * mean).astype(complex)
        if self.reduce:
            system = state_space(network)
            v = system.sources(t)
            x_hat = _reduced_harmonics(system, omega, to_harmonics(v))
            x_hat = [x.at[0].set(first[i]) for i, x in enumerate(x_hat)]
            result, factor = _checked(network, period, mean, *x_hat)
            x_hat = [x * factor.astype(complex) for x in x_hat]
            x = [from_harmonics(row, self.n_samples) for row in x_hat]
            v = v if x else v * factor  # without states it alone decides the rows
            z = jnp.stack([*x, *_algebraic_rows(system, x, v)], axis=1)
            monodromy = expm(system.A * period, max_squarings=SQUARINGS)
        else:
            if not network.is_linear:
                raise ValueError("A network with a quadratic loss has no harmonics. Use Shooting.")
            zero = jnp.zeros(network.n_unknowns)
            h = jax.vmap(lambda s: network.residual(s, zero))(t)
            z_hat = _full_harmonics(network, omega, to_harmonics(h))
            z_hat = z_hat.at[0].set(first)
            result, factor = _checked(network, period, z_hat)
            z_hat = z_hat * factor.astype(complex)
            z = jax.vmap(from_harmonics, (1, None), 1)(z_hat, self.n_samples)
            x_hat = [z_hat[:, i] for i in range(network.n_states)]
            monodromy = _monodromy_by_march(network, period)
        return PeriodicSolution(
            t=t,
            z=z,
            mean=mean * factor,
            period=period,
            monodromy=monodromy * factor,
            error_estimate=_spectral_tail(x_hat, self.n_samples) * factor,
            iterations=jnp.asarray(1),
            result=result,
            network=network,
        )


def _reduced_harmonics(system: StateSpace, omega: Float[Array, " f"], v_hat: Array) -> list[Array]:
    """Solve (iω I − A) x̂ = B v̂ at all frequencies; a list of rows so that unused ones vanish."""
    n, k = system.B.shape
    if n == 0:
        return []
    real, imag = (
        [sum(system.B[i, j] * part[:, j] for j in range(k)) for i in range(n)]
        for part in (v_hat.real, v_hat.imag)
    )
    b = jax.lax.complex(jnp.stack(real), jnp.stack(imag))
    matrix = jax.lax.complex(
        jnp.broadcast_to(-system.A[:, :, None], (n, n, omega.shape[0])),
        jnp.eye(n)[:, :, None] * omega[None, None, :],
    )
    if n <= SMALL:
        return list(solve_small(matrix, b))
    solved = jnp.linalg.solve(jnp.moveaxis(matrix, 2, 0), jnp.moveaxis(b, 1, 0)[..., None])
    return list(jnp.moveaxis(solved[..., 0], 0, 1))


def _algebraic_rows(system: StateSpace, x: list[Array], v: Array) -> list[Array]:
    """W = C x + D h, row by row: unused rows are removed by the compiler."""
    a, k = system.D.shape
    return [
        sum((system.C[i, j] * x[j] for j in range(len(x))), jnp.zeros(v.shape[0]))
        + sum(system.D[i, j] * v[:, j] for j in range(k))
        for i in range(a)
    ]


def _full_harmonics(network: Network, omega: Float[Array, " f"], h_hat: Array) -> Array:
    n, m = network.n_states, network.n_unknowns
    H = jacobian(network, 0.0, jnp.zeros(m))
    M = jnp.zeros((m, m)).at[:n, :n].set(jnp.diag(network.mass()))
    pencil = jax.lax.complex(
        jnp.broadcast_to(-H, (omega.shape[0] - 1, m, m)), omega[1:, None, None] * M[None]
    )
    solved = jnp.linalg.solve(pencil, h_hat[1:, :, None])[..., 0]
    return jnp.concatenate([jnp.zeros_like(solved[:1]), solved])


def _monodromy_by_march(network: Network, period: Parameter) -> Float[Array, "n n"]:
    n = network.n_states
    ts = aligned_times(network, period, 128)

    def cycle(x):
        z0 = jnp.concatenate([x, jnp.zeros(network.n_unknowns - n)])
        return march(ts, network, z0).z[-1, :n]

    return jax.jacfwd(cycle)(jnp.zeros(n))


def _spectral_tail(x_hat: list[Array], n_samples: int) -> Float[Array, ""]:
    """Sum of the upper half of the spectrum over the largest possible value, worst state."""
    worst = jnp.zeros(())
    for row in x_hat:
        size = modulus_bound(row)
        half = row.shape[0] // 2
        worst = jnp.maximum(worst, jnp.sum(size[half:]) / (jnp.sum(size) + 1e-300))
    return worst


class Propagator(AbstractPeriodicSolver):
    """Exact propagation of a linear network with its sources interpolated between breakpoints.

    Over a step of length h, with B v(t) interpolated at q Gauss nodes c_j,

        x(t + h) = exp(A h) x(t) + Σ_j W_j B v(t + c_j h),
        W_j = ∫₀ʰ exp(A (h − s)) ℓ_j(s) ds = h Σ_m φ_{m+1}(A h) (V⁻¹)_{mj},

    and the periodic start solves (I − Φ) x₀ = (state after a cycle from rest). No stability limit,
    no kink error: the accuracy reference.

    Source of the φ functions: Hochbruck & Ostermann 2010 (Acta Numerica 19:209), sec. 2.1;
    the augmented exponential: Al-Mohy & Higham 2011 (SIAM J Sci Comput 33:488), theorem 2.1.

    Attributes:
        n_steps: least number of steps a period (static).
    """

    n_steps: int = eqx.field(static=True, default=512)

    def __check_init__(self):
        if self.n_steps < 1:
            raise ValueError(f"n_steps = {self.n_steps} must be positive. Try 512.")

    @property
    def needs_index_one(self) -> bool:
        """True: it propagates the states alone."""
        return True

    def __call__(self, network: Network, period: Parameter) -> PeriodicSolution:
        """Find the periodic state.

        Raises:
            ValueError: the network is nonlinear or not of index 1.
        """
        system = state_space(network)
        ts = aligned_times(network, period, self.n_steps, grading=0.0)
        stretches = network.breakpoints(period).shape[0] - 1
        x, monodromy = _propagate(system, ts, stretches)
        coarse, _ = _propagate(system, ts[::2], stretches)
        v = system.sources(ts[:-1])
        columns = [x[:-1, i] for i in range(x.shape[1])]
        z = jnp.stack([*columns, *_algebraic_rows(system, columns, v)], axis=1)
        mean = mean_start(network, period)
        result, factor = _checked(network, period, mean, x)
        return PeriodicSolution(
            t=ts[:-1],
            z=z * factor,
            mean=mean * factor,
            period=period,
            monodromy=monodromy * factor,
            error_estimate=largest_difference(coarse, x[::2], x) * factor,
            iterations=jnp.asarray(1),
            result=result,
            network=network,
        )


def _checked(network: Network, period: Parameter, *parts: Array) -> tuple[RESULTS, Array]:
    """Result code of a direct solution, and a factor for it: NaN if it failed.

    The factor multiplies the few numbers that decide the others: unused rows stay unused.
    """
    result = checked_result(network, period, finite_or_singular(*parts))
    return result, nan_unless(is_successful(result))


_NODES = 8


def _propagate(
    system: StateSpace, ts: Float[Array, " k1"], stretches: int
) -> tuple[Float[Array, "k1 n"], Float[Array, "n n"]]:
    """Periodic states at the step ends, and the monodromy matrix."""
    n = system.A.shape[0]
    if n == 0:
        return jnp.zeros((ts.shape[0], 0)), jnp.zeros((0, 0))
    each = (ts.shape[0] - 1) // stretches
    starts = ts[:-1].reshape(stretches, each)
    dt = (ts[1:] - ts[:-1]).reshape(stretches, each)[:, 0]
    nodes = 0.5 * (1.0 + np.polynomial.legendre.leggauss(_NODES)[0])
    # one after another: under vmap every exponential would take all its squarings
    Phi, W = jax.lax.map(lambda h: _step_matrices(system.A, h, nodes), dt)
    at = (starts[..., None] + dt[:, None, None] * jnp.asarray(nodes)[None, None]).reshape(-1)
    u = (system.sources(at) @ system.B.T).reshape(stretches, each, _NODES, n)
    push = jnp.einsum("sjab,skjb->ska", W, u).reshape(-1, n)
    which = jnp.repeat(jnp.arange(stretches), each)

    def body(x, inputs):
        s, forcing = inputs
        x = Phi[s] @ x + forcing
        return x, x

    def homogeneous(X, s):
        return Phi[s] @ X, None

    from_rest, _ = jax.lax.scan(body, jnp.zeros(n), (which, push))
    monodromy, _ = jax.lax.scan(homogeneous, jnp.eye(n), which)
    x0 = jnp.linalg.solve(jnp.eye(n) - monodromy, from_rest)
    _, x = jax.lax.scan(body, x0, (which, push))
    return jnp.concatenate([x0[None], x]), monodromy


def _step_matrices(
    A: Float[Array, "n n"], h: Array, nodes: np.ndarray
) -> tuple[Float[Array, "n n"], Float[Array, "q n n"]]:
    """exp(A h) and the weights W_j of the forcing at the nodes."""
    n, q = A.shape[0], nodes.shape[0]
    augmented = jnp.zeros((n * (q + 1), n * (q + 1)))
    augmented = augmented.at[:n, :n].set(A * h)
    for m in range(q):
        block = slice(m * n, (m + 1) * n), slice((m + 1) * n, (m + 2) * n)
        augmented = augmented.at[block].set(jnp.eye(n))
    top = expm(augmented, max_squarings=SQUARINGS)[:n]
    phi = top[:, n:].reshape(n, q, n).transpose(1, 0, 2)
    factorials = np.cumprod(np.concatenate([[1.0], np.arange(1.0, q)]))
    V = np.vander(nodes, q, increasing=True) / factorials
    weights = jnp.asarray(np.linalg.inv(V))
    return top[:, :n], h * jnp.einsum("mj,mab->jab", weights, phi)
