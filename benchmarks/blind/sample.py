"""Probabilities checked by importance sampling, without the linear-Gaussian approximation.

Draws come from a Student t about each optimum with the covariance found there. With weights
w = likelihood × prior / density of the draw, the mean weight is the evidence, for any shape of the
posterior; the effective number Σ(w)²/Σ(w²) says how far it can be trusted. The prior is the moment
prior itself and one-sided sizes are positive; the form tolerance is that of the optimum.

Source: Robert & Casella 2004, Monte Carlo Statistical Methods, section 3.3.
"""

import pathlib
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import gammaln, logsumexp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from benchmarks.blind.diagnoses import diagnoses_of
from diagnosis import CATALOGUE, Diagnosis, Effect
from diagnosis.form_columns import KINDS, Freedom
from diagnosis.hypothesis import (
    Catalogue,
    numbers_of,
    of_kind,
    places_of,
    sensor_model,
    uncertain_signals,
)
from diagnosis.measured import Measured, Whitener, data_of, whitener_of
from diagnosis.prediction import ConditionSettings, condition_settings, observations, selection
from diagnosis.verdict import PRIOR, Hypothesis, key_of

DRAWS, CHUNK = 4096, 256
FREEDOM, WIDTH = 6.0, 1.15
"""Degrees of freedom of the draws, and their width over the posterior's."""

SHOWN = 3
"""Hypotheses compared in each record, the likeliest ones."""


@partial(jax.jit, static_argnames=("effects", "nonlinear"))
def _freedoms(
    record: Measured,
    effects: tuple[Effect, ...],
    numbers: Catalogue,
    pair: Int[Array, " 2"],
    x: Float[Array, " k"],
    *,
    nonlinear: bool,
) -> Freedom:
    """Freedom of every kind of equations."""
    own = uncertain_signals(record, effects, numbers, pair, x, nonlinear=nonlinear)
    freedoms = own.freedoms(whitener_of(record))
    return jax.vmap(partial(of_kind, freedoms))(jnp.arange(len(KINDS)))


@partial(jax.jit, static_argnames=("effects", "nonlinear"))
def _sampled(
    record: Measured,
    pair: Int[Array, " 2"],
    x: Float[Array, " k"],
    numbers: Catalogue,
    key: PRNGKeyArray,
    whitener: Float[Array, "n n"],
    *,
    effects: tuple[Effect, ...],
    nonlinear: bool,
) -> tuple[Array, Array]:
    """Ln Z of a hypothesis up to `whitener`'s determinant, and the effective number of draws."""
    W, data, cases = whitener_of(record), data_of(record), condition_settings(record)
    chooser = jnp.asarray(selection(record.n_conditions, 2))
    predicted = sensor_model(effects, numbers, pair, nonlinear=nonlinear)

    def residual(x: Array) -> Array:
        """Residuals in units of noise and form tolerance together."""

        def one(W: Whitener, data: Array, case: ConditionSettings, own: Array) -> Array:
            return W(data - observations(predicted(case, own), record.n_sensors))

        return whitener @ jax.vmap(one)(W, data, cases, chooser @ x).reshape(-1)

    k = x.shape[0]
    J = jax.jacfwd(residual)(x)
    precision = jnp.eye(k) + J.T @ J
    root = jnp.linalg.cholesky(precision)
    a, b = jax.random.split(key)
    z = jax.random.normal(a, (DRAWS, k))
    stretch = WIDTH * jnp.sqrt(FREEDOM / jax.random.chisquare(b, FREEDOM, (DRAWS, 1)))
    step = stretch * jax.scipy.linalg.solve_triangular(root.T, z.T).T
    draws = x[None] + step
    log_half = jnp.sum(jnp.log(jnp.diag(root))) - k * jnp.log(WIDTH)
    distance = jnp.sum((step @ root) ** 2, axis=1) / WIDTH**2
    log_q = (
        gammaln(0.5 * (FREEDOM + k)) - gammaln(0.5 * FREEDOM)
        - 0.5 * k * jnp.log(FREEDOM * jnp.pi) + log_half
        - 0.5 * (FREEDOM + k) * jnp.log1p(distance / FREEDOM)
    )  # fmt: skip
    squares = jax.lax.map(lambda x: jnp.sum(residual(x) ** 2), draws, batch_size=CHUNK)
    log_p = -0.5 * squares - 0.5 * jnp.sum(draws**2, axis=1)
    log_p = log_p - 0.5 * k * jnp.log(2.0 * jnp.pi)
    used, sided = pair >= 0, places_of(numbers, pair) @ numbers.one_sided
    size = draws[:, -2:]
    moment = jnp.log(size**2) + jnp.where(sided > 0.5, jnp.log(2.0), 0.0)[None]
    moment = jnp.where((sided[None] > 0.5) & (size < 0.0), -jnp.inf, moment)
    log_w = log_p + jnp.sum(jnp.where(used[None], moment, 0.0), axis=1) - log_q
    log_w = jnp.where(jnp.isnan(log_w), -jnp.inf, log_w)
    effective = jnp.exp(2.0 * logsumexp(log_w) - logsumexp(2.0 * log_w))
    return logsumexp(log_w) - jnp.log(DRAWS), effective


