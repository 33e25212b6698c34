"""A free smooth forcing at a place of the circuit: "something acts here, not in the catalogue".

At each place a waveform of its own for every condition enters the circuit; its prior is a periodic
Gaussian process of some amplitude and length:

| place | the forcing |
|---|---|
| ostium | pressure in series with the ostium |
| wall | flow into the node behind R_1, in units of pressure/R_1 |
| microvasculature | pressure in series with R_2 |
| pump | added to the ventricular pressure |
| inlet | added to the aortic pressure itself |
| sensor | added to the aortic trace, or to the distal trace |

Amplitudes and lengths are averaged with equal weights. The mean of a place's evidences over the
evidence of no gap says where in the *model* a cause may sit; the mean over all places is the
hypothesis "unknown". (Weak-constraint reading: Trémolet 2006, Q J R Meteorol Soc 132:2483.)
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from diagnosis import circuit
from diagnosis.circuit import FORCED, as_harmonics
from diagnosis.evidence import Whitened, reduced_posterior, smooth_scale
from diagnosis.measured import Measured, weights
from diagnosis.prediction import Situation, as_data, n_unknowns, predict, selection, situations

AMPLITUDES_MMHG = (0.5, 1.5, 4.0, 10.0)
"""Prior standard deviations of the forcing [mmHg]."""

LENGTHS = (0.03, 0.12)
"""Correlation lengths [beats]."""

HARMONICS = 18
"""Harmonics of a forcing."""


def forcing_evidence(
    measured: Measured, linear: Whitened, x: Float[Array, " k"]
) -> Float[Array, "p l a"]:
    """Ln Z of a forcing at each place, for each length and amplitude.

    Args:
        measured: the record.
        linear: the base model about its optimum.
        x: that optimum, standardised.
    """
    e, J = linear
    JJ, Je = jnp.einsum("cdk,cdl->kl", J, J), jnp.einsum("cdk,cd->k", J, e)
    ee = jnp.sum(e**2)
    F = _responses(measured, x)
    FF = jnp.einsum("pcdm,pcdl->pcml", F, F)
    FJ, Fe = jnp.einsum("pcdm,cdk->pcmk", F, J), jnp.einsum("pcdm,cd->pcm", F, e)

    def one(weight: Array, FF: Array, FJ: Array, Fe: Array) -> Array:
        weighted = FF * (weight[:, None] * weight[None, :])[None]
        scaled = (FJ * weight[None, :, None], Fe * weight[None])
        return reduced_posterior(JJ, Je, ee, weighted, *scaled).log_evidence

    scale = np.array(
        [[a * smooth_scale(length, HARMONICS) for a in AMPLITUDES_MMHG] for length in LENGTHS]
    )
    flat = jnp.asarray(scale.reshape(-1, scale.shape[-1]))
    by_weight = jax.vmap(one, (0, None, None, None))
    found = jax.vmap(lambda *place: by_weight(flat, *place))(FF, FJ, Fe)
    return found.reshape(len(FORCED), len(LENGTHS), len(AMPLITUDES_MMHG))


def _responses(measured: Measured, x: Float[Array, " k"]) -> Float[Array, "p c d m"]:
    """Derivative of the whitened data by the coefficients of a forcing at each place."""
    W, cases = weights(measured), situations(measured)
    own = jnp.asarray(selection(measured.n_conditions, 0)) @ x[: n_unknowns(measured)]
    none = jnp.zeros(circuit.HARMONICS - HARMONICS)

    def one(place: Array, W: Array, case: Situation, own: Array) -> Array:
        def seen(c: Array) -> Array:
            re, im = c[: HARMONICS + 1], c[HARMONICS + 1 :]
            wave = as_harmonics(jnp.concatenate([re, none, im, none]))
            at = (jnp.arange(len(FORCED)) == place).astype(complex)
            forced = at[:, None] * wave[None, :]
            beat = predict(case, own, (), jnp.zeros(0), nonlinear=False, forced=forced)
            return W * as_data(beat, measured.n_sensors)

        return jax.jacfwd(seen)(jnp.zeros(2 * HARMONICS + 1))

    by_condition = jax.vmap(one, (None, 0, 0, 0))
    return jax.vmap(by_condition, (0, None, None, None))(jnp.arange(len(FORCED)), W, cases, own)
