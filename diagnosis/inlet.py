"""The recorded aortic waveform in place of the assumed one.

The base model assumes the shape of the aortic pressure. Where the patient's is another one, no bell
of the catalogue follows it, and what is left hides every other effect. The inlet is then free:

    P_inlet = assumed + δ,    δ ~ N(δ_0, a² (GP of length ℓ)),

by condition, δ_0 being the recorded aortic pressure less the assumed one. δ is free in the first
harmonics; of the amplitudes a and lengths ℓ of `forcing` the pair is taken that makes δ_0, with its
noise, likeliest. Higher harmonics, those of a notch, enter δ_0 as far as they rise above the noise.
What δ − δ_0 changes in the traces are modes of the record (`measured`), linearised about the base
model, so that every fit and evidence is an integral over the inlet, and errors of the aortic
catheter remain possible. The signals of a fit are those of δ_0; `with_inlet_mean` adds what the
data tell of the rest.

The ventricle's squeeze is timed by the start of the aortic pressure, which another waveform moves:
its delay is an unknown of the base model (`prediction`), and that of each condition differs by
`DELAY_SD`, one more mode.

The result names the effect `aortic_waveform`, in the form "recorded", beside all that is found.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.special import logsumexp

from diagnosis.circuit import FORCED, Circuit
from diagnosis.effects import Effect
from diagnosis.forcing import FORCING_HARMONICS, forcing_scales
from diagnosis.forms import SQUEEZE_DELAY, late_squeeze
from diagnosis.measured import Measured, data_of, weights
from diagnosis.prediction import (
    OWN,
    SHARED,
    SQUEEZE_SD,
    ConditionSettings,
    condition_settings,
    data_of_waves,
    observations,
    predict,
    selection,
)
from diagnosis.resolution import HARMONICS, SAMPLES
from diagnosis.spectra import TO_SAMPLES
from lumped.elimination import solve_definite
from lumped.units import MMHG

EFFECT = "aortic_waveform"
"""The effect of the catalogue that a free inlet is a form of."""

RECORDED = "recorded"
"""Name of this form."""

DELAY_SD = 0.015
"""Standard deviation of the squeeze's delay between conditions [beats]; assumed."""

NOISE_KEPT_OUT = 2.0
"""Expected noise of a harmonic beyond the modes, times this, that δ_0 is less of."""

SQUEEZE = SHARED.index("squeeze")
"""Position of the delay of the squeeze among the unknowns."""

LED = 0.5
"""Share of a free forcing's evidence at the inlet from which the inlet is set free."""

_LOW = np.r_[0 : FORCING_HARMONICS + 1, HARMONICS + 1 : HARMONICS + 1 + FORCING_HARMONICS]
_WAVES = TO_SAMPLES[:, _LOW]


def with_inlet(batch: Measured) -> Measured:
    """Records with a place for a free inlet, which changes nothing yet."""
    shape = (*batch.period.shape, batch.n_sensors * (2 * HARMONICS + 1) + 4)
    none = jnp.zeros((*shape, _LOW.size + 1))
    modes = none if batch.modes is None else jnp.concatenate([batch.modes, none], axis=-1)
    return dataclasses.replace(
        batch,
        inlet=jnp.zeros((*batch.period.shape, SAMPLES)),
        squeeze_delay=jnp.zeros(batch.period.shape[:1]),
        modes=modes,
    )


def leads(alone: np.ndarray, beside: Mapping[Any, np.ndarray]) -> bool:
    """Whether a free forcing acts best at the inlet, alone or beside the likeliest effects.

    Args:
        alone: ln Z of a free forcing, places × correlations × lengths × amplitudes.
        beside: the same beside effects.
    """
    likeliest = max(beside.values(), key=logsumexp, default=alone)
    for found in (alone, likeliest):
        places = np.asarray(logsumexp(found.reshape(len(FORCED), -1), axis=1))
        share = np.exp(places - np.max(places))
        if share[FORCED.index("inlet")] > LED * np.sum(share):
            return True
    return False


@jax.jit
def with_free_inlet(batch: Measured, x: Float[Array, "b k"]) -> Measured:
    """Records whose inlet is free about the recorded aortic pressure.

    Args:
        batch: records with a place for it, see `with_inlet`; one with a free inlet gets a new one.
        x: optimum of the base model, standardised, by record. Its delay of the squeeze is added to
            that of the record.
    """
    return jax.vmap(_free)(batch, x)


def _free(measured: Measured, x: Float[Array, " k"]) -> Measured:
    assert measured.modes is not None, "see with_inlet"
    assert measured.squeeze_delay is not None, "see with_inlet"
    assert measured.inlet is not None, "see with_inlet"
    delay = measured.squeeze_delay + SQUEEZE_SD * x[SQUEEZE]
    cases = condition_settings(dataclasses.replace(measured, squeeze_delay=delay))
    own = (jnp.asarray(selection(measured.n_conditions, 2)) @ x.at[SQUEEZE].set(0.0))[:, :OWN]
    n, count = measured.n_sensors, 2 * HARMONICS + 1

    def seen(case: ConditionSettings, own: Array, fixed: Array, free: Array) -> Array:
        """Data under waves at the inlet and a delay in units of `DELAY_SD`."""
        assert case.squeeze_delay is not None, "see with_inlet"
        case = case._replace(
            inlet=fixed + jnp.asarray(_WAVES) @ free[:-1],
            squeeze_delay=case.squeeze_delay + DELAY_SD * free[-1],
        )
        return observations(predict(case, own, (), jnp.zeros(0), nonlinear=False), n)

    zero = jnp.zeros((measured.n_conditions, _LOW.size + 1))
    assumed = jax.vmap(seen)(cases, own, jnp.zeros(measured.inlet.shape), zero)
    weight = weights(measured)[:, :count]
    recorded = weight > 0.0
    variance = jnp.where(recorded, 1.0 / jnp.where(recorded, weight, 1.0) ** 2, 0.0)
    left = jnp.where(recorded, data_of(measured)[:, :count] - assumed[:, :count], 0.0)
    scale = jnp.append(_likeliest_scale(left[:, _LOW], variance[:, _LOW], recorded[:, _LOW]), 1.0)
    delta = _without_noise(left, variance)
    free = jnp.pad(delta[:, _LOW], ((0, 0), (0, 1)))
    fixed = delta.at[:, _LOW].set(0.0) @ jnp.asarray(TO_SAMPLES.T)
    H = jax.vmap(jax.jacfwd(seen, argnums=3))(cases, own, fixed, free)
    kept = measured.modes[..., : -scale.size]
    return dataclasses.replace(
        measured,
        inlet=delta @ jnp.asarray(TO_SAMPLES.T),
        squeeze_delay=delay,
        modes=jnp.concatenate([kept, H * scale[None, None]], axis=-1),
    )


