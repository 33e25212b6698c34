"""Predicted data of a record: from standardised variables to harmonics, means and ratios.

The base model is the surrogate of Puelz et al. 2024 at its nominal values with the stress rule
"printed". Its unknowns have standard normal priors in the variables x:

    R0, K_known = prior exp(sd x_0),  α = 0.25 exp(x_1),  C_a, C_im, C0 = nominal exp(0.4 x_2..4),
    intramyocardial pressure = P_LV (1 + 0.02 x_5),  bypass conductance = 0.04 x_6/(R_2 + R_3),
    start of the squeeze = its delay + 0.05 T x_7 where a record has one, else as assumed,
    P_systolic, P_diastolic of each condition = recorded + P_sd x.

The peak of P_LV is the systolic pressure of the condition. The fraction of it transmitted to the
intramyocardial vessels, and the flow bypassing the muscle, are unmeasured; the latter is negative
if one compartment underestimates the flow through the muscle. Both stand for beds of several layers
and branches: without x_5 six of ten such records gave a false alarm, with it none of 24; x_6
removes three of the remaining five wrong names in 120 records. Where the aortic waveform is not the
assumed one (`inlet`), its start no longer tells when the ventricle contracts: x_7. A condition
depends on twelve numbers only (eight shared ones, its two pressures, two effect sizes); derivatives
are taken with respect to those.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from diagnosis.circuit import FORCED, Circuit, SensorSpectra, solve
from diagnosis.effects import Effect, apply_effects
from diagnosis.measured import SENSORS, Measured
from diagnosis.resolution import HARMONICS, SAMPLES
from diagnosis.spectra import FROM_SAMPLES, PHASE, coefficients, samples
from lumped.nominal import C0_NOMINAL, NOMINAL
from lumped.stress import PRINTED, stress_rule
from lumped.units import MMHG, MMHG_S_PER_ML
from lumped.waveforms import AorticPressure, VentricularPressure

R0_PRIOR, R0_SD_LOG = 3.75 * MMHG_S_PER_ML, 0.5
"""Default resistance of the ostium [dyn·s/cm⁵], and the sd of its logarithm."""

ALPHA_PRIOR, ALPHA_SD_LOG = 0.25, 1.0
"""Prior of α [-] and of its logarithm."""

COMPLIANCE_SD_LOG = 0.4
"""Standard deviation of the logarithms of C_a, C_im and C0."""

TRANSMISSION_SD = 0.02
"""Standard deviation of the ratio of intramyocardial to ventricular pressure where equations are
exact; assumed. Guessed ones have more, see `hypothesis.GUESSED_TRANSMISSION`."""

BYPASS_SD = 0.04
"""Standard deviation of the bypass conductance relative to 1/(R_2 + R_3) where equations are exact;
assumed. Guessed ones have more, see `hypothesis.GUESSED_BYPASS`."""

SQUEEZE_SD = 0.05
"""Standard deviation of the delay of the ventricular pressure where the aortic waveform is not the
assumed one [beats]; assumed."""

P_SD = 2.0 * MMHG
"""Standard deviation of a recorded systolic or diastolic pressure [dyn/cm²]."""

SHARED = ("R0", "alpha", "C_a", "C_im", "C0", "transmission", "bypass", "squeeze")
"""Unknowns that all conditions share, in the order of x."""

OWN = len(SHARED) + 2
"""Unknowns of one condition: the shared ones and its two pressures."""


class ConditionSettings(NamedTuple):
    """Fixed settings of a condition; fields as in `Measured`.

    Attributes:
        period: length of the beat [s].
        P_systolic, P_diastolic: as recorded [dyn/cm²].
        stress, adenosine, dobutamine: 1 if the condition is under stress or that drug, else 0.
        order: order of acquisition.
        R0: prior of the ostium's resistance [dyn·s/cm⁵].
        R0_sd_log: of its logarithm.
        P_sd: of the recorded pressures [dyn/cm²].
        K, L: quadratic loss and inertance that are known with R0 [dyn·s²/cm⁸, dyn·s²/cm⁵], or
            None.
        inlet: added to the aortic pressure at the samples [dyn/cm²], or None.
        squeeze_delay: of the ventricular pressure [beats], or None.
    """

    period: Float[Array, "*c"]
    P_systolic: Float[Array, "*c"]
    P_diastolic: Float[Array, "*c"]
    stress: Float[Array, "*c"]
    adenosine: Float[Array, "*c"]
    dobutamine: Float[Array, "*c"]
    order: Float[Array, "*c"]
    R0: Float[Array, "*c"]
    R0_sd_log: Float[Array, "*c"]
    P_sd: Float[Array, "*c"]
    K: Float[Array, "*c"] | None = None
    L: Float[Array, "*c"] | None = None
    inlet: Float[Array, "*c n"] | None = None
    squeeze_delay: Float[Array, "*c"] | None = None


def condition_settings(measured: Measured) -> ConditionSettings:
    """The settings of all conditions of one record."""
    shape = measured.period.shape
    optional = {name: getattr(measured, name) for name in ("K", "L", "squeeze_delay")}
    given = {n: jnp.broadcast_to(v, shape) for n, v in optional.items() if v is not None}
    names = [n for n in ConditionSettings._fields if n not in optional and n != "inlet"]
    return ConditionSettings(
        **{name: jnp.broadcast_to(getattr(measured, name), shape) for name in names},
        **given,
        inlet=measured.inlet,
    )


def n_unknowns(measured: Measured) -> int:
    """Number of unknowns of the base model."""
    return len(SHARED) + 2 * measured.n_conditions


def selection(n_conditions: int, n_more: int) -> np.ndarray:
    """Selection matrices: the unknowns of each condition among all unknowns.

    Args:
        n_conditions: number of conditions C.
        n_more: further unknowns that all conditions share.

    Returns:
        Array C × (10 + n_more) × (8 + 2C + n_more).
    """
    shared = len(SHARED)
    total = shared + 2 * n_conditions
    chosen = np.zeros((n_conditions, OWN + n_more, total + n_more))
    chosen[:, range(shared), range(shared)] = 1.0
    for c in range(n_conditions):
        chosen[c, shared, shared + 2 * c] = chosen[c, shared + 1, shared + 2 * c + 1] = 1.0
    chosen[:, range(OWN, OWN + n_more), range(total, total + n_more)] = 1.0
    return chosen


def base_circuit(case: ConditionSettings, own: Float[Array, " 10"]) -> Circuit:
    """The circuit of one condition without any effect.

    Args:
        case: the condition.
        own: its standardised unknowns.
    """
    alpha = ALPHA_PRIOR * jnp.exp(ALPHA_SD_LOG * own[1])
    loose = jnp.exp(COMPLIANCE_SD_LOG * own[2:5])
    P_systolic = case.P_systolic + case.P_sd * own[8]
    P_diastolic = case.P_diastolic + case.P_sd * own[9]
    rule = stress_rule(PRINTED)

    def bed(name: str, factor: Array) -> Array:
        return NOMINAL[name] * factor * (1.0 + case.stress * (getattr(rule, name) - 1.0))

    t = jnp.asarray(PHASE) * case.period
    zero = jnp.zeros(())
    narrower = jnp.exp(case.R0_sd_log * own[0])
    P_inlet = AorticPressure(P_systolic, P_diastolic, case.period)(t)
    late = zero if case.squeeze_delay is None else case.squeeze_delay + SQUEEZE_SD * own[7]
    P_LV = VentricularPressure(P_systolic, case.period)(t - late * case.period)
    return Circuit(
        period=case.period,
        stress=case.stress,
        adenosine=case.adenosine,
        dobutamine=case.dobutamine,
        order=case.order,
        P_inlet=P_inlet if case.inlet is None else P_inlet + case.inlet,
        P_LV=(1.0 + TRANSMISSION_SD * own[5]) * P_LV,
        R0=case.R0 * narrower,
        L=zero if case.L is None else case.L,
        L_layer=zero,
        K=zero,
        K_known=zero if case.K is None else case.K * narrower,
        K_turbulent=zero,
        R0_wave=jnp.ones(SAMPLES),
        C0=C0_NOMINAL * loose[2],
        C_a=bed("C_a", loose[0]),
        C_im=bed("C_im", loose[1]),
        R_1=bed("R_1", alpha),
        R_2=bed("R_2", alpha),
        R_3=bed("R_3", alpha),
        wall_time=zero,
        whole_wall_time=zero,
        P_venous=zero,
        G_collateral=zero,
        G_epicardial=zero,
        G_steady=zero,
        bypass=BYPASS_SD * own[6],
        autoregulation=zero,
        aortic_offset=zero,
        distal_offset=zero,
        distal_gain=jnp.ones(()),
        aortic_lag=zero,
        distal_lag=zero,
        aortic_inertia=zero,
        distal_inertia=zero,
        aligned_lag=zero,
        aligned_inertia=zero,
        aortic_delay=zero,
        distal_delay=zero,
        forced=jnp.zeros((len(FORCED), HARMONICS + 1), complex),
    )


def predict(
    case: ConditionSettings,
    own: Float[Array, " 10"],
    effects: Sequence[Effect],
    sizes: Float[Array, " e"],
    *,
    nonlinear: bool = True,
    forced: Complex[Array, "p f"] | None = None,
) -> SensorSpectra:
    """Predicted harmonics of the sensors in one condition.

    Args:
        case: the condition.
        own: its standardised unknowns.
        effects: the effects.
        sizes: size of each [its unit]; zero changes nothing.
        nonlinear: see `circuit.solve` (static); with a known K it always is.
        forced: waveforms added at places, see `circuit.Circuit`.
    """
    circuit = apply_effects(base_circuit(case, own), effects, sizes)
    if forced is not None:
        circuit = circuit._replace(forced=circuit.forced + forced)
    return solve(circuit, nonlinear=nonlinear or case.K is not None)


def observations(beat: SensorSpectra, n_sensors: int) -> Float[Array, " d"]:
    """Predicted data in the order of `measured.weights`: coefficients of traces, then scalars."""
    means = [spectrum[0].real for spectrum in beat]
    scalars = jnp.stack([means[0], means[1], means[1] / means[0], means[2]])
    traces = [coefficients(getattr(beat, name)) for name in SENSORS[:n_sensors]]
    return jnp.concatenate([*traces, scalars])


def data_of_waves(waves: Float[Array, "c 3 n"], n_sensors: int) -> Float[Array, "c d"]:
    """What `observations` gives, of samples of all three sensors by condition."""
    traces = waves[:, :n_sensors] @ jnp.asarray(FROM_SAMPLES.T)
    aorta, distal, flow = jnp.moveaxis(waves.mean(axis=-1), 1, 0)
    scalars = jnp.stack([aorta, distal, distal / aorta, flow], axis=1)
    return jnp.concatenate([traces.reshape(waves.shape[0], -1), scalars], axis=1)


def as_waves(beat: SensorSpectra) -> Float[Array, "3 n"]:
    """Samples of all three sensors [dyn/cm², dyn/cm², cm³/s]."""
    return samples(jnp.stack(list(beat)))
