"""A free smooth forcing at a place of the circuit: "something acts here, not in the catalogue".

At each place a waveform is added for every condition; its prior is a periodic Gaussian process
with some amplitude and correlation length:

| place | the forcing |
|---|---|
| ostium | pressure in series with the ostium |
| wall | flow into the node behind R_1, in units of pressure/R_1 |
| microvasculature | pressure in series with R_2 |
| pump | added to the ventricular pressure |
| inlet | added to the aortic pressure itself |
| sensor | added to the aortic trace, to the distal trace, or to the measured flow |

A cause acts in every condition at about the same time of the beat, with different strengths. With a
correlation s between conditions, the covariance of the waveforms of two conditions is that of one
times

    s + (1 − s) δ.

All amplitudes, lengths and correlations have equal weights. The mean of a place's evidences
over the evidence of no gap says where in the *model* a cause may sit; the mean over all places is
the hypothesis "unknown". (Weak-constraint reading: Trémolet 2006, Q J R Meteorol Soc 132:2483.)

An effect outside the catalogue may act alone or together with one of the catalogue. The optimum
without it is then a poor point for linearisation: the evidence is evaluated at the posterior mean
with the likeliest forcing of each place.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int

from diagnosis.circuit import FORCED
from diagnosis.effects import Effect
from diagnosis.evidence import (
    absorbed,
    log_prior_of_sizes,
    posterior_of_products,
    smooth_scale,
    split,
)
from diagnosis.form_columns import Freedom
from diagnosis.hypothesis import (
    Catalogue,
    likeliest_freedom,
    one_sided_unknowns,
    sensor_model,
)
from diagnosis.measured import Measured, Whitener, data_of, whitener_of
from diagnosis.prediction import ConditionSettings, condition_settings, observations, selection
from diagnosis.resolution import HARMONICS
from diagnosis.spectra import as_harmonics
from lumped.units import MMHG

AMPLITUDES = (0.5 * MMHG, 1.5 * MMHG, 4.0 * MMHG, 10.0 * MMHG)
"""Prior standard deviations of the forcing [dyn/cm²]."""

LENGTHS = (0.03, 0.12)
"""Correlation lengths [beats]."""

CONDITION_CORRELATIONS = (0.0, 0.9)
"""Correlations s of the forcing between conditions."""

FORCING_HARMONICS = 18
"""Harmonics of a forcing, besides the mean."""


def forcing_scales() -> list[Float[np.ndarray, " m"]]:
    """Prior standard deviations of a forcing's coefficients, by length and amplitude."""
    return [a * smooth_scale(length, FORCING_HARMONICS) for length in LENGTHS for a in AMPLITUDES]


N_FORCINGS = len(CONDITION_CORRELATIONS) * len(LENGTHS) * len(AMPLITUDES)
"""Number of correlations, lengths and amplitudes."""

_MIDDLE = np.arange(N_FORCINGS) % len(AMPLITUDES) == 2
_ORDER = np.argsort(~_MIDDLE, kind="stable")

TRIED = np.array([_MIDDLE.sum(), N_FORCINGS])
"""Forcings tried by linearisation: about the optimum without any those of a middle amplitude, then,
about the mean with the likeliest of these, all."""


