"""The surrogate in one condition of a record, with a parameter for every effect of the catalogue.

    P_inlet ─ P_ostium ─ [R0, L, K, R0_wave] ─┬─ R_1 ─┬─ P_micro ─ R_2 ─┬─ R_3 ─ P_venous
                                             C0      C_a (τ_wall)     C_im
                                             ⏚        ⏚              P_LV
    G_collateral connects the inlet to the node behind R_1 and G_epicardial to the one before it;
    G_steady connects the inlet's mean pressure to the node behind R_1; the conductance
    bypass/(R_2 + R_3) connects that node to P_venous.

With harmonics of the period (X_k, ω = 2πk/T), node by node from the right:

    P_3 = ((P_2 − P_micro)/R_2 + iωC_im P_LV + P_venous/R_3)/(1/R_2 + iωC_im + 1/R_3)
    0   = (P_1 − P_2)/R_1 + G (P_inlet − P_2) + G_s (mean P_inlet − P_2) − Y_a P_2
          − (P_2 − P_micro − P_3)/R_2 + Q_wall − bypass/(R_2 + R_3) (P_2 − P_venous)
    Q   = iωC0 P_1 + (P_1 − P_2)/R_1 − G_e (P_inlet − P_1)
    Y_a = iωC_a (e + (1 − e)/(1 + iωτ_wall))/(1 + iωτ_whole)
    P_inlet + P_ostium − P_1 = (R0 + iωL + L_layer B(ω)) Q
                               + R0 (R0_wave − 1) Q + (K + K_known R0_wave) Q|Q|
                               + K_turbulent Q|Q|^0.75,     B as of `boundary_layers`

Without the last three terms the system is linear and is solved harmonic by harmonic. With them,
Newton's method gives the first `LOW` harmonics of Q, and the linear system with the mean of the
nonlinear resistance gives the others. Derivatives are exact for the computed solution: one more
Newton step, differentiated by the implicit-function theorem. Sensors act on harmonics: lag
1/(1 + iωτ − ω²m) of first order, or of second with an inertia m = 1/ω₀²; delay exp(−iωt). Beats
start at the upstroke of the aortic trace: the lag and inertia by which it is late at its own start
(`aligned_lag`, `aligned_inertia`) smooth it there, and make the distal trace early.

Twins: with no effect the circuit is `lumped.Surrogate` solved by `lumped.Fourier`, and its bed with
effects is `lumped.extended_coronary.ExtendedCoronary` in the frequency domain, in closed form and
batched. `tests/diagnosis/test_circuit.py` and `test_boundary.py` compare them.

Units are CGS; for harmonics see `spectra`.

Source: Puelz et al. 2024, section 2.4; harmonic balance: Nakhla & Vlach 1976 (IEEE Trans Circuits
Syst 23:85).
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from diagnosis.harmonic_product import HarmonicProduct
from diagnosis.resolution import HARMONICS
from diagnosis.spectra import (
    FROM_SAMPLES,
    PHASE,
    TO_SAMPLES,
    Spectrum,
    as_harmonics,
    coefficients,
    harmonics,
)
from lumped.elimination import solve_definite
from lumped.units import MMHG

LOW = 24
"""Harmonics of the flow that a nonlinear ostium couples."""

TURBULENT_POWER = 1.75
"""Power of the flow with which turbulent friction grows (Blasius 1913)."""

LAYER_TIME = 0.06
"""τ = a²/(4ν) of a vessel of radius a = 1 mm [s], see `boundary_layers`."""

NEWTON_STEPS = 3
"""Newton steps from the linear solution, before that of the implicit-function theorem: pressures to
1e-4 mmHg for a loss of three prior widths."""

AUTOREGULATION_SWEEPS = 12
"""Fixed-point iterations for the mean pressure that controls autoregulation."""

ELASTIC_SHARE = 0.5
"""Share e of C_a that responds at once in a viscous wall: muscular arteries are up to twice as
stiff at the heart rate as in static tests (Learoyd & Taylor 1966, Circ Res 18:278)."""

ALIGNMENTS = 3
"""Passes that find the upstroke of a slow trace."""

P_REGULATED = 70.0 * MMHG
"""Mean pressure at which autoregulation changes nothing [dyn/cm²]."""

Wave = Float[Array, " n"]
Number = Float[Array, ""]
Real = Float[Array, " m"]


class Circuit(NamedTuple):
    """One condition's circuit; effects return a changed copy (`circuit._replace(...)`).

    Attributes:
        period: length of the beat [s].
        stress, adenosine, dobutamine: 1 if the condition is under stress or that drug, else 0.
        order: order of acquisition.
        P_inlet, P_LV: pressures of aorta and ventricle at the samples [dyn/cm²].
        R0, L, K: linear resistance, inertance, quadratic loss of the ostium
            [dyn·s/cm⁵, dyn·s²/cm⁵, dyn·s²/cm⁸].
        L_layer: inertance whose `boundary_layers` the ostium has [dyn·s²/cm⁵].
        K_known: quadratic loss that is known with R0 and scales with it [dyn·s²/cm⁸].
        K_turbulent: loss that grows with the power 1.75 of the flow [dyn·s^1.75/cm^7.25].
        R0_wave: factor on R0 and K_known over the beat, ones without an effect.
        C0, C_a, C_im: compliances [cm⁵/dyn].
        R_1, R_2, R_3: resistances of the bed [dyn·s/cm⁵].
        wall_time: relaxation time of the delayed part of C_a [s].
        whole_wall_time: relaxation time of all of C_a [s].
        P_venous: pressure behind R_3 [dyn/cm²].
        G_collateral: conductance from the aorta to the node behind R_1 [cm⁵/(dyn·s)].
        G_epicardial: the same to the node before R_1.
        G_steady: conductance from the aorta's mean pressure to the node behind R_1.
        bypass: conductance from that node to P_venous outside the muscle, relative to
            1/(R_2 + R_3) [-]; negative values reduce the flow through R_2 and R_3.
        autoregulation: gain of ln R_2 by the mean pressure behind R_1 [-].
        aortic_offset, distal_offset: offsets of the sensors [dyn/cm²].
        distal_gain: gain of the distal sensor [-].
        aortic_lag, distal_lag: lag of the sensors [s].
        aortic_inertia, distal_inertia: square of the inverse natural frequency [s²].
        aligned_lag, aligned_inertia: further ones of the aortic sensor, by which beats start late.
        aortic_delay, distal_delay: delay of the sensors [s].
        forced: harmonics of the waveform added at each place of `FORCED`; zero except in
            `forcing`.
    """

    period: Number
    stress: Number
    adenosine: Number
    dobutamine: Number
    order: Number
    P_inlet: Wave
    P_LV: Wave
    R0: Number
    L: Number
    L_layer: Number
    K: Number
    K_known: Number
    K_turbulent: Number
    R0_wave: Wave
    C0: Number
    C_a: Number
    C_im: Number
    R_1: Number
    R_2: Number
    R_3: Number
    wall_time: Number
    whole_wall_time: Number
    P_venous: Number
    G_collateral: Number
    G_epicardial: Number
    G_steady: Number
    bypass: Number
    autoregulation: Number
    aortic_offset: Number
    distal_offset: Number
    distal_gain: Number
    aortic_lag: Number
    distal_lag: Number
    aortic_inertia: Number
    distal_inertia: Number
    aligned_lag: Number
    aligned_inertia: Number
    aortic_delay: Number
    distal_delay: Number
    forced: Complex[Array, "p f"]


FORCED = (
    "ostium", "wall", "microvasculature", "pump", "inlet", "aortic sensor", "distal sensor",
    "flow sensor",
)  # fmt: skip
"""Places of an additional waveform: pressure in series with the ostium; flow into the node behind
R_1, times R_1; pressure in series with R_2; added to P_LV; to P_inlet; to either sensor's trace; to
the measured flow, times `FLOW_SHARE` of its mean."""

FLOW_SHARE = 0.04 / MMHG
"""Relative error of the flow that a forcing of the flow sensor makes [cm²/dyn]."""


class SensorSpectra(NamedTuple):
    """Harmonics of the signals of all sensors in one condition.

    Attributes:
        P_aorta, P_distal: measured pressures [dyn/cm²].
        Q: coronary flow as measured [cm³/s].
    """

    P_aorta: Spectrum
    P_distal: Spectrum
    Q: Spectrum


_UPSTROKE = np.flatnonzero(np.abs(PHASE - 0.148) < 0.2)
"""Samples round the middle of the upstroke, by which beats are cut."""

_WEIGHT = np.exp(-0.5 * ((PHASE[_UPSTROKE] - 0.148) / 0.05) ** 2)
_WEIGHT /= _WEIGHT.sum()
_LOW_COLUMNS = np.r_[0 : LOW + 1, HARMONICS + 1 : HARMONICS + 1 + LOW]
_LOW_PRODUCT = HarmonicProduct(LOW, LOW)


def _complex(x: Array) -> Array:
    return jax.lax.complex(x, jnp.zeros_like(x))


def _inverse(z: Spectrum) -> Spectrum:
    """1/z in real arithmetic, without the overflow guards of complex division."""
    scale = 1.0 / (z.real**2 + z.imag**2)
    return jax.lax.complex(z.real * scale, -z.imag * scale)


def solve(circuit: Circuit, *, nonlinear: bool = True) -> SensorSpectra:
    """Periodic solution of a circuit as recorded by its sensors.

    Args:
        circuit: one condition; all arrays are differentiated.
        nonlinear: include K, K_known, K_turbulent, R0_wave (static); False ignores them, faster.
    """
    omega = 2.0 * jnp.pi / circuit.period * jnp.arange(HARMONICS + 1, dtype=float)
    iw = jax.lax.complex(jnp.zeros_like(omega), omega)
    inlet, ventricle = harmonics(jnp.stack([circuit.P_inlet, circuit.P_LV]))
    ostium, wall, micro, pump, root, at_aorta, at_distal, at_flow = circuit.forced
    g_1, g_3 = _complex(1.0 / circuit.R_1), _complex(1.0 / circuit.R_3)
    g_2 = _complex(1.0 / (circuit.R_2 * autoregulated(circuit)))
    g_across, R0 = _complex(circuit.G_collateral), _complex(circuit.R0)
    g_steady, g_epicardial = _complex(circuit.G_steady), _complex(circuit.G_epicardial)
    g_bypass = _complex(bypass_conductance(circuit))
    inlet, ventricle, wall = inlet + root, ventricle + pump, wall * g_1
    first = jnp.asarray(np.eye(1, HARMONICS + 1)[0])
    venous = _complex(circuit.P_venous * first)

    y_im = iw * _complex(circuit.C_im)
    yielding = (1.0 - ELASTIC_SHARE) * _inverse(1.0 + iw * _complex(circuit.wall_time))
    whole = _inverse(1.0 + iw * _complex(circuit.whole_wall_time))
    y_a = iw * _complex(circuit.C_a) * (ELASTIC_SHARE + yielding) * whole
    z_3 = _inverse(g_2 + y_im + g_3)
    source_3 = (y_im * ventricle + g_3 * venous - g_2 * micro) * z_3
    z_2 = _inverse(g_1 + g_across + g_steady + g_bypass + y_a + g_2 * (1.0 - g_2 * z_3))
    fed = (g_across + _complex(circuit.G_steady * first)) * inlet
    source_2 = (fed + g_bypass * venous + wall + g_2 * (micro + source_3)) * z_2
    Z = _inverse(iw * _complex(circuit.C0) + g_epicardial + g_1 * (1.0 - g_1 * z_2))
    source_1 = (g_1 * source_2 + g_epicardial * inlet) * Z

    drive = inlet + ostium - source_1
    layer = boundary_layers(omega) * _complex(circuit.L_layer)
    series = Z + R0 + iw * _complex(circuit.L) + layer
    Q = drive * _inverse(series)
    if nonlinear:
        Q = _nonlinear_flow(circuit, drive, series, Q)
    seen = sensed(circuit, SensorSpectra(inlet, Z * Q + source_1, Q))
    Q_seen = Q + _complex(FLOW_SHARE * Q[0].real) * at_flow
    return SensorSpectra(seen.P_aorta + at_aorta, seen.P_distal + at_distal, Q_seen)


def boundary_layers(omega: Real) -> Spectrum:
    """What the boundary layers of an oscillating flow add to R + iωL, over L [1/s].

    With s = iωτ,   (√(s + c²) − c)/τ,   c = 5/4:

    for fast oscillations the first two terms of Womersley's impedance beyond s, for slow ones his
    4/3 of the inertance as 1.4. Source: Womersley 1955, J Physiol 127:553.

    Args:
        omega: angular frequencies [1/s].
    """
    c, y = 1.25, omega * LAYER_TIME
    real = jnp.sqrt(0.5 * (jnp.sqrt(c**4 + y**2) + c**2))
    return jax.lax.complex(real - c, 0.5 * y / real) / LAYER_TIME


def sensed(circuit: Circuit, true: SensorSpectra) -> SensorSpectra:
    """Signals of the sensors of a circuit for given true pressures.

    Args:
        circuit: gives offsets, gain, lags and delays.
        true: pressures at the sensors, from this circuit or another model.
    """
    omega = 2.0 * jnp.pi / circuit.period * jnp.arange(HARMONICS + 1, dtype=float)
    first = jnp.asarray(np.eye(1, HARMONICS + 1)[0])

    def late(P: Spectrum, lag: Number, inertia: Number, delay: Number) -> Spectrum:
        lagged = P * _inverse(jax.lax.complex(1.0 - omega**2 * inertia, omega * lag))
        return lagged * jax.lax.complex(jnp.cos(delay * omega), -jnp.sin(delay * omega))

    start = _start(circuit, true.P_aorta, omega)
    lag = circuit.aortic_lag + circuit.aligned_lag
    inertia = circuit.aortic_inertia + circuit.aligned_inertia
    aortic = late(true.P_aorta, lag, inertia, circuit.aortic_delay - start)
    distal = _complex(circuit.distal_gain) * true.P_distal
    distal = late(distal, circuit.distal_lag, circuit.distal_inertia, circuit.distal_delay - start)
    return SensorSpectra(
        aortic + _complex(circuit.aortic_offset * first),
        distal + _complex(circuit.distal_offset * first),
        true.Q,
    )


def _start(circuit: Circuit, true: Spectrum, omega: Real) -> Number:
    """How late beats start [s] that are cut at the upstroke of a slow trace.

    Least squares of the true pressure on the seen one s and its slope: m = a s + b s′, b/a later.
    """
    seen = true * _inverse(
        jax.lax.complex(1.0 - omega**2 * circuit.aligned_inertia, omega * circuit.aligned_lag)
    )
    turn = jax.lax.complex(jnp.zeros_like(omega), omega)
    synthesis, weight = jnp.asarray(TO_SAMPLES[_UPSTROKE].T), jnp.asarray(_WEIGHT)

    def about_mean(spectra: Complex[Array, "k f"]) -> Float[Array, "k n"]:
        waves = coefficients(spectra) @ synthesis
        return waves - (waves @ weight)[:, None]

    m = about_mean(true[None])

    def later(_: Any, late: Number) -> Number:
        moved = seen * jax.lax.complex(jnp.cos(omega * late), jnp.sin(omega * late))
        s = about_mean(jnp.stack([moved, moved * turn]))
        weighted = weight[None] * s
        C, c = weighted @ s.T, (weighted @ m.T)[:, 0]
        return late + (C[0, 0] * c[1] - C[0, 1] * c[0]) / (C[1, 1] * c[0] - C[0, 1] * c[1])

    return jax.lax.fori_loop(0, ALIGNMENTS, later, jnp.zeros(()))


def bypass_conductance(circuit: Circuit) -> Number:
    """Conductance from the node behind R_1 to P_venous outside the muscle [cm⁵/(dyn·s)]."""
    return circuit.bypass / (circuit.R_2 + circuit.R_3)


def autoregulated(circuit: Circuit) -> Number:
    """Factor on R_2 by autoregulation, exp(gain (mean P_2 − P)/P) with P = `P_REGULATED` [-].

    The mean of P_2 is that of the direct-current network without the quadratic loss of the ostium,
    which changes it by a few mmHg.
    """
    inlet = jnp.mean(circuit.P_inlet)
    R_in = circuit.R0 / (1.0 + circuit.R0 * circuit.G_epicardial) + circuit.R_1
    G_in = 1.0 / R_in + circuit.G_collateral + circuit.G_steady
    g_bypass = bypass_conductance(circuit)

    def sweep(_: Any, log_factor: Number) -> Number:
        g_bed = 1.0 / (circuit.R_2 * jnp.exp(log_factor) + circuit.R_3) + g_bypass
        mean = (G_in * inlet + g_bed * circuit.P_venous) / (G_in + g_bed)
        return circuit.autoregulation * (mean - P_REGULATED) / P_REGULATED

    return jnp.exp(jax.lax.fori_loop(0, AUTOREGULATION_SWEEPS, sweep, jnp.zeros(())))


def _nonlinear_flow(
    circuit: Circuit, drive: Spectrum, series: Spectrum, linear: Spectrum
) -> Spectrum:
    """Harmonics of the flow through an ostium with K, K_known, K_turbulent and R0_wave."""
    low = slice(0, LOW + 1)
    extra = circuit.R0 * (circuit.R0_wave - 1.0)
    K = circuit.K + circuit.K_known * circuit.R0_wave
    synthesis = jnp.asarray(TO_SAMPLES[:, _LOW_COLUMNS])
    analysis = jnp.asarray(FROM_SAMPLES[_LOW_COLUMNS])

    def loss(q: Real) -> Wave:
        Q = synthesis @ q
        return (extra + K * jnp.abs(Q) + circuit.K_turbulent * _turbulent(Q)) * Q

    def slope(Q: Wave) -> Wave:
        turbulent = TURBULENT_POWER * circuit.K_turbulent * _turbulent(Q)
        return extra + 2.0 * K * jnp.abs(Q) + turbulent

    def residual(q: Real) -> Real:
        lost = analysis @ loss(q)
        return coefficients(series[low] * as_harmonics(q)) + lost - coefficients(drive[low])

    def jacobian(q: Real) -> Float[Array, "m m"]:
        return _block(series[low]) + _LOW_PRODUCT(slope(synthesis @ q))

    constant = jax.lax.stop_gradient

    def newton(_: Any, q: Real) -> Real:
        step = solve_definite(constant(jacobian(q)), constant(residual(q))[:, None])
        return constant(q - step[:, 0])

    q = jax.lax.fori_loop(0, NEWTON_STEPS, newton, constant(coefficients(linear[low])))
    q = constant(q)
    # leaves the value unchanged and gives the derivative by the implicit-function theorem
    q = q - solve_definite(constant(jacobian(q)), jnp.eye(q.shape[0])) @ residual(q)
    mean_resistance = jnp.mean(slope(synthesis @ q))
    lost = harmonics(loss(q))
    high = (drive - lost) * _inverse(series + _complex(mean_resistance))
    return jnp.concatenate([as_harmonics(q), high[LOW + 1 :]])


def _turbulent(Q: Wave) -> Wave:
    """|Q|^0.75, rounded off at zero [(cm³/s)^0.75]."""
    return (Q**2 + 1e-12) ** (0.5 * (TURBULENT_POWER - 1.0))


def _block(z: Spectrum) -> Float[Array, "k k"]:
    """Matrix that acts on real coefficients as multiplication by z acts on harmonics."""
    re, im = z.real, z.imag[1:]
    a = jnp.diag(jnp.concatenate([re, re[1:]]))
    k = jnp.arange(1, LOW + 1)
    return a.at[k, k + LOW].set(-im).at[k + LOW, k].set(im)
