"""Effects that the data do not distinguish, and the measurement that would.

The score scan gives g⊥ of each effect, the part of its change of the data that the unknowns cannot
reproduce: |g⊥|·size is its detectability, the cosine of two of them their similarity. A measurement
that determines the size of an effect with error σ, where hypothesis i predicts m ± s and j zero,
has the expected log Bayes factor

    E[ln B_ij] = KL(N(m, s² + σ²) ‖ N(0, σ²)) = ½ (m² + s²)/σ² − ½ ln(1 + s²/σ²),

and an additional sensor whose predictions differ by Δ with a covariance R gives ½ Δᵀ R⁻¹ Δ. Before
any measurement, the same scan at the prior means shows which effects a set of sensors can isolate.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from diagnosis.effects import SCALE, Effect, find_effect
from diagnosis.engine import linearised_base
from diagnosis.measured import OFFSET_SD, Measured
from diagnosis.prediction import n_unknowns
from diagnosis.resolution import SAMPLES
from diagnosis.result import Diagnosis
from diagnosis.scan import Linearised

ALIAS_COSINE = 0.9
"""|cosine| from which two effects count as aliases."""

TYPICAL = 1.2
"""Typical size, in widths of the prior: 0.7 of its root mean square."""

ISOLATED = 3.0
"""Least expected ln B against no gap and every rival at which an effect is isolable."""

READINGS: dict[str, tuple[str, tuple[tuple[str, float], ...]]] = {
    "equalisation check at the end": ("±0.5 mmHg a condition", (("wire_drift", 0.3),)),
    "height of the wire's sensor on CT": ("±0.5 cm", (("sensor_height", 0.4),)),
    "zeroing of the aortic transducer": ("±0.5 mmHg", (("aortic_zero_error", 0.5),)),
    "flush test": (
        "±2 ms", (("catheter_damping", 0.002), ("distal_damping", 0.002), ("signal_delay", 0.002)),
    ),
    "left ventricular pressure": (
        "±5 %", (("intramyocardial_pump", 0.05), ("dobutamine_inotropy", 0.05)),
    ),
    "right atrial or wedge pressure": ("±1.5 mmHg", (("back_pressure", 1.5),)),
    "occlusion pressure": ("±0.03", (("collateral_flow", 0.03),)),
    "intravascular ultrasound over the beat, at rest and under stress": (
        "±0.15", (("dynamic_narrowing", 0.15), ("stress_narrowing", 0.15)),
    ),
    "equalisation check at two levels of pressure": ("±1 %", (("sensor_gain", 0.01),)),
    "pressure drop computed at two flows": (
        "±0.5 mmHg s2/ml2, ±10 %", (("quadratic_loss", 0.5), ("proximal_resistance", 0.1)),
    ),
}  # fmt: skip
"""Measurements of the size of effects, with their errors [unit of the size]; assumed."""

VISIBLE = 3.0
"""Detectability λ from which an effect shows in a record."""

OPEN = 0.01
"""Probability, or ratio of two, below which a question counts as closed."""

FLOW_ERROR, FLOW_SAMPLES = 0.05, 16
"""Relative error of a flow, and the independent samples of its waveform."""

SENSOR_SETS = ("means", "means+flow", "waveforms", "waveforms+flow", "flow waveform as well")


class Next(NamedTuple):
    """A recommended measurement.

    Attributes:
        sensor: what to measure.
        separates: the two hypotheses that it distinguishes best.
        expected_log_bayes_factor: of the likelier over the other.
    """

    sensor: str
    separates: tuple[str, str]
    expected_log_bayes_factor: float


def traces(found: Linearised) -> np.ndarray:
    """Inner products g⊥ᵢᵀ g⊥ⱼ of all effects, per standardised size."""
    (_, J), G = found.linear, found.effects
    flat_J = np.asarray(J).reshape(-1, J.shape[-1])
    flat_G = np.asarray(G).reshape(-1, G.shape[-1])
    JG = flat_J.T @ flat_G
    precision = np.eye(flat_J.shape[1]) + flat_J.T @ flat_J
    return flat_G.T @ flat_G - JG.T @ np.linalg.solve(precision, JG)


def usual_visibility(diagnosis: Diagnosis, name: str) -> float:
    """Detectability λ of an effect of typical size in a record, beyond the unknowns [-]."""
    effect = find_effect(diagnosis.effects, name)
    return diagnosis.visibility[name] * TYPICAL * SCALE * effect.sd


def aliases(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """Pairs of effects with nearly the same change of the data, likeliest first."""
    inner = traces(linearised_base(diagnosis.record, diagnosis.effects, diagnosis.base.x))
    length = np.sqrt(np.maximum(np.diag(inner), 1e-300))
    names = [effect.id for effect in diagnosis.effects]
    alike = np.abs(inner) / np.outer(length, length)
    seen = length * TYPICAL > 0.3
    found = [
        (names[i], names[j])
        for i in range(len(names))
        for j in range(i + 1, len(names))
        if alike[i, j] >= ALIAS_COSINE and seen[i] and seen[j]
    ]
    inclusion = diagnosis.judgement.inclusion
    return sorted(found, key=lambda pair: -max(inclusion[pair[0]], inclusion[pair[1]]))


def next_measurements(diagnosis: Diagnosis, count: int = 3) -> list[Next]:
    """Measurements that would best separate the likeliest hypotheses, best first."""
    probabilities = diagnosis.judgement.probabilities
    open_ones = [
        h for h in diagnosis.fits if len(h) <= 1 and probabilities["+".join(h) or "none"] >= OPEN
    ]
    ranked = sorted(open_ones, key=lambda h: -probabilities["+".join(h) or "none"])[:6]
    found = []
    for sensor, (_, readings) in READINGS.items():
        found += _by_reading(diagnosis, ranked, sensor, dict(readings))
    found += _by_flow(diagnosis, ranked)
    best: dict[str, Next] = {}
    for option in sorted(found, key=lambda o: -o.expected_log_bayes_factor):
        best.setdefault(option.sensor, option)
    useful = [o for o in best.values() if o.expected_log_bayes_factor >= 1.0]
    return useful[:count]


def _weight(diagnosis: Diagnosis, first: tuple[str, ...], second: tuple[str, ...]) -> float:
    """Ratio of the smaller to the larger probability of two hypotheses."""
    p = [diagnosis.judgement.probabilities["+".join(h) or "none"] for h in (first, second)]
    return min(p) / max(max(p), 1e-300)


def _by_reading(
    diagnosis: Diagnosis, ranked: list[tuple[str, ...]], sensor: str, errors: dict[str, float]
) -> list[Next]:
    found = []
    for h in ranked:
        if not h or h[0] not in errors:
            continue
        e = [effect.id for effect in diagnosis.effects].index(h[0])
        size, sd = float(diagnosis.fits[h].sizes[e]), float(diagnosis.fits[h].size_sd[0])
        sigma = errors[h[0]]
        gain = 0.5 * (size**2 + sd**2) / sigma**2 - 0.5 * np.log1p(sd**2 / sigma**2)
        rivals = [r for r in ranked if r != h and _weight(diagnosis, h, r) > OPEN]
        if rivals:
            found.append(Next(sensor, (h[0], "+".join(rivals[0]) or "none"), float(min(gain, 99))))
    return found


def _by_flow(diagnosis: Diagnosis, ranked: list[tuple[str, ...]]) -> list[Next]:
    record = diagnosis.record
    if record.n_sensors > 2:
        return []
    fitted = np.asarray(record.held_out) < 0.5
    has_mean = bool(np.isfinite(np.asarray(record.scalar_sd)[fitted, 3]).any())
    flows = {h: np.asarray(diagnosis.fits[h].waves)[fitted, 2] for h in ranked}
    found = []
    for i, first in enumerate(ranked):
        for second in ranked[i + 1 :]:
            if _weight(diagnosis, first, second) <= OPEN:
                continue
            names = ("+".join(first) or "none", "+".join(second) or "none")
            of_mean, of_wave = flow_gains(flows[first], flows[second], has_mean)
            if not has_mean:
                found.append(Next("mean flow in every condition", names, min(of_mean, 99.0)))
            found.append(Next("flow waveform in every condition", names, min(of_wave, 99.0)))
    return found


def flow_gains(
    first: Float[np.ndarray, "c n"], second: Float[np.ndarray, "c n"], has_mean: bool
) -> tuple[float, float]:
    """Expected ln B of two hypotheses by their flows: if the mean is measured, and the waveform.

    A waveform carries about `FLOW_SAMPLES` independent samples, each with the error `FLOW_ERROR` of
    the mean, and a common error of the same size; a known mean leaves its shape alone.

    Args:
        first: flow predicted by one in the fitted conditions [cm³/s].
        second: by the other one.
        has_mean: whether the mean flow is known.
    """
    sd = FLOW_ERROR * np.abs(first.mean(axis=1, keepdims=True))
    apart = (first - second) / sd
    whole = apart[:, :: apart.shape[1] // FLOW_SAMPLES]
    n, mean = whole.shape[1], whole.mean(axis=1)
    shape = np.sum((whole - mean[:, None]) ** 2)
    common = 0.0 if has_mean else np.sum(mean**2) / (1.0 + 1.0 / n)
    return 0.5 * float(np.sum(apart.mean(axis=1) ** 2)), 0.5 * float(shape + common)


def isolability(
    record: Measured, effects: tuple[Effect, ...], sd: float
) -> dict[str, dict[str, float]]:
    """Effects that sets of sensors could isolate in the conditions of a record.

    Args:
        record: the conditions; its measured data are ignored.
        effects: the catalogue.
        sd: noise of pressures [dyn/cm²].

    Returns:
        By set of sensors and effect: expected ln B of a typical size against its nearest rival, "no
        gap" included; the effect is isolable from `ISOLATED` on.
    """
    found = {}
    x = jnp.zeros(n_unknowns(record))
    for name in SENSOR_SETS:
        inner = traces(linearised_base(_with_sensors(record, name, sd), effects, x))
        b = np.diag(inner)
        own = 0.5 * ((TYPICAL * b) ** 2 + b) / (1.0 + b) - 0.5 * np.log1p(b)
        other = 0.5 * ((TYPICAL * inner) ** 2 + inner**2 / np.maximum(b[:, None], 1e-12)) / (
            1.0 + b[None, :]
        ) - 0.5 * np.log1p(b[None, :])
        np.fill_diagonal(other, -np.inf)
        margin = own - np.maximum(other.max(axis=1), 0.0)
        found[name] = {e.id: float(v) for e, v in zip(effects, margin, strict=True)}
    return found


def _with_sensors(record: Measured, sensors: str, sd: float) -> Measured:
    """The record's conditions as they would be measured by a set of sensors."""
    C = record.n_conditions
    waves = {"waveforms": 2, "waveforms+flow": 2, "flow waveform as well": 3}.get(sensors, 0)
    scalar_sd = np.full((C, 4), np.inf)
    if not waves:
        scalar_sd[:, :2] = np.hypot(sd, OFFSET_SD)
    if sensors in ("means+flow", "waveforms+flow"):
        scalar_sd[:, 3] = FLOW_ERROR * 1.2
    wave_sd = np.broadcast_to(np.array([sd, sd, FLOW_ERROR * 2.0])[:waves], (C, waves))
    offset = np.broadcast_to(np.array([OFFSET_SD] * 2 + [0.1])[:waves], (C, waves))
    fields = {
        **vars(record),
        "waves": jnp.zeros((C, waves, SAMPLES)),
        "wave_sd": jnp.asarray(wave_sd),
        "wave_samples": jnp.full((C, waves), 128.0),
        "wave_offset_sd": jnp.asarray(offset),
        "scalars": jnp.zeros((C, 4)),
        "scalar_sd": jnp.asarray(scalar_sd),
        "wave_power": None,
        "modes": None,
        "inlet": None,
        "squeeze_delay": None,
        "steadiness": None,
    }
    return Measured(**fields)