def forcing_evidence(
    measured: Measured,
    effects: Sequence[Effect],
    numbers: Catalogue,
    pair: Int[Array, " 2"],
    x: Float[Array, " k"],
    kinds: Float[Array, " 3"],
    *,
    nonlinear: bool,
) -> Float[Array, "p s l a"]:
    """Ln Z of a forcing at each place beside a hypothesis, by correlation, length and amplitude.

    Args:
        measured: the record.
        effects: the catalogue (static).
        numbers: of the catalogue.
        pair: positions of the hypothesis's effects, −1 for none.
        x: its posterior mean, standardised.
        kinds: probabilities of what its equations are. The likeliest kind is computed, and the
            others counted with the ratios that they have without a forcing.
        nonlinear: whether any of them makes the ostium nonlinear (static).
    """
    sided = one_sided_unknowns(measured, numbers, pair)
    beat = sensor_model(effects, numbers, pair, nonlinear=nonlinear)
    W, data, cases = whitener_of(measured), data_of(measured), condition_settings(measured)
    chooser = jnp.asarray(selection(measured.n_conditions, 2))
    freedom = likeliest_freedom(measured, effects, numbers, pair, x, kinds, nonlinear=nonlinear)
    other_kinds = -jnp.log(kinds.shape[0] * jnp.max(kinds))
    none = jnp.zeros(HARMONICS - FORCING_HARMONICS)

    def shown(case: ConditionSettings, own: Array, place: Array, c: Array) -> Array:
        re, im = c[: FORCING_HARMONICS + 1], c[FORCING_HARMONICS + 1 :]
        wave = as_harmonics(jnp.concatenate([re, none, im, none]))
        at = (jnp.arange(len(FORCED)) == place).astype(complex)
        return observations(beat(case, own, at[:, None] * wave[None, :]), measured.n_sensors)

    zero, n_own = jnp.zeros(2 * FORCING_HARMONICS + 1), chooser.shape[1]

    def slopes(W: Whitener, case: ConditionSettings, own: Array, place: Array) -> tuple:
        """Whitened prediction without a forcing, derivative by the unknowns and by a forcing."""

        def with_value(both: Array) -> tuple[Array, Array]:
            value = shown(case, both[:n_own], place, both[n_own:])
            return value, value

        J, value = jax.jacfwd(with_value, has_aux=True)(jnp.concatenate([own, zero]))
        J = W.columns(J)
        return W(value), J[:, :n_own], J[:, n_own:]

    def at_place(place: Array) -> Array:
        def about(x: Array, tried: Array) -> tuple[Array, Array]:
            """The mean with the likeliest of the forcings, and all evidences."""
            value, J, F = jax.vmap(slopes, (0, 0, 0, None))(W, cases, chooser @ x, place)
            J = jnp.einsum("cdo,cok->cdk", J, chooser)
            e = W(data) - value + J @ x
            log_Z, means = forcing_mixture(freedom, F, J, e, pair, sided, tried)
            mean = means[jnp.argmax(log_Z)]
            return jnp.where(sided > 0.5, jnp.maximum(mean, 0.0), mean), log_Z

        inside = jnp.where(sided > 0.5, jnp.maximum(x, 0.0), x)
        return jax.lax.scan(about, inside, jnp.asarray(TRIED))[1][-1]

    found = jax.lax.map(at_place, jnp.arange(len(FORCED)))
    found = jnp.where(jnp.isfinite(found), found + other_kinds, -jnp.inf)
    return found.reshape(len(FORCED), len(CONDITION_CORRELATIONS), len(LENGTHS), len(AMPLITUDES))


def forcing_mixture(
    freedom: Freedom,
    F: Float[Array, "c d m"],
    J: Float[Array, "c d k"],
    e: Float[Array, "c d"],
    pair: Int[Array, " 2"],
    sided: Float[Array, " k"],
    tried: Int[ArrayLike, ""] = N_FORCINGS,
) -> tuple[Float[Array, " n"], Float[Array, "n k"]]:
    """Ln Z and posterior mean for every correlation, length and amplitude of a forcing.

    Args:
        freedom: of the equations, whitened.
        F: response to the forcing's coefficients, whitened.
        J: derivative by the unknowns, whitened.
        e: residual plus J x, whitened.
        pair: positions of the effects, −1 for none.
        sided: 1 for unknowns that only exist above zero.
        tried: how many of them, those of a middle amplitude first; −∞ stands for the others.
    """
    m, k = F.shape[-1], J.shape[-1]
    rest = freedom.shared.shape[-1] + k + 1
    products, form_volume = freedom.own_absorbed(F, freedom.shared, J, e[..., None])
    scales = np.tile(forcing_scales(), (len(CONDITION_CORRELATIONS), 1))
    alike = np.repeat(CONDITION_CORRELATIONS, N_FORCINGS // len(CONDITION_CORRELATIONS))

    def one(s: Array, scale: Array) -> tuple[Array, Array]:
        weight = jnp.concatenate([scale, jnp.ones(rest)])
        scaled = products * (weight[:, None] * weight[None, :])[None]
        # first absorb each condition's own part of the forcing, then the part common to all
        root = jnp.concatenate([jnp.full(m, jnp.sqrt(1.0 - s)), jnp.ones(m + rest)])
        twice = jnp.concatenate([jnp.arange(m), jnp.arange(m + rest)])
        doubled = scaled[:, twice][:, :, twice] * (root[:, None] * root[None, :])[None]
        left, own_volume = jax.vmap(lambda one: absorbed(one, m))(doubled)
        root = jnp.concatenate([jnp.full(m, jnp.sqrt(s)), jnp.ones(rest)])
        shared = jnp.sum(left, 0) * root[:, None] * root[None, :]
        left, shared_volume = absorbed(shared, m + rest - k - 1)
        volume = jnp.sum(form_volume) + jnp.sum(own_volume) + shared_volume
        after = posterior_of_products(*split(left), volume, sided)
        return after.log_evidence + log_prior_of_sizes(after, pair, sided), after.mean

    def add(place: Array, found: tuple[Array, Array]) -> tuple[Array, Array]:
        at = jnp.asarray(_ORDER)[place]
        log_Z, mean = one(jnp.asarray(alike)[at], jnp.asarray(scales)[at])
        return found[0].at[at].set(log_Z), found[1].at[at].set(mean)

    none = jnp.full(N_FORCINGS, -jnp.inf), jnp.zeros((N_FORCINGS, k))
    return jax.lax.fori_loop(0, tried, add, none)
