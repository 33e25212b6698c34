"""A measured record as given by the user, and its conversion to arrays.

A record may hold pressure ratios, means, means with flow, waveforms, or waveforms with flow. Its
noise is stated in the record; otherwise it is estimated from the scatter of several beats: with d
the beats minus their mean and minus the mean of each beat,

    sd² = Σ d²/((b − 1)(n − 1)),    1 − w = (lag-one autocovariance of d)/(sd² k(1/n)).

The mean beat has sd/√b. `TRANSDUCER_SD`, which no scatter shows, is part of guessed equations (see
`hypothesis`). The slow offset is the scatter of the beats' means, at least `OFFSET_SD`: a constant
offset does not show in the scatter. From several beats, `scatter` estimates the power of every
harmonic, and the variations common to sensors and harmonics: a stated sd says how large the noise
is, not how it spreads over the harmonics.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np

from diagnosis.aliasing import aliased_power
from diagnosis.measured import (
    OFFSET_SD,
    SENSORS,
    WHITE_SHARE,
    Measured,
    noise_correlation,
    noise_power,
)
from diagnosis.prediction import P_SD, R0_PRIOR, R0_SD_LOG
from diagnosis.record_checks import check_record, is_repeated
from diagnosis.resolution import HARMONICS, SAMPLES
from diagnosis.richness import RICHNESS
from diagnosis.scatter import FEWEST_BEATS, FORM_SD, FORMS, folded_noise
from diagnosis.steadiness import Steadiness, steadiness
from lumped.units import MMHG

PRESSURE_SD, FLOW_RELATIVE_SD, FFR_SD = 1.0 * MMHG, 0.05, 0.01
"""Noise of a pressure [dyn/cm²], a flow and a ratio where the record neither states it nor has
beats to estimate it from."""

TRANSDUCER_SD = 0.2 * MMHG
"""Error of a pressure that every beat shares, so that its scatter does not show [dyn/cm²]: what
nonlinearity, hysteresis and the response of the line leave of the error band of ±1 mmHg and ±1 %
of ANSI/AAMI BP22 beside offset and gain; its share is assumed. It follows the pressure: smooth over
the beat, since white noise of that size would hide a notch."""


@dataclasses.dataclass(frozen=True)
class Folding:
    """How the beats of a recording were averaged if sampling does not divide the period.

    Attributes:
        samples: effective number of independent samples a beat.
        start_sd: standard deviation of the start of ejection, a delay of all sensors [beats].
    """

    samples: float
    start_sd: float


@dataclasses.dataclass(frozen=True)
class RecordedCondition:
    """One condition of a record.

    Attributes:
        name: its name.
        drug: "none", "adenosine" or "dobutamine"; any other name is stress without either drug.
        order: order of acquisition, from 0; another one for each where there are waveforms.
        held_out: whether only the aortic pressure may be used.
        period: length of the beat [s].
        P_systolic, P_diastolic: aortic pressures [dyn/cm²].
        mean_P_aorta, mean_P_distal: cycle means [dyn/cm²], if known.
        ffr: ratio of the means [-], if known.
        mean_Q: mean coronary flow [cm³/s], if known.
        beats: recorded beats of each sensor of `SENSORS`, beats × samples [dyn/cm², cm³/s]; where
            each sensor has several, or they were folded, all have one shape and the aortic pressure
            is among them.
        folding: how the beats were folded; None if sampling divides the period.
    """

    name: str
    drug: str
    order: int
    held_out: bool
    period: float
    P_systolic: float
    P_diastolic: float
    mean_P_aorta: float | None = None
    mean_P_distal: float | None = None
    ffr: float | None = None
    mean_Q: float | None = None
    beats: Mapping[str, np.ndarray] = dataclasses.field(default_factory=dict)
    folding: Folding | None = None


@dataclasses.dataclass(frozen=True)
class Record:
    """A measured record.

    Attributes:
        id: its name.
        conditions: what was measured, in order of acquisition.
        pressure_sd: noise of the mean beat a sample [dyn/cm²]; None to estimate it.
        pressure_offset_sd: slow offset of each pressure trace [dyn/cm²]; None for `OFFSET_SD`, or
            the scatter of the beats' means where that is larger.
        flow_relative_sd, ffr_sd: noise of flow (relative) and of ratios; None for the default.
        R0, R0_sd_log: what is known of the ostium's resistance [dyn·s/cm⁵] and of its logarithm.
        K, L: quadratic loss and inertance that are known with R0, as a ramp in 3D gives them
            [dyn·s²/cm⁸, dyn·s²/cm⁵]; None where only R0 is. K shares the log-sd of R0.
    """

    id: str
    conditions: tuple[RecordedCondition, ...]
    pressure_sd: float | None = None
    flow_relative_sd: float | None = None
    ffr_sd: float | None = None
    R0: float = R0_PRIOR
    R0_sd_log: float = R0_SD_LOG
    pressure_offset_sd: float | None = None
    K: float | None = None
    L: float | None = None


@dataclasses.dataclass(frozen=True)
class Noise:
    """Noise of a record's traces.

    Attributes:
        pressure_sd: of the mean beat a sample [dyn/cm²].
        white_share: of its variance.
        offset_sd: of the slow offset of a trace [dyn/cm²].
        origin: "stated", "estimated" or "assumed".
    """

    pressure_sd: float
    white_share: float
    offset_sd: float
    origin: str


def noise_of(record: Record) -> Noise:
    """Noise of the pressures, stated, estimated from the scatter of beats, or assumed."""
    stated = record.pressure_offset_sd
    known = OFFSET_SD if stated is None else stated
    if record.pressure_sd is not None:
        return Noise(record.pressure_sd, WHITE_SHARE, known, "stated")
    stacks = [
        beats
        for c in record.conditions
        for name, beats in c.beats.items()
        if name != "Q" and beats.shape[0] >= FEWEST_BEATS
    ]
    if not stacks:
        return Noise(PRESSURE_SD, WHITE_SHARE, known, "assumed")
    own = [beats - beats.mean(axis=0) for beats in stacks]
    scatter = [d.mean(axis=1) for d in own]
    rest = [d - d.mean(axis=1, keepdims=True) for d in own]
    freedom = sum((d.shape[0] - 1) * (d.shape[1] - 1) for d in rest)
    squares = [float((d**2).sum()) for d in rest]
    variance = sum(squares) / freedom
    lagged = sum(float((d * np.roll(d, -1, axis=1)).sum()) for d in rest) / freedom
    # what they would be if all noise were smooth: each stack has its own step
    alike = noise_correlation()[[max(round(SAMPLES / d.shape[1]), 1) for d in rest]]
    expected = float(np.dot(squares, alike)) / freedom
    smooth = np.clip(lagged / max(expected, 1e-12), 0.0, 0.95)
    count = np.mean([d.shape[0] for d in rest])
    offset = np.sqrt(np.mean([m.var(ddof=1) / m.size for m in scatter]))
    sd = float(np.sqrt(variance / count))
    slow = max(float(offset), known) if stated is None else stated
    return Noise(sd, float(1.0 - smooth), slow, "estimated")


def resampled(wave: np.ndarray) -> np.ndarray:
    """A beat on `SAMPLES` samples by its harmonics."""
    n = wave.shape[-1]
    spectrum = np.fft.rfft(wave, axis=-1) * (SAMPLES / n)
    kept = spectrum[..., : min((n + 1) // 2, SAMPLES // 2 + 1)]
    return np.fft.irfft(kept, SAMPLES, axis=-1)


def measured(record: Record, richness: str | None = None) -> Measured:
    """The arrays of a record.

    Args:
        record: the record.
        richness: use no more than this of it, one of `RICHNESS`; by default everything.

    Raises:
        ValueError: unknown richness, no data of that richness, or invalid numbers.
    """
    level = RICHNESS[-1] if richness is None else richness
    if level not in RICHNESS:
        raise ValueError(f"richness = '{level}' is not known. Use one of {', '.join(RICHNESS)}.")
    check_record(record)
    noise = noise_of(record)
    flow_sd = FLOW_RELATIVE_SD if record.flow_relative_sd is None else record.flow_relative_sd
    ffr_sd = FFR_SD if record.ffr_sd is None else record.ffr_sd
    waves, wave_sd, offset_sd, count = _waves(record, level, noise, flow_sd)
    power, modes = _folded(record, noise, waves, wave_sd, count)
    C = len(record.conditions)
    scalars, sd = np.zeros((C, 4)), np.full((C, 4), np.inf)
    for c, condition in enumerate(record.conditions):
        traced = np.pad(np.isfinite(wave_sd[c]), (0, 3 - wave_sd.shape[1]))
        has_pressures, has_flow = traced[:2].all(), traced[2]
        if condition.ffr is not None and (level == "ffr" or not _has_means(condition)):
            if not has_pressures:
                scalars[c, 2], sd[c, 2] = condition.ffr, ffr_sd
        elif level != "ffr" and not has_pressures:
            for k, value in enumerate((condition.mean_P_aorta, condition.mean_P_distal)):
                if value is not None and not traced[k]:
                    scalars[c, k], sd[c, k] = value, np.hypot(noise.pressure_sd, noise.offset_sd)
        if condition.mean_Q is not None and "flow" in level and not has_flow:
            scalars[c, 3], sd[c, 3] = condition.mean_Q, flow_sd * max(abs(condition.mean_Q), 0.05)
    if not (np.isfinite(sd).any() or np.isfinite(wave_sd).any()):
        message = f"Record '{record.id}' holds nothing to compare ({level})."
        raise ValueError(f"{message} Give ratios, means or beats.")

    def column(name: str) -> jax.Array:
        return jnp.asarray(np.array([float(getattr(c, name)) for c in record.conditions]))

    def flag(*drugs: str) -> jax.Array:
        return jnp.asarray(np.array([float(c.drug in drugs) for c in record.conditions]))

    return Measured(
        period=column("period"),
        P_systolic=column("P_systolic"),
        P_diastolic=column("P_diastolic"),
        stress=1.0 - flag("none"),
        adenosine=flag("adenosine"),
        dobutamine=flag("dobutamine"),
        order=column("order"),
        waves=jnp.asarray(waves),
        wave_sd=jnp.asarray(wave_sd),
        wave_samples=jnp.asarray(count),
        wave_offset_sd=jnp.asarray(offset_sd),
        white_share=jnp.asarray(noise.white_share),
        scalars=jnp.asarray(scalars),
        scalar_sd=jnp.asarray(sd),
        held_out=column("held_out"),
        R0=jnp.asarray(float(record.R0)),
        R0_sd_log=jnp.asarray(float(record.R0_sd_log)),
        P_sd=jnp.asarray(P_SD),
        K=None if record.K is None else jnp.asarray(float(record.K)),
        L=None if record.L is None else jnp.asarray(float(record.L)),
        wave_power=None if power is None else jnp.asarray(power),
        modes=None if modes is None else jnp.asarray(modes),
        instrument_sd=jnp.asarray(TRANSDUCER_SD * float(noise.origin == "estimated")),
        steadiness=jnp.asarray(_steadiness(record)) if waves.shape[1] else None,
    )


def _steadiness(record: Record) -> Steadiness:
    return steadiness(
        [
            {k: v for k, v in c.beats.items() if k == "P_aorta" or not c.held_out}
            for c in record.conditions
        ]
    )


def _has_means(condition: RecordedCondition) -> bool:
    return condition.mean_P_aorta is not None and condition.mean_P_distal is not None


def _waves(
    record: Record, level: str, noise: Noise, flow_sd: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Mean beats, their noise, offsets and samples; no sensors where no waveforms are used."""
    C = len(record.conditions)
    with_flow = "flow" in level and any("Q" in c.beats for c in record.conditions)
    used = SENSORS if with_flow else SENSORS[:2]
    if not level.startswith("waveforms") or not any(c.beats for c in record.conditions):
        used = ()
    waves = np.zeros((C, len(used), SAMPLES))
    sd, offset = np.full((C, len(used)), np.inf), np.full((C, len(used)), np.inf)
    count = np.ones((C, len(used)))
    for c, condition in enumerate(record.conditions):
        for s, name in enumerate(used):
            beats = condition.beats.get(name)
            if beats is None:
                continue
            waves[c, s] = resampled(beats.mean(axis=0))
            count[c, s] = beats.shape[1] if condition.folding is None else condition.folding.samples
            scale = flow_sd * max(float(np.abs(waves[c, s]).mean()), 0.05)
            sd[c, s] = scale if name == "Q" else noise.pressure_sd
            offset[c, s] = scale if name == "Q" else noise.offset_sd
    return waves, sd, offset, count


