"""Location of a gap: two different questions.

*Where the data disagree.* Misfit of blocks of data b (condition × sensor × phase or harmonics) in
units of the noise, excess (χ²_b − n_b)/n_b and z = (χ²_b − n_b)/√(2 n_b), after the joint fit or
after a calibration at rest alone. The global p-value is the probability that pure noise, fitted in
the same way, has a block with so large a z. A joint fit moves the misfit: this is not the place
where the cause acts.

*Where in the model a cause may act.* The probability of all hypotheses that act at a place; an
unknown effect counts at the places where a free forcing explains the gap, see `forcing`.

The misfit in a phase window is that of the mean and the slope of the residual there (n_b = 2).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import logsumexp

from diagnosis.catalogue import CATALOGUE
from diagnosis.circuit import FORCED
from diagnosis.effects import PLACES, all_forms
from diagnosis.engine import base_start, linearised_base, run_fits
from diagnosis.fit import Fitted
from diagnosis.hypothesis import numbers_of
from diagnosis.measured import SENSORS, Measured, compiled_weights, data_of, whitener_of
from diagnosis.prediction import data_of_waves
from diagnosis.resolution import HARMONICS
from diagnosis.result import Diagnosis
from diagnosis.spectra import PHASE, TO_SAMPLES
from diagnosis.verdict import Hypothesis
from lumped.device import quick_jit

PHASES = {
    "early systole": (0.0, 0.2),
    "late systole": (0.2, 0.4),
    "early diastole": (0.4, 0.7),
    "late diastole": (0.7, 1.0),
}
"""Windows of the beat [beats]."""

BANDS = {"mean": (0, 0), "harmonics 1-3": (1, 3), "harmonics 4-10": (4, 10)}
"""Groups of harmonics; those above form one further group."""

DRAWS = 400
"""Draws of noise for the global p-value."""

_COUNT = 2 * HARMONICS + 1


class Block(NamedTuple):
    """Misfit of one block of data.

    Attributes:
        condition: its position in the record.
        sensor: one of `SENSORS`, or a scalar's name.
        part: name of the phase window or of the harmonics.
        excess: (χ² − n)/n.
        z: (χ² − n)/√(2n).
    """

    condition: int
    sensor: str
    part: str
    excess: float
    z: float


class Map(NamedTuple):
    """Blocks, largest z first, with the p-value of the largest.

    The p-value is never below 1/(`DRAWS` + 1): there it is an upper bound.
    """

    blocks: tuple[Block, ...]
    p_value: float


def _functionals(W: np.ndarray) -> list[tuple[int, str, str, np.ndarray]]:
    """Orthonormal functionals of whitened data by block: condition, sensor, part, rows × data."""
    found = []
    C, d = W.shape
    k = np.r_[0 : HARMONICS + 1, 1 : HARMONICS + 1]
    bands = {**BANDS, "harmonics above 10": (11, HARMONICS)}
    for c in range(C):
        for s in range((d - 4) // _COUNT):
            at = slice(s * _COUNT, (s + 1) * _COUNT)
            if not W[c, at].any():
                continue
            sd = np.where(W[c, at] > 0.0, 1.0 / np.where(W[c, at] > 0.0, W[c, at], 1.0), 0.0)
            for name, (low, high) in PHASES.items():
                inside = (low <= PHASE) & (high > PHASE)
                t = (PHASE - PHASE[inside].mean()) * inside
                rows = np.stack([inside / inside.sum(), t / (t**2).sum()]) @ TO_SAMPLES * sd
                factor = np.linalg.cholesky(rows @ rows.T)
                found.append((c, SENSORS[s], name, _placed(np.linalg.solve(factor, rows), at, d)))
            for name, (low, high) in bands.items():
                rows = np.eye(_COUNT)[(k >= low) & (k <= high) & (W[c, at] > 0.0)]
                if rows.size:
                    found.append((c, SENSORS[s], name, _placed(rows, at, d)))
        for name, column in zip(("mean_P_aorta", "mean_P_distal", "ffr", "mean_Q"), range(4),
                                strict=True):  # fmt: skip
            if W[c, d - 4 + column] > 0.0:
                row = np.eye(d)[d - 4 + column][None]
                found.append((c, name, "mean", row))
    return found


def _placed(rows: np.ndarray, at: slice, d: int) -> np.ndarray:
    wide = np.zeros((rows.shape[0], d))
    wide[:, at] = rows
    return wide


def misfit_map(
    record: Measured, residual: np.ndarray, J: np.ndarray | None = None, *, seed: int = 0
) -> Map:
    """Blocks of a fit's whitened residuals.

    Args:
        record: the record.
        residual: whitened residuals, conditions × data.
        J: derivative of the whitened prediction by the unknowns, conditions × data × unknowns; with
            it the draws of noise are fitted as the data were.
        seed: of the draws.
    """
    W = np.asarray(compiled_weights(record))
    groups = _functionals(W)

    def z_of(values: np.ndarray) -> np.ndarray:
        """Z of every block, for draws × conditions × data."""
        found = []
        for c, _, _, rows in groups:
            chi2 = ((values[:, c] @ rows.T) ** 2).sum(axis=1)
            found.append((chi2 - rows.shape[0]) / np.sqrt(2.0 * rows.shape[0]))
        return np.stack(found, axis=1)

    z = z_of(residual[None])[0]
    noise = np.random.default_rng(seed).standard_normal((DRAWS, *W.shape)) * (W > 0.0)
    if J is not None:
        flat = J.reshape(-1, J.shape[-1])
        solved = np.linalg.solve(np.eye(flat.shape[1]) + flat.T @ flat, flat.T)
        noise = (noise.reshape(DRAWS, -1) - noise.reshape(DRAWS, -1) @ solved.T @ flat.T).reshape(
            noise.shape
        )
    largest = z_of(noise).max(axis=1)
    p = float((1 + np.sum(largest >= z.max())) / (DRAWS + 1))
    blocks = [
        Block(c, sensor, part, float(value * np.sqrt(2.0 / rows.shape[0])), float(value))
        for (c, sensor, part, rows), value in zip(groups, z, strict=True)
    ]
    return Map(tuple(sorted(blocks, key=lambda b: -b.z)), p)


def joint_map(diagnosis: Diagnosis) -> Map:
    """Misfit of the base model after the joint fit of all conditions."""
    found = linearised_base(diagnosis.record, diagnosis.effects, diagnosis.base.x)
    return misfit_map(
        diagnosis.record, np.asarray(diagnosis.base.residual), np.asarray(found.linear.J)
    )


def fit_at_rest(record: Measured) -> Fitted:
    """The base model calibrated on rest alone; elsewhere only the aortic trace is used."""
    alone = jax.tree.map(lambda leaf: leaf[None], record)
    hidden = jnp.maximum(record.held_out, record.stress)[None]
    alone = Measured(**{**vars(alone), "held_out": hidden})
    forms = all_forms(CATALOGUE)  # those of the diagnosis, whose compilation is used again
    fitted = run_fits(alone, [0], [(-1, -1)], base_start(alone), numbers_of(forms), forms)
    return jax.tree.map(lambda leaf: leaf[0], fitted)


def rest_map(record: Measured) -> Map | None:
    """Misfit of all conditions after a calibration at rest alone; None without a rest condition.

    Draws of noise are not fitted here: stress was not.
    """
    if not np.any((np.asarray(record.stress) == 0.0) & (np.asarray(record.held_out) == 0.0)):
        return None
    waves = jnp.asarray(fit_at_rest(record).waves)
    return misfit_map(record, np.asarray(_whitened_misfit(record, waves)))


@quick_jit
def _whitened_misfit(record: Measured, waves: Float[Array, "c 3 n"]) -> Float[Array, "c d"]:
    return whitener_of(record)(data_of(record) - data_of_waves(waves, record.n_sensors))


def forcing_shares(diagnosis: Diagnosis, beside: Hypothesis = ()) -> dict[str, float]:
    """Share of the free forcing's evidence at each of its places; they sum to one.

    Args:
        diagnosis: the diagnosis.
        beside: effects that act as well.
    """
    found = diagnosis.accompanied[beside] if beside else diagnosis.forcing
    flat = found.reshape(len(FORCED), -1)
    logs = logsumexp(flat, axis=1) - np.log(flat.shape[1])
    shares = np.exp(logs - logsumexp(logs))
    return dict(zip(FORCED, (float(v) for v in shares), strict=True))


def place_probabilities(diagnosis: Diagnosis) -> dict[str, float]:
    """Probability that a cause acts at each place, and "none"; pairs count half at either place.

        p(place) = Σ_h p(h) (share of h's causes that act there)

    A free forcing, alone or beside effects, is a cause at the places where it explains the gap.

    The forcing alone would mislead where an effect's trace can be had at two places: inertance of
    the ostium looks like a free flow into the wall.
    """
    places = {effect.id: effect.place for effect in diagnosis.effects}
    found: dict[str, float] = dict.fromkeys(("none", *PLACES), 0.0)
    for name, p in diagnosis.judgement.probabilities.items():
        if name == "none":
            found["none"] += p
        elif name != "unknown":
            parts = name.split("+")
            for part in parts:
                found[places[part]] += p / len(parts)
    for hypothesis, p in diagnosis.beside.items():
        each = p / (1 + len(hypothesis))
        for part in hypothesis:
            found[places[part]] += each
        for place, share in forcing_shares(diagnosis, hypothesis).items():
            found[place.split()[-1]] += each * share
    return found
