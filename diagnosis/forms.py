"""Further forms of the effects of the catalogue: other equations for the same cause.

Symbols as in `circuit` and `catalogue`; P̂ is the aortic pressure behind a first-order lag, P̄ a mean
over the beat, k the order of acquisition. Every form changes nothing at size zero and agrees with
the first form of its effect in unit and expected size.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from diagnosis.changes import Added, Bell, Change, Resonance, Scaled
from diagnosis.circuit import Circuit
from diagnosis.effects import Form
from diagnosis.resolution import HARMONICS
from diagnosis.spectra import PHASE, harmonics, samples
from lumped.units import MMHG

P_NARROWING = 80.0 * MMHG
"""Aortic pressure at which dynamic narrowing neither adds nor removes [dyn/cm²]."""

P_AORTA_REGULATED = 85.0 * MMHG
"""Mean aortic pressure at which autoregulation changes nothing [dyn/cm²]."""

NARROWING_LAG = 0.06
"""Time constant with which a viscous wall follows the aortic pressure [s]; assumed."""

SQUEEZE_DELAY = 0.1
"""Delay of the squeeze behind the ventricular pressure at size one [beats]; assumed. The base model
states the times of the ventricle in parts of the beat too."""

SQUEEZE_LATENESS = 0.06
"""The same as a time of its own, which the heart rate does not change [s]; assumed."""

RINGING, UNDERDAMPED, MIDDLE, DAMPED, OVERDAMPED = 0.12, 0.22, 0.4, 0.75, 1.3
"""Damping ratios of fluid-filled catheters: 0.07 to 0.7, above one with a bubble or a clot."""

STRESS_LEAVES = 0.5
"""Share of a back pressure that vessels dilated under stress keep; assumed."""

PEAK_PRESSURE = 80.0
"""Size at which the phase of the aortic pressure moves by t/T ln(t/T) [mmHg]; assumed. The expected
size moves the peak by 0.02 beats."""

_WARP = PHASE * np.log(np.maximum(PHASE, 1e-12))
"""t/T ln(t/T): nothing at both ends of the beat."""

_FALL = 1.0 / (1.0 + np.exp(-(PHASE - 0.18) / 0.02)) / (1.0 + np.exp((PHASE - 0.8) / 0.02))
"""Part of the beat in which the ventricular pressure falls: 1 there, 0 while it rises."""

_HALF_SINE = np.sin(np.pi * np.clip((PHASE - 0.0692) / (0.4 - 0.0692), 0.0, 1.0))
"""Half a sine between the start and the end of the ventricular pressure."""

INERTIA_OF_STENOSIS = 0.02
"""L/K of a stenosis [ml]: L = ρl/A, K = ρ/(2A²)·1.5, with l A of 0.01 to 0.03 ml."""

LN_2 = float(np.log(2.0))


def collateral(name: str) -> Change:
    """A conductance φ/(R_1 + R_2 + R_3) added to one of the circuit's."""

    def change(c: Circuit, size: Array) -> Circuit:
        G = size / (c.R_1 + c.R_2 + c.R_3)
        return c._replace(**{name: getattr(c, name) + G})

    return change


def lagged_narrowing(c: Circuit, size: Array) -> Circuit:
    """Narrowing that follows the aortic pressure with a lag."""
    omega = 2.0 * jnp.pi / c.period * jnp.arange(HARMONICS + 1, dtype=float)
    late = harmonics(c.P_inlet) / (
        1.0 + jax.lax.complex(jnp.zeros_like(omega), omega) * NARROWING_LAG
    )
    wave = jnp.exp(size * (samples(late) - P_NARROWING) / P_NARROWING)
    return c._replace(R0_wave=c.R0_wave * wave)


def tube_narrowing(c: Circuit, size: Array) -> Circuit:
    """Narrowing of a tube whose area saturates, with a resistance as area to the power −2."""
    area = 1.0 - 0.5 * jnp.tanh(size * (c.P_inlet - P_NARROWING) / P_NARROWING)
    return c._replace(R0_wave=c.R0_wave * area**-2.0)


def late_squeeze(c: Circuit, size: Array) -> Circuit:
    """Ventricular pressure on the vessels later by φ times `SQUEEZE_DELAY`."""
    return c._replace(P_LV=c.P_LV + _later(c.P_LV, size * SQUEEZE_DELAY))