def _folded(
    record: Record, noise: Noise, waves: np.ndarray, wave_sd: np.ndarray, count: np.ndarray
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Powers and modes of conditions with several beats; None where there are none."""
    C, S = wave_sd.shape
    if S == 0 or not any(is_repeated(c) for c in record.conditions):
        return None, None
    power = np.full((C, S, HARMONICS + 1), np.nan)
    modes = np.zeros((C, S, 2 * HARMONICS + 1, S * FORMS + 1))
    for c, condition in enumerate(record.conditions):
        present = [s for s in range(S) if np.isfinite(wave_sd[c, s])]
        if not is_repeated(condition) or not present:
            continue
        folding = condition.folding
        names = [SENSORS[s] for s in present]
        parametric = {
            SENSORS[s]: np.asarray(noise_power(wave_sd[c, s], count[c, s], noise.white_share))
            for s in present
        }
        found = folded_noise(
            {name: condition.beats[name] for name in names},
            dict(zip(names, waves[c, present], strict=True)),
            parametric,
            None
            if folding is None
            else np.asarray(noise_power(FORM_SD, count[c, present[0]], WHITE_SHARE)),
            0.0 if folding is None else folding.start_sd,
            estimate=noise.origin == "estimated",
        )
        power[c, present] = found.power
        if folding is None:
            for s, name in zip(present, names, strict=True):
                power[c, s] += aliased_power(condition.beats[name].mean(axis=0), power[c, s])
        modes[c, present, :, : found.modes.shape[-1]] = found.modes
    # scalars are not used where traces are
    modes = np.concatenate(
        [modes.reshape(C, -1, modes.shape[-1]), np.zeros((C, 4, modes.shape[-1]))], 1
    )
    return power, modes


def stacked(records: Sequence[Measured]) -> Measured:
    """Records of one shape as a batch.

    K or L is zero in records that do not state it; records without folded beats keep their own
    noise.
    """
    C, S = records[0].n_conditions, records[0].n_sensors
    blank = {
        "instrument_sd": np.zeros(()),
        "K": np.zeros(()),
        "L": np.zeros(()),
        "wave_power": np.full((C, S, HARMONICS + 1), np.nan),
        "modes": np.zeros((C, S * (2 * HARMONICS + 1) + 4, S * FORMS + 1)),
    }
    for name, none in blank.items():
        if any(getattr(one, name) is not None for one in records):
            records = [
                dataclasses.replace(one, **{name: jnp.asarray(none)})
                if getattr(one, name) is None
                else one
                for one in records
            ]
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *records)
