"""What a record should show: from standardised variables to harmonics, means and ratios.

The base model is the surrogate of the paper at its nominal values with the stress rule "printed".
Its unknowns have normal priors of zero mean and unit variance in the variables x:

    R0, K_known = prior exp(sd x_0),  α = 0.25 exp(x_1),  C_a, C_im, C0 = nominal exp(0.4 x_2..4),
    muscle's pressure = ventricle's (1 + 0.07 x_5),  flow past the muscle: 0.15 x_6 of the bed's,
    P_systolic, P_diastolic of each condition = recorded + P_sd x.

The ventricle's peak is the condition's P_systolic, and what of it the muscle's vessels feel nobody
measures; nor how much of the flow goes where no muscle squeezes (less than none: where the one
compartment has too little of it). Beds of several layers and branches look like that. Without x_5
six of ten such records gave a false alarm, with it none of 24; x_6 settles three of the five wrong
names of 120 that were left. A condition depends on eleven numbers only (the seven shared ones, its
two pressures, two sizes of effects): derivatives are taken by those.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from diagnosis.circuit import (
    FORCED,
    HARMONICS,
    PHASE,
    SAMPLES,
    Beat,
    Circuit,
    coefficients,
    samples,
    solve,
)
from diagnosis.effects import Effect, apply_effects
from diagnosis.measured import SENSORS, Measured
from lumped.nominal import C0_NOMINAL, NOMINAL
from lumped.stress import PRINTED, stress_rule
from lumped.units import MMHG, MMHG_S_PER_ML
from lumped.waveforms import AorticPressure, VentricularPressure

R0_PRIOR, R0_SD_LOG = 3.75 * MMHG_S_PER_ML, 0.5
"""Resistance of the ostium where the record says nothing [dyn·s/cm⁵], and its log-sd."""

ALPHA_PRIOR, ALPHA_SD_LOG = 0.25, 1.0
"""Prior of α [-] and of its logarithm."""

COMPLIANCE_SD_LOG = 0.4
"""Log-sd of C_a, C_im and C0."""

SQUEEZE_SD = 0.07
"""Standard deviation of the muscle's pressure on its vessels over the ventricle's; assumed (it
falls from the cavity's inside to nearly none outside: Hoffman & Spaan 1990, Physiol Rev 70:331)."""

PAST_SD = 0.15
"""Standard deviation of the share of the bed's conductance that lies past the muscle; assumed."""

P_SD = 2.0 * MMHG
"""Standard deviation of a recorded systolic or diastolic pressure [dyn/cm²]."""

SHARED = ("R0", "alpha", "C_a", "C_im", "C0", "squeeze", "past")
"""Unknowns that all conditions share, in the order of x."""

OWN = len(SHARED) + 2
"""Unknowns of one condition: the shared ones and its two pressures."""


class Situation(NamedTuple):
    """What is fixed about a condition; fields as in `Measured`.

    Attributes:
        period: length of the beat [s].
        P_systolic, P_diastolic: as recorded [dyn/cm²].
        stress, adenosine, dobutamine: 1 where the condition is one, else 0.
        order: order of acquisition.
        R0: prior of the ostium's resistance [dyn·s/cm⁵].
        R0_sd_log: of its logarithm.
        P_sd: of the recorded pressures [dyn/cm²].
        K, L: quadratic loss and inertance that are known with R0 [dyn·s²/cm⁸, dyn·s²/cm⁵], or
            None.
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


def situations(measured: Measured) -> Situation:
    """The settings of all conditions of one record."""
    shape = measured.period.shape
    optional = {"K": measured.K, "L": measured.L}
    given = {n: jnp.broadcast_to(v, shape) for n, v in optional.items() if v is not None}
    names = [name for name in Situation._fields if name not in optional]
    return Situation(
        **{name: jnp.broadcast_to(getattr(measured, name), shape) for name in names}, **given
    )


def n_unknowns(measured: Measured) -> int:
    """Number of unknowns of the base model."""
    return len(SHARED) + 2 * measured.n_conditions


def selection(n_conditions: int, n_more: int) -> np.ndarray:
    """Zeros and ones that take each condition's numbers out of all unknowns.

    Args:
        n_conditions: number of conditions C.
        n_more: unknowns after those of the base model, seen by all conditions.

    Returns:
        Array C × (9 + n_more) × (7 + 2C + n_more).
    """
    shared = len(SHARED)
    total = shared + 2 * n_conditions
    chosen = np.zeros((n_conditions, OWN + n_more, total + n_more))
    chosen[:, range(shared), range(shared)] = 1.0
    for c in range(n_conditions):
        chosen[c, shared, shared + 2 * c] = chosen[c, shared + 1, shared + 2 * c + 1] = 1.0
    chosen[:, range(OWN, OWN + n_more), range(total, total + n_more)] = 1.0
    return chosen


def base_circuit(case: Situation, own: Float[Array, " 9"]) -> Circuit:
    """The circuit of one condition without any effect.

    Args:
        case: the condition.
        own: its standardised unknowns.
    """
    alpha = ALPHA_PRIOR * jnp.exp(ALPHA_SD_LOG * own[1])
    loose = jnp.exp(COMPLIANCE_SD_LOG * own[2:5])
    P_systolic = case.P_systolic + case.P_sd * own[7]
    P_diastolic = case.P_diastolic + case.P_sd * own[8]
    rule = stress_rule(PRINTED)

    def bed(name: str, factor: Array) -> Array:
        return NOMINAL[name] * factor * (1.0 + case.stress * (getattr(rule, name) - 1.0))

    t = jnp.asarray(PHASE) * case.period
    zero = jnp.zeros(())
    narrower = jnp.exp(case.R0_sd_log * own[0])
    return Circuit(
        period=case.period,
        stress=case.stress,
        adenosine=case.adenosine,
        dobutamine=case.dobutamine,
        order=case.order,
        P_inlet=AorticPressure(P_systolic, P_diastolic, case.period)(t),
        P_LV=(1.0 + SQUEEZE_SD * own[5]) * VentricularPressure(P_systolic, case.period)(t),
        R0=case.R0 * narrower,
        L=zero if case.L is None else case.L,
        K=zero,
        K_known=zero if case.K is None else case.K * narrower,
        R0_wave=jnp.ones(SAMPLES),
        C0=C0_NOMINAL * loose[2],
        C_a=bed("C_a", loose[0]),
        C_im=bed("C_im", loose[1]),
        R_1=bed("R_1", alpha),
        R_2=bed("R_2", alpha),
        R_3=bed("R_3", alpha),
        wall_time=zero,
        P_venous=zero,
        G_collateral=zero,
        past=PAST_SD * own[6],
        autoregulation=zero,
        aortic_offset=zero,
        distal_offset=zero,
        distal_gain=jnp.ones(()),
        aortic_lag=zero,
        distal_delay=zero,
        forced=jnp.zeros((len(FORCED), HARMONICS + 1), complex),
    )


def predict(
    case: Situation,
    own: Float[Array, " 9"],
    effects: Sequence[Effect],
    sizes: Float[Array, " e"],
    *,
    nonlinear: bool = True,
    forced: Complex[Array, "p f"] | None = None,
) -> Beat:
    """What the sensors show of one condition.

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
        circuit = circuit._replace(forced=forced)
    return solve(circuit, nonlinear=nonlinear or case.K is not None)


def as_data(beat: Beat, n_sensors: int) -> Float[Array, " d"]:
    """A beat in the order of `measured.weights`: coefficients of the traces, then scalars."""
    means = [spectrum[0].real for spectrum in beat]
    scalars = jnp.stack([means[0], means[1], means[1] / means[0], means[2]])
    traces = [coefficients(getattr(beat, name)) for name in SENSORS[:n_sensors]]
    return jnp.concatenate([*traces, scalars])


def as_waves(beat: Beat) -> Float[Array, "3 n"]:
    """A beat as samples of all three sensors [dyn/cm², dyn/cm², cm³/s]."""
    return samples(jnp.stack(list(beat)))