def _likeliest_scale(
    left: Float[Array, "c k"], variance: Float[Array, "c k"], recorded: Bool[Array, "c k"]
) -> Float[Array, " k"]:
    """Standard deviations of the low harmonics, of all amplitudes and lengths the likeliest."""
    table = jnp.asarray(np.array(forcing_scales()))

    def fit(scale: Float[Array, " k"]) -> Float[Array, ""]:
        total = jnp.where(recorded, scale[None] ** 2 + variance, 1.0)
        return jnp.sum(jnp.where(recorded, -0.5 * (left**2 / total + jnp.log(total)), 0.0))

    return table[jnp.argmax(jax.vmap(fit)(table))]


def _without_noise(left: Float[Array, "c k"], variance: Float[Array, "c k"]) -> Float[Array, "c k"]:
    """δ_0: the harmonics that are no modes less what may be noise, by all conditions together."""
    power, noise = jnp.sum(left**2, axis=0), jnp.sum(variance, axis=0)
    other = np.r_[0, HARMONICS + 1 : 2 * HARMONICS + 1, 1 : HARMONICS + 1]
    power, noise = power + power[other], noise + noise[other]  # cosine and sine
    signal = jnp.maximum(1.0 - NOISE_KEPT_OUT * noise / jnp.where(power > 0.0, power, 1.0), 0.0)
    return left * signal.at[_LOW].set(1.0)[None]


@jax.jit
def with_inlet_mean(measured: Measured, waves: Float[Array, "c 3 n"]) -> Float[Array, "c 3 n"]:
    """Signals of a fit with a free inlet, at the posterior mean of what they integrate over.

    With the standardised modes m of a condition and its whitened residual z at m = 0::

        z = V m + noise,    E[m] = (I + VᵀV)⁻¹ Vᵀ z

    Errors of the clocks, modes too, are part of the solution and no part of the signals.

    Args:
        measured: the record with the free inlet.
        waves: predicted signals of all sensors at δ_0 [dyn/cm², cm³/s]; of the third, which few
            records hold, nothing is changed where it was not recorded.
    """
    assert measured.modes is not None, "see with_inlet"
    n, inlet = measured.n_sensors, slice(-(_LOW.size + 1), None)
    W = weights(measured)
    left = W * (data_of(measured) - data_of_waves(waves, n))

    def mean(V: Float[Array, "d r"], left: Float[Array, " d"]) -> Float[Array, " r"]:
        return solve_definite(jnp.eye(V.shape[-1]) + V.T @ V, (V.T @ left)[:, None])[:, 0]

    modes = jax.vmap(mean)(W[..., None] * measured.modes, left)
    change = jnp.einsum("cdr,cr->cd", measured.modes[..., inlet], modes[:, inlet])
    change = change[:, : n * (2 * HARMONICS + 1)].reshape(waves.shape[0], n, -1)
    return waves.at[:, :n].add(change @ jnp.asarray(TO_SAMPLES.T))


def inlet_rms(measured: Measured) -> float:
    """Root mean square of δ_0 over all conditions of a record with a free inlet [dyn/cm²]."""
    assert measured.inlet is not None, "see with_inlet"
    return float(np.sqrt(np.mean(np.asarray(measured.inlet) ** 2)))


def recorded_waveform(effect: Effect, measured: Measured, x_squeeze: float = 0.0) -> Effect:
    """The effect of an aortic waveform that is another one, in the form "recorded".

    Its size is the rms of δ_0 over all conditions [mmHg]; the delay of the squeeze goes with it.

    Args:
        effect: the first form.
        measured: one record with a free inlet.
        x_squeeze: what a fit adds to its delay of the squeeze, standardised.
    """
    assert measured.squeeze_delay is not None, "see with_inlet"
    rms = inlet_rms(measured) / MMHG
    wave, order = np.asarray(measured.inlet) / rms, np.asarray(measured.order)
    late = (float(measured.squeeze_delay) + SQUEEZE_SD * x_squeeze) / SQUEEZE_DELAY / rms

    def change(circuit: Circuit, size: Float[Array, ""]) -> Circuit:
        here = jnp.argmin(jnp.abs(jnp.asarray(order) - circuit.order))
        circuit = late_squeeze(circuit, size * late)
        return circuit._replace(P_inlet=circuit.P_inlet + size * jnp.asarray(wave)[here])

    return effect._replace(
        equation="P_inlet(t) = recorded P_aorta(t)", change=change, form=RECORDED, forms=()
    )
