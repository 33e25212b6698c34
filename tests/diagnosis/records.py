"""Synthetic records for the tests of the diagnosis."""

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.blind.clocked import Clock, recording
from diagnosis import CATALOGUE, Record, RecordedCondition, measured
from diagnosis.measured import correlation
from diagnosis.prediction import (
    ConditionSettings,
    as_waves,
    condition_settings,
    n_unknowns,
    predict,
    selection,
)
from diagnosis.resolution import SAMPLES
from lumped import MMHG
from study.case.beat_folding import Folded, fold

STEP = 2
SETTINGS = (
    ("rest", "none", 0.8, 110.0, 65.0),
    ("adenosine", "adenosine", 0.7, 105.0, 60.0),
    ("dobutamine", "dobutamine", 0.45, 130.0, 70.0),
    ("dobutamine_high", "dobutamine", 0.4, 140.0, 74.0),
)
R0 = 3.75 * MMHG
NAMES = tuple(effect.id for effect in CATALOGUE)


def settings() -> Record:
    """Four conditions, the last held out, with nothing measured but ratios."""
    conditions = tuple(
        RecordedCondition(name, drug, k, k == 3, T, high * MMHG, low * MMHG, ffr=0.9)
        for k, (name, drug, T, high, low) in enumerate(SETTINGS)
    )
    return Record("test", conditions, 0.5 * MMHG, 0.05, 0.01, R0, 0.15)


@jax.jit
def _waves(case: ConditionSettings, own: jax.Array, sizes: jax.Array) -> jax.Array:
    return jax.vmap(lambda c, o: as_waves(predict(c, o, CATALOGUE, sizes)))(case, own)


def noise(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Half white, half correlated over 0.06 beat, of unit variance."""
    K = correlation(0.06)[::STEP, ::STEP]
    value, vector = np.linalg.eigh(K)
    root = vector * np.sqrt(np.maximum(value, 0.0))
    white, smooth = rng.standard_normal((2, *shape))
    return np.sqrt(0.5) * (white + smooth @ root.T)


def beats_of_model(
    rng: np.random.Generator, sizes: dict[str, float], inlet: np.ndarray | None = None
) -> np.ndarray:
    """Traces of the model with effects of some size: conditions × sensors × `SAMPLES`, in CGS.

    `inlet` is added to the aortic pressure of every condition.
    """
    blank = measured(settings())
    x = 0.5 * rng.standard_normal(n_unknowns(blank))
    own = jnp.asarray(selection(4, 0) @ x)
    values = jnp.asarray(np.array([sizes.get(name, 0.0) for name in NAMES]))
    cases = condition_settings(blank)
    if inlet is not None:
        cases = cases._replace(inlet=jnp.broadcast_to(jnp.asarray(inlet), (4, SAMPLES)))
    return np.asarray(_waves(cases, own, values))


def clocked(
    sizes: dict[str, float],
    clock: Clock,
    *,
    seed: int = 0,
    sd: float = 1.0,
    offset: float = 0.3,
    read: Callable[..., Folded] = fold,
) -> tuple[Record, np.ndarray]:
    """A record of the model as a clock samples it and `study` folds it, and the traces in it.

    Noise `sd` and `offset` are in mmHg.
    """
    rng = np.random.default_rng(seed)
    plain = settings()
    waves = beats_of_model(rng, sizes)
    conditions = []
    for c, condition in enumerate(plain.conditions):
        pressures = {"P_aorta": waves[c, 0] / MMHG, "P_distal": waves[c, 1] / MMHG}
        t, traces = recording(rng, pressures, condition.period, sd, clock)
        traces = {n: wave + offset * rng.standard_normal() for n, wave in traces.items()}
        folded = read(t, traces, condition.period, 16)
        conditions.append(
            dataclasses.replace(
                condition,
                ffr=None,
                period=folded.period,
                mean_Q=float(waves[c, 2].mean()),
                beats={name: beats * MMHG for name, beats in folded.beats.items()},
                folding=folded.folding,
            )
        )
    return dataclasses.replace(plain, conditions=tuple(conditions), pressure_sd=None), waves


def synthetic(
    sizes: dict[str, float],
    *,
    seed: int = 0,
    beats: int = 1,
    sd: float = 0.5,
    inlet: np.ndarray | None = None,
) -> Record:
    """A record of the model itself with effects of some size, and noise `sd` [mmHg]."""
    rng = np.random.default_rng(seed)
    plain = settings()
    waves = beats_of_model(rng, sizes, inlet)[..., ::STEP]
    n = SAMPLES // STEP
    conditions = []
    for c, condition in enumerate(plain.conditions):
        noisy = {
            name: waves[c, s] + sd * MMHG * np.sqrt(beats) * noise(rng, (beats, n))
            for s, name in enumerate(("P_aorta", "P_distal"))
        }
        means = {name: float(wave.mean()) for name, wave in noisy.items()}
        conditions.append(
            RecordedCondition(
                condition.name,
                condition.drug,
                c,
                condition.held_out,
                condition.period,
                condition.P_systolic,
                condition.P_diastolic,
                mean_P_aorta=means["P_aorta"],
                mean_P_distal=means["P_distal"],
                ffr=means["P_distal"] / means["P_aorta"],
                mean_Q=float(waves[c, 2].mean()),
                beats=noisy,
            )
        )
    stated = sd * MMHG if beats == 1 else None
    return Record("test", tuple(conditions), stated, 0.05, 0.01, R0, 0.15)