def squeeze_late_by_a_time(c: Circuit, size: Array) -> Circuit:
    """Ventricular pressure on the vessels later by φ times `SQUEEZE_LATENESS`."""
    return c._replace(P_LV=c.P_LV + _later(c.P_LV, size * SQUEEZE_LATENESS / c.period))


def rounder_squeeze(c: Circuit, size: Array) -> Circuit:
    """Ventricular pressure nearer to half a sine of the same peak by φ."""
    return c._replace(P_LV=c.P_LV + size * (jnp.max(c.P_LV) * jnp.asarray(_HALF_SINE) - c.P_LV))


def _later(wave: Array, delay: Array) -> Array:
    """What a delay [beats] changes of a waveform, in its harmonics."""
    turn = 2.0 * jnp.pi * delay * jnp.arange(HARMONICS + 1, dtype=float)
    late = harmonics(wave) * jax.lax.complex(jnp.cos(turn) - 1.0, -jnp.sin(turn))
    return samples(late)


def shorter_squeeze(c: Circuit, size: Array) -> Circuit:
    """Ventricular pressure under dobutamine whose fall is earlier by φ times `SQUEEZE_DELAY`."""
    early = _later(c.P_LV, -c.dobutamine * size * SQUEEZE_DELAY)
    return c._replace(P_LV=c.P_LV + jnp.asarray(_FALL) * early)


def transmural_narrowing(c: Circuit, size: Array) -> Circuit:
    """Narrowing by the aortic pressure less that in the vessel, which flow lowers by R0 Q.

    exp(φ (P_aorta − 80 + R0 Q)/80), to first order in R0 Q.
    """
    wave = jnp.exp(size * (c.P_inlet - P_NARROWING) / P_NARROWING)
    return c._replace(R0_wave=c.R0_wave * wave, K=c.K + size * c.R0**2 / P_NARROWING)


def harder_shorter_squeeze(c: Circuit, size: Array) -> Circuit:
    """`shorter_squeeze` that is stronger too, by φ."""
    shorter = shorter_squeeze(c, size)
    return shorter._replace(P_LV=shorter.P_LV * (1.0 + c.dobutamine * size))


def narrowing_under_stress(c: Circuit, size: Array) -> Circuit:
    """Narrowing by the aortic pressure that stress alone brings."""
    wave = jnp.exp(c.stress * size * (c.P_inlet - P_NARROWING) / P_NARROWING)
    return c._replace(R0_wave=c.R0_wave * wave)


def stress_narrowing_by_pressure(c: Circuit, size: Array) -> Circuit:
    """Narrowing under stress that is strong where the aortic pressure is."""
    return c._replace(R0_wave=c.R0_wave * jnp.exp(c.stress * size * c.P_inlet / P_NARROWING))


def loss_with_inertia(c: Circuit, size: Array) -> Circuit:
    """A stenosis with the inertia of its own blood."""
    K = size * MMHG
    return c._replace(K=c.K + K, L=c.L + INERTIA_OF_STENOSIS * K)


def inertia_with_layers(c: Circuit, size: Array) -> Circuit:
    """The inertance of an oscillating flow with the shear of its boundary layers."""
    return c._replace(L=c.L + size * MMHG, L_layer=c.L_layer + size * MMHG)


def back_pressure_at_rest(c: Circuit, size: Array) -> Circuit:
    """A back pressure of which stress leaves the share `STRESS_LEAVES`."""
    left = 1.0 - (1.0 - STRESS_LEAVES) * c.stress
    return c._replace(P_venous=c.P_venous + left * size * MMHG)


def aortic_regulation(*names: str) -> Change:
    """Resistances that follow the mean aortic pressure."""

    def change(c: Circuit, size: Array) -> Circuit:
        mean = jnp.mean(c.P_inlet)
        factor = jnp.exp(size * (mean - P_AORTA_REGULATED) / P_AORTA_REGULATED)
        return c._replace(**{name: getattr(c, name) * factor for name in names})

    return change


