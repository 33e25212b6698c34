"""The recorded aortic waveform in place of the assumed one.

The base model assumes the shape of the aortic pressure. Where the patient's is another one, no bell
of the catalogue follows it, and what is left hides every other effect. The inlet is then free:

    P_inlet = assumed + δ,    δ ~ N(δ_0, a² (GP of length ℓ)),

by condition, δ_0 being the first harmonics of the recorded aortic pressure less the assumed one; of
the amplitudes a and lengths ℓ of `forcing` the pair is taken that makes δ_0 likeliest. What δ − δ_0
changes in the traces are modes of the record (`measured`), linearised about the base model, so that
every fit and evidence is an integral over the inlet, and errors of the aortic catheter remain
possible.

The result names the effect `aortic_waveform`, in the form "recorded", beside all that is found.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import logsumexp

from diagnosis.changes import Change
from diagnosis.circuit import FORCED, TO_SAMPLES, Circuit
from diagnosis.effects import Effect
from diagnosis.evidence import smooth_scale
from diagnosis.forcing import AMPLITUDES, FORCING_HARMONICS, LENGTHS
from diagnosis.measured import Measured, data_of, weights
from diagnosis.prediction import (
    OWN,
    ConditionSettings,
    condition_settings,
    observations,
    predict,
    selection,
)
from diagnosis.resolution import HARMONICS, SAMPLES
from lumped.units import MMHG

EFFECT = "aortic_waveform"
"""The effect of the catalogue that a free inlet is a form of."""

LED = 0.5
"""Share of a free forcing's evidence at the inlet from which the inlet is set free."""

_LOW = np.r_[0 : FORCING_HARMONICS + 1, HARMONICS + 1 : HARMONICS + 1 + FORCING_HARMONICS]
_WAVES = TO_SAMPLES[:, _LOW]


def with_inlet(batch: Measured) -> Measured:
    """Records with a place for a free inlet, which changes nothing yet.

    With it, fits with the assumed inlet and with a free one share one compilation.
    """
    if batch.inlet is not None:
        return batch
    shape = (*batch.period.shape, batch.n_sensors * (2 * HARMONICS + 1) + 4)
    none = jnp.zeros((*shape, _LOW.size))
    modes = none if batch.modes is None else jnp.concatenate([batch.modes, none], axis=-1)
    return dataclasses.replace(batch, inlet=jnp.zeros((*batch.period.shape, SAMPLES)), modes=modes)


def leads(alone: np.ndarray, beside: Mapping[Any, np.ndarray]) -> bool:
    """Whether a free forcing acts best at the inlet, alone or beside the likeliest effects.

    Args:
        alone: ln Z of a free forcing, places × correlations × lengths × amplitudes.
        beside: the same beside effects.
    """
    likeliest = max(beside.values(), key=logsumexp, default=alone)
    for found in (alone, likeliest):
        places = logsumexp(found.reshape(len(FORCED), -1), axis=1)
        if np.exp(places - logsumexp(places))[FORCED.index("inlet")] > LED:
            return True
    return False


@jax.jit
def with_free_inlet(batch: Measured, x: Float[Array, "b k"]) -> Measured:
    """Records whose inlet is free about the recorded aortic pressure.

    Args:
        batch: records with a place for it, see `with_inlet`; one with a free inlet gets a new one.
        x: optimum of the base model, standardised, by record.
    """
    return jax.vmap(_free)(batch, x)


def _free(measured: Measured, x: Float[Array, " k"]) -> Measured:
    assert measured.modes is not None, "see with_inlet"
    cases = condition_settings(measured)
    own = (jnp.asarray(selection(measured.n_conditions, 2)) @ x)[:, :OWN]
    n, count = measured.n_sensors, 2 * HARMONICS + 1

    def seen(case: ConditionSettings, own: Array, c: Array) -> Array:
        case = case._replace(inlet=jnp.asarray(_WAVES) @ c)
        return observations(predict(case, own, (), jnp.zeros(0), nonlinear=False), n)

    zero = jnp.zeros((measured.n_conditions, _LOW.size))
    assumed = jax.vmap(seen)(cases, own, zero)
    recorded = (weights(measured) > 0.0)[:, :count]
    left = jnp.where(recorded, data_of(measured)[:, :count] - assumed[:, :count], 0.0)
    delta = left[:, _LOW]
    table = np.array(
        [a * smooth_scale(length, FORCING_HARMONICS) for length in LENGTHS for a in AMPLITUDES]
    )
    z = delta[None] / jnp.asarray(table)[:, None]
    fit = jnp.sum(-0.5 * z**2, axis=(1, 2)) - measured.n_conditions * jnp.asarray(
        np.sum(np.log(table), axis=1)
    )
    scale = jnp.asarray(table)[jnp.argmax(fit)]
    H = jax.vmap(jax.jacfwd(seen, argnums=2))(cases, own, delta)
    kept = measured.modes[..., : -_LOW.size]
    return dataclasses.replace(
        measured,
        inlet=delta @ jnp.asarray(_WAVES.T),
        modes=jnp.concatenate([kept, H * scale], axis=-1),
    )


def recorded_waveform(effect: Effect, measured: Measured) -> Effect:
    """The effect of an aortic waveform that is another one, in the form "recorded".

    Its size is the rms of δ_0 over all conditions [mmHg].

    Args:
        effect: the first form.
        measured: one record with a free inlet.
    """
    assert measured.inlet is not None
    delta, order = np.asarray(measured.inlet), np.asarray(measured.order)
    return effect._replace(
        equation="P_inlet(t) = recorded P_aorta(t)",
        change=_recorded(delta / max(float(np.sqrt(np.mean(delta**2))), 1e-300), order),
        form="recorded",
        forms=(),
    )


def _recorded(wave: np.ndarray, order: np.ndarray) -> Change:
    def change(circuit: Circuit, size: Float[Array, ""]) -> Circuit:
        here = jnp.argmin(jnp.abs(jnp.asarray(order) - circuit.order))
        return circuit._replace(P_inlet=circuit.P_inlet + size * MMHG * jnp.asarray(wave)[here])

    return change