def sampled_log_evidence(
    diagnosis: Diagnosis, hypothesis: Hypothesis, *, seed: int = 0
) -> tuple[float, float]:
    """Ln Z of a fitted hypothesis by importance sampling, and the least effective number of draws.

    As in a fit, equations are of each of `KINDS`, which are as likely.
    """
    record, effects = diagnosis.record, diagnosis.acting[hypothesis]
    numbers, bent = numbers_of(effects), any(effect.nonlinear for effect in effects)
    pair = jnp.asarray(np.array([*range(len(effects)), -1, -1][:2]))
    x = jnp.asarray(np.asarray(diagnosis.fits[hypothesis].x))
    freedoms = _freedoms(record, effects, numbers, pair, x, nonlinear=bent)
    log_Z, effective = [], []
    dense = np.asarray(jax.vmap(Freedom.dense)(freedoms))
    for own, shared in zip(dense, np.asarray(freedoms.shared), strict=True):
        # factorised once by NumPy, so that no library is called beside the draws
        C, d, _ = own.shape
        whole = shared.reshape(C * d, -1)
        covariance = np.eye(C * d) + whole @ whole.T
        for c in range(C):
            at = slice(c * d, (c + 1) * d)
            covariance[at, at] += own[c] @ own[c].T
        factor = np.linalg.cholesky(covariance)
        whitener = jnp.asarray(np.linalg.inv(factor))
        found, draws = _sampled(
            record, pair, x, numbers, jax.random.key(seed), whitener,
            effects=effects, nonlinear=bent,
        )  # fmt: skip
        log_volume = np.log(np.diag(factor)).sum()
        log_Z.append(float(found) - float(log_volume))
        effective.append(float(draws))
    mean = float(np.logaddexp.reduce(log_Z) - np.log(len(log_Z)))
    return mean, min(effective)


def sample_folder(folder: pathlib.Path, richness: str, count: int) -> str:
    """Probabilities of the likeliest hypotheses, in their likeliest forms, as a Markdown table."""
    diagnoses = diagnoses_of(sorted(folder.iterdir())[:count], richness)
    n = len(CATALOGUE)
    prior = {0: PRIOR["none"], 1: PRIOR["single"] / n, 2: PRIOR["pair"] / (n * (n - 1) / 2)}
    lines = ["| record | hypotheses | probabilities | by sampling | draws that count |",
             "|---|---|---|---|---|"]  # fmt: skip
    worst = []
    for place, d in diagnoses.items():
        ranked = sorted(d.fits, key=lambda h: -d.log_B[h] - np.log(prior[len(h)]))[:SHOWN]
        found = [sampled_log_evidence(d, h) for h in ranked]
        share = np.log([prior[len(h)] for h in ranked])
        stated, sampled = (
            np.exp(logs - logsumexp(logs))
            for logs in (
                share + np.array([float(d.fits[h].log_evidence) for h in ranked]),
                share + np.array([f[0] for f in found]),
            )
        )
        worst.append(float(np.abs(sampled - stated).max()))
        lines.append(
            f"| {place.name} | {', '.join(key_of(h) for h in ranked)} | "
            f"{', '.join(f'{v:.3f}' for v in stated)} | "
            f"{', '.join(f'{v:.3f}' for v in sampled)} | {min(f[1] for f in found):.0f} |"
        )
    lines += ["", f"largest difference: median {np.median(worst):.3f}, maximum {max(worst):.3f}"]
    return "\n".join(lines)