def stated_zero(c: Circuit, size: Array) -> Circuit:
    """A wrong zero of the transducer that also gave the stated pressures: true ones are lower."""
    true = c.P_inlet - size * MMHG
    squeeze = 1.0 - size * MMHG / jnp.max(c.P_inlet)
    return c._replace(
        P_inlet=true, P_LV=c.P_LV * squeeze, aortic_offset=c.aortic_offset + size * MMHG
    )


def other_peak(c: Circuit, size: Array) -> Circuit:
    """An aortic pressure that rises earlier, or later, and peaks so; to first order in the size."""
    turn = 2.0 * jnp.pi * jnp.arange(HARMONICS + 1, dtype=float)
    slope = samples(harmonics(c.P_inlet) * jax.lax.complex(jnp.zeros_like(turn), turn))
    return c._replace(P_inlet=c.P_inlet + size / PEAK_PRESSURE * jnp.asarray(_WARP) * slope)


def drift(shape: Callable[[Array], Array]) -> Change:
    """A distal offset of φ mmHg times a function of the order of acquisition."""
    return lambda c, size: c._replace(distal_offset=c.distal_offset + shape(c.order) * size * MMHG)


FORMS: dict[str, tuple[Form, ...]] = {
    "quadratic_loss": (
        Form("turbulent friction", "ΔP = R0 Q + φ Q|Q|^0.75", Added("K_turbulent", MMHG)),
        Form("with inertia", "ΔP = R0 Q + φ (Q|Q| + 0.02 dQ/dt)", loss_with_inertia),
    ),
    "dynamic_narrowing": (
        Form("lagging", "R0 exp(φ (P̂_aorta − 80)/80), lag 60 ms", lagged_narrowing),
        Form("tube law", "R0 (1 − ½ tanh(φ (P_aorta − 80)/80))⁻²", tube_narrowing),
        Form("under stress", "R0 exp(s φ (P_aorta − 80)/80)", narrowing_under_stress),
        Form("transmural", "R0 exp(φ (P_aorta + R0 Q − 80)/80)", transmural_narrowing),
    ),
    "inertance": (
        Form("with boundary layers", "L dQ/dt with the layers of an oscillating flow, L = φ",
             inertia_with_layers),
    ),
    "stress_narrowing": (
        Form("dobutamine alone", "R0 exp(d φ)", Scaled(("R0", "K_known"), 1.0, "dobutamine")),
        Form("with the pressure", "R0 exp(s φ P_aorta/80)", stress_narrowing_by_pressure, True),
    ),
    "vasodilation": (
        Form("R_2 alone", "R_2 exp(−s φ)", Scaled(("R_2",), -1.0, "stress")),
        Form("R_1 and R_2", "R_1, R_2 exp(−s φ)", Scaled(("R_1", "R_2",), -1.0, "stress")),
    ),
    "adenosine_vasodilation": (
        Form("R_2 alone", "R_2 exp(−a φ)", Scaled(("R_2",), -1.0, "adenosine")),
        Form("R_1 and R_2", "R_1, R_2 exp(−a φ)", Scaled(("R_1", "R_2",), -1.0, "adenosine")),
        Form("R_1 alone", "R_1 exp(−a φ)", Scaled(("R_1",), -1.0, "adenosine")),
    ),
    "r1_r3_dilation": (
        Form("R_1 alone", "R_1 2^(−s φ)", Scaled(("R_1",), -LN_2, "stress")),
        Form("R_3 alone", "R_3 2^(−s φ)", Scaled(("R_3",), -LN_2, "stress")),
    ),
    "autoregulation": (
        Form("by aortic pressure", "R_2 exp(φ (P̄_aorta − 85)/85)", aortic_regulation("R_2")),
        Form(
            "of arterioles by aortic pressure", "R_1, R_2 exp(φ (P̄_aorta − 85)/85)",
            aortic_regulation("R_1", "R_2"),
        ),
    ),
    "stress_compliance": (
        Form("C_a alone", "C_a exp(s φ)", Scaled(("C_a",), 1.0, "stress")),
        Form("of arteries", "C0, C_a exp(s φ)", Scaled(("C0", "C_a"), 1.0, "stress")),
        Form("C_im alone", "C_im exp(s φ)", Scaled(("C_im",), 1.0, "stress")),
    ),
    "back_pressure": (
        Form("less under stress", "P_venous = φ (1 − s/2)", back_pressure_at_rest),
    ),
    "collateral_flow": (
        Form(
            "into the epicardial vessel", "G = φ/(R_1 + R_2 + R_3) to the node before R_1",
            collateral("G_epicardial"),
        ),
        Form("steady", "G as above, from the mean aortic pressure", collateral("G_steady")),
    ),
    "intramyocardial_pump": (
        Form("late", "P_LV(t − φ T/10)", late_squeeze),
        Form("late by a time", "P_LV(t − φ 60 ms)", squeeze_late_by_a_time),
        Form("rounder", "P_LV + φ (half a sine − P_LV)", rounder_squeeze),
    ),
    "dobutamine_inotropy": (
        Form("shorter", "P_LV(t + d φ T/10) once it falls", shorter_squeeze),
        Form("harder and shorter", "P_LV(t + d φ T/10) (1 + d φ), the delay once it falls",
             harder_shorter_squeeze),
    ),
    "wall_viscoelasticity": (
        Form("Voigt", "C_a/(1 + iωφ)", Added("whole_wall_time")),
    ),
    "wire_drift": (
        Form("slowing down", "P_distal + √k φ", drift(lambda k: jnp.sqrt(jnp.maximum(k, 0.0)))),
        Form("after rest", "P_distal + φ in all conditions after the first",
             drift(lambda k: jnp.minimum(k, 1.0))),
    ),
    "aortic_zero_error": (
        Form("stated pressures as well", "P_aorta + φ, stated P_aorta + φ", stated_zero),
    ),
    "catheter_damping": (
        Form("underdamped", "second order, ω₀ = 2ζ/φ, ζ = 0.22", Resonance("aortic", UNDERDAMPED)),
        Form("resonant", "second order, ω₀ = 2ζ/φ, ζ = 0.4", Resonance("aortic", MIDDLE)),
        Form("second order", "second order, ω₀ = 2ζ/φ, ζ = 0.75", Resonance("aortic", DAMPED)),
        Form("ringing", "second order, ω₀ = 2ζ/φ, ζ = 0.12", Resonance("aortic", RINGING)),
        Form("overdamped", "second order, ω₀ = 2ζ/φ, ζ = 1.3", Resonance("aortic", OVERDAMPED)),
        Form("aligned", "lag φ, beats from the upstroke of the trace",
             Added("aligned_lag")),
        Form("aligned, underdamped", "second order, ζ = 0.22, beats from the upstroke of the trace",
             Resonance("aligned", UNDERDAMPED)),
        Form("aligned, resonant", "second order, ζ = 0.4, beats from the upstroke of the trace",
             Resonance("aligned", MIDDLE)),
    ),
    "distal_damping": (
        Form("underdamped", "second order, ω₀ = 2ζ/φ, ζ = 0.22", Resonance("distal", UNDERDAMPED)),
        Form("resonant", "second order, ω₀ = 2ζ/φ, ζ = 0.4", Resonance("distal", MIDDLE)),
        Form("second order", "second order, ω₀ = 2ζ/φ, ζ = 0.75", Resonance("distal", DAMPED)),
        Form("ringing", "second order, ω₀ = 2ζ/φ, ζ = 0.12", Resonance("distal", RINGING)),
    ),
    "signal_delay": (
        Form("of the aortic trace", "P_aorta(t + φ)",
             Added("aortic_delay", -1.0)),
    ),
    "aortic_waveform": (
        Form("early", "bell at 0.33 beats", Bell(0.33, 0.03)),
        Form("late", "bell at 0.47 beats", Bell(0.47, 0.03)),
        Form("broad", "bell of width 0.08 beats at 0.3", Bell(0.30, 0.08)),
        Form("narrow", "bell of width 0.015 beats", Bell(0.40, 0.015)),
        Form("incisura", "dip and rebound at 0.4 beats", Bell(0.40, 0.03, rebound=True)),
        Form("diastolic wave", "bell of width 0.06 beats at 0.55", Bell(0.55, 0.06)),
        Form("another peak", "P_aorta + φ/80 t ln(t/T) dP_aorta/dt", other_peak),
    ),
}  # fmt: skip
"""Further forms by id of the effect."""
