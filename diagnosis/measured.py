"""A measured record as arrays: data, their noise, and priors.

A record holds C conditions. If both pressures (and flow) were recorded over the beat, the waveforms
are used and the means are not, which would count the same trace twice. Units are CGS.

The noise of a waveform of n samples a beat is half white (share w), half correlated over a few
hundredths of a beat, plus a slow offset of each trace. Records do not state the correlation length:
k(Δ) is the mean of correlations over `NOISE_LENGTHS`. Stationary noise has independent harmonics:
with κ_k
the harmonics of k(Δ), the real and imaginary parts of harmonic k have the variance

    2 sd² (w/n + (1 − w) κ_k),      the mean has  sd² (w/n + (1 − w) κ_0) + offset²,

and harmonics from n/2 on were not measured. For folded beats their scatter replaces sd² (…), see
`scatter`.

Variations that affect all sensors and harmonics together, such as the level or shape of single
beats or an error of the start of ejection, are correlated. With columns U of data, z = y/sd and
V = U/sd,

    noise of z ~ N(0, I + V Vᵀ),     whitened data = (I + V Vᵀ)^−½ z = z − V A (Vᵀ z),
    A = (S + S^½)⁻¹,   S = I + VᵀV,   and its inverse is I + V (I + S^½)⁻¹ Vᵀ.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from diagnosis.resolution import HARMONICS, SAMPLES
from diagnosis.spectra import FROM_SAMPLES, PHASE
from lumped.device import quick_jit
from lumped.elimination import solve_definite, square_root
from lumped.units import MMHG

WHITE_SHARE = 0.5
"""Share of the noise variance that is white."""

NOISE_LENGTHS = (0.03, 0.042, 0.06, 0.085, 0.12)
"""Possible correlation lengths of the rest [beats]."""

OFFSET_SD = 0.5 * MMHG
"""Slow offset of each pressure trace [dyn/cm²]."""

SENSORS = ("P_aorta", "P_distal", "Q")
SCALARS = ("mean_P_aorta", "mean_P_distal", "ffr", "mean_Q")


class Measured(eqx.Module):
    """One record, or a batch of records with a leading axis.

    Attributes:
        period, P_systolic, P_diastolic: of each condition [s, dyn/cm²].
        stress, adenosine, dobutamine: 1 if the condition is under stress or that drug, else 0.
        order: order of acquisition.
        waves: mean beat of each sensor, in the order of `SENSORS`; no sensors where no waveforms
            were measured, two without flow.
        wave_sd: standard deviation of its noise a sample; infinite where not measured.
        wave_samples: independent samples a beat.
        wave_offset_sd: of its slow offset.
        white_share: of the noise variance [-].
        scalars, scalar_sd: means and ratios in the order of `SCALARS`; sd infinite where absent.
        held_out: 1 where only the aortic pressure may be used.
        R0, R0_sd_log: prior of the ostium's resistance [dyn·s/cm⁵] and of its logarithm [-].
        P_sd: of the recorded systolic and diastolic pressures [dyn/cm²].
        K, L: quadratic loss and inertance of the ostium that are known with R0 [dyn·s²/cm⁸,
            dyn·s²/cm⁵]; None where only R0 is.
        wave_power: variance of the harmonics' real parts over 2 [(dyn/cm²)², (cm³/s)²], the mean
            first and without the offset; infinite where not measured, NaN where the noise above
            holds. None where it holds for all.
        modes: columns U of the correlated variations of the data of a condition [their unit]; None
            without any.
        inlet: added to the assumed aortic pressure at the samples [dyn/cm²], see `inlet`; None
            without any.
        squeeze_delay: of the ventricular pressure behind its assumed time [beats]; None with
            `inlet`.
        instrument_sd: of an error of each pressure that all beats share [dyn/cm²]; None without
            any.
        steadiness: how unlike the beats are, numbers of `steadiness.Steadiness`; None without
            waveforms.
    """

    period: Float[Array, "*b c"]
    P_systolic: Float[Array, "*b c"]
    P_diastolic: Float[Array, "*b c"]
    stress: Float[Array, "*b c"]
    adenosine: Float[Array, "*b c"]
    dobutamine: Float[Array, "*b c"]
    order: Float[Array, "*b c"]
    waves: Float[Array, "*b c s n"]
    wave_sd: Float[Array, "*b c s"]
    wave_samples: Float[Array, "*b c s"]
    wave_offset_sd: Float[Array, "*b c s"]
    white_share: Float[Array, "*b"]
    scalars: Float[Array, "*b c 4"]
    scalar_sd: Float[Array, "*b c 4"]
    held_out: Float[Array, "*b c"]
    R0: Float[Array, "*b"]
    R0_sd_log: Float[Array, "*b"]
    P_sd: Float[Array, "*b"]
    K: Float[Array, "*b"] | None = None
    L: Float[Array, "*b"] | None = None
    wave_power: Float[Array, "*b c s f"] | None = None
    modes: Float[Array, "*b c d r"] | None = None
    inlet: Float[Array, "*b c n"] | None = None
    squeeze_delay: Float[Array, "*b"] | None = None
    instrument_sd: Float[Array, "*b"] | None = None
    steadiness: Float[Array, "*b 3"] | None = None

    @property
    def n_conditions(self) -> int:
        """Number of conditions."""
        return self.period.shape[-1]

    @property
    def n_sensors(self) -> int:
        """Number of sensors with waveforms: 0, 2 or 3."""
        return self.waves.shape[-2]


def correlation(length: float) -> np.ndarray:
    """Periodic correlation of samples, exp(−2 sin²(πΔ)/(2πℓ)²) with ℓ in beats."""
    distance = np.sin(np.pi * (PHASE[:, None] - PHASE[None, :]))
    return np.exp(-2.0 * distance**2 / (2.0 * np.pi * length) ** 2)


def noise_correlation() -> np.ndarray:
    """Correlation of the smooth part of the noise with the first sample."""
    return np.mean([correlation(length)[0] for length in NOISE_LENGTHS], axis=0)


def noise_power(
    sd: Float[ArrayLike, ""], n_samples: Float[ArrayLike, ""], white_share: Float[ArrayLike, ""]
) -> Float[Array, " f"]:
    """Variance of a trace's harmonics over 2, the mean first and without offset; see above.

    It is infinite where not measured.
    """
    spectrum = np.fft.rfft(noise_correlation()).real[: HARMONICS + 1] / SAMPLES
    power = sd**2 * (white_share / n_samples + (1.0 - white_share) * jnp.asarray(spectrum))
    seen = jnp.arange(HARMONICS + 1).astype(float) < 0.5 * n_samples
    return jnp.where(seen, power, jnp.inf)


def _own_power(measured: Measured, present: Bool[Array, "c s"]) -> Float[Array, "c s f"]:
    sd = jnp.where(present, measured.wave_sd, 1.0)
    n = jnp.where(present, measured.wave_samples, 1.0)
    each = jax.vmap(jax.vmap(noise_power, (0, 0, None)), (0, 0, None))
    power = each(sd, n, measured.white_share)
    if measured.wave_power is None:
        return power
    return jnp.where(jnp.isnan(measured.wave_power), power, measured.wave_power)


def weights(measured: Measured) -> Float[Array, "c d"]:
    """1/sd of everything a record may hold, 0 where it was not measured, without `modes`.

    By condition: coefficients of each trace, then the scalars. Of a held-out condition only the
    aortic pressure counts.
    """
    names = SENSORS[: measured.n_sensors]
    aortic = jnp.asarray(np.array([float(name == "P_aorta") for name in names]))
    allowed = 1.0 - measured.held_out[:, None] * (1.0 - aortic)[None, :]
    present = jnp.isfinite(measured.wave_sd) & (allowed > 0.5)
    C = measured.period.shape[0]
    waves = jnp.zeros((C, 0))
    if names:
        offset = jnp.where(present, measured.wave_offset_sd, 0.0)
        power = _own_power(measured, present)
        variance = jnp.concatenate(
            [power[..., :1] + offset[..., None] ** 2, 2.0 * power[..., 1:], 2.0 * power[..., 1:]],
            axis=-1,
        )
        waves = jnp.where(present[..., None], 1.0 / jnp.sqrt(variance), 0.0).reshape(C, -1)
    of_aorta = jnp.asarray(np.array([1.0, 0.0, 0.0, 0.0]))
    allowed = 1.0 - measured.held_out[:, None] * (1.0 - of_aorta)[None, :]
    known = jnp.isfinite(measured.scalar_sd) & (allowed > 0.5)
    scalars = jnp.where(known, 1.0 / jnp.where(known, measured.scalar_sd, 1.0), 0.0)
    return jnp.concatenate([waves, scalars], axis=1)


compiled_weights = quick_jit(weights)
"""`weights`, for use outside of other programs."""


class Whitener(NamedTuple):
    """Transforms data and predictions of a condition to units of independent noise.

    Attributes:
        weight: 1/sd of each datum, 0 where it was not measured.
        modes: columns V; None without correlated variations.
        lessened: the matrix A.
        restored: the matrix A' of the inverse, I + V A' Vᵀ.
    """

    weight: Float[Array, "*c d"]
    modes: Float[Array, "*c d r"] | None = None
    lessened: Float[Array, "*c r r"] | None = None
    restored: Float[Array, "*c r r"] | None = None

    def __call__(self, y: Float[Array, "*c d"]) -> Float[Array, "*c d"]:
        """Whitened data of one condition, or of all of them at once."""
        return self.columns(y[..., None])[..., 0]

    def columns(self, F: Float[Array, "*c d m"]) -> Float[Array, "*c d m"]:
        """Whitened columns of one condition, or of all."""
        return self.uncorrelated(self.weight[..., None] * F)

    def uncorrelated(self, Z: Float[Array, "*c d m"]) -> Float[Array, "*c d m"]:
        """Whitened columns, of those in units of their own noise."""
        return Z if self.modes is None else Z - self._along(self.lessened, Z)

    def correlated(self, Z: Float[Array, "*c d m"]) -> Float[Array, "*c d m"]:
        """The inverse of `uncorrelated`."""
        return Z if self.modes is None else Z + self._along(self.restored, Z)

    def _along(self, A: Float[Array, "*c r r"] | None, Z: Array) -> Array:
        """V A Vᵀ Z."""
        along = jnp.einsum("...rq,...dq,...dm->...rm", A, self.modes, Z)
        return jnp.einsum("...dr,...rm->...dm", self.modes, along)


def whitener_of(measured: Measured) -> Whitener:
    """Whitener of every condition of a record."""
    weight = weights(measured)
    if measured.modes is None:
        return Whitener(weight)
    V = weight[..., None] * measured.modes
    eye = jnp.eye(V.shape[-1])

    def matrices(V: Float[Array, "d r"]) -> tuple[Array, Array]:
        S = eye + V.T @ V
        root = square_root(S)
        return solve_definite(S + root, eye), solve_definite(eye + root, eye)

    return Whitener(weight, V, *jax.vmap(matrices)(V))


def data_of(measured: Measured) -> Float[Array, "c d"]:
    """The data in the order of `weights`; zero where not measured."""
    present = jnp.isfinite(measured.wave_sd)[..., None]
    waves = jnp.where(present, measured.waves, 0.0) @ jnp.asarray(FROM_SAMPLES.T)
    scalars = jnp.where(jnp.isfinite(measured.scalar_sd), measured.scalars, 0.0)
    return jnp.concatenate([waves.reshape(waves.shape[0], -1), scalars], axis=1)
