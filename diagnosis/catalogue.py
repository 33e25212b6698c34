"""The catalogue: effects that the surrogate of Puelz et al. 2024 leaves out.

Symbols as in `circuit`; s, a and d are 1 under stress, adenosine and dobutamine, φ is the size in
the unit of the effect. The `source` of an effect cites its equation or its magnitude, and gives the
range of sizes expected in patients; "assumed" marks a range that rests on no measurement.
"""

import jax.numpy as jnp

from diagnosis.changes import Added, Bell, Scaled
from diagnosis.circuit import Circuit
from diagnosis.effects import CRUDE_FORM, GUESSED_FORM, Effect
from diagnosis.forms import FORMS, LN_2, P_NARROWING, collateral
from lumped.units import MMHG

OSTIUM, BED = ("R0", "K_known"), ("R_1", "R_2", "R_3")

NOTCH, NOTCH_WIDTH = 0.40, 0.03
"""Time and width of the notch of the aortic waveform [beats]."""


def _narrowing(c: Circuit, size) -> Circuit:
    wave = jnp.exp(size * (c.P_inlet - P_NARROWING) / P_NARROWING)
    return c._replace(R0_wave=c.R0_wave * wave)


_FIRST_FORMS = (
    Effect(
        id="quadratic_loss", place="ostium", unit="mmHg s2/ml2", sd=6.0, one_sided=True,
        tolerance=GUESSED_FORM, nonlinear=True, ridge=True,
        change=Added("K", MMHG),
        equation="ΔP = R0 Q + φ Q|Q|",
        sentence="the narrow ostium loses pressure with the square of the flow",
        settled_by="the pressure drop at two known flows (CFD or flow wire)",
        source="Young & Tsai 1973 (J Biomech 6:395); range 1.5 to 12, assumed",
    ),
    Effect(
        id="dynamic_narrowing", place="ostium", unit="-", sd=1.0, one_sided=True,
        tolerance=GUESSED_FORM, nonlinear=True, change=_narrowing,
        equation="R0 exp(φ (P_aorta − 80)/80)",
        sentence="the aorta squeezes the intramural course when its pressure is high",
        settled_by="intravascular ultrasound over the beat",
        source="lumen area 33 to 44 % smaller in systole in children (J Invasive Cardiol 2024, doi "
        "10.25270/jic/24.00238); range 0.3 to 2, assumed",
    ),
    Effect(
        id="proximal_resistance", place="ostium", unit="-", sd=0.5,
        change=Scaled(OSTIUM),
        equation="R0 exp(φ)",
        sentence="the proximal vessel's resistance differs from the one computed for it",
        settled_by="a finer CT and the pressure drop computed in it",
        source="resolution of CT; range ±0.25 to ±0.7, assumed",
    ),
    Effect(
        id="stress_narrowing", place="ostium", unit="-", sd=0.5,
        change=Scaled(OSTIUM, 1.0, "stress"),
        equation="R0 exp(s φ)",
        sentence="the proximal vessel is narrower (or wider) under stress than at rest",
        settled_by="intravascular ultrasound under stress",
        source="lumen area 14 % (series of 48 adults) to 39 % (single cases) smaller under stress "
        "by ultrasound; range ±0.25 to ±0.7, assumed",
    ),
    Effect(
        id="inertance", place="ostium", unit="mmHg s2/ml", sd=0.08, one_sided=True,
        two_starts=True,
        change=Added("L", MMHG),
        equation="L dQ/dt, L = φ",
        sentence="the inertia of the blood in the proximal vessel matters",
        settled_by="a flow waveform",
        source="ρ l/A; range 0.03 to 0.15, assumed",
    ),
    Effect(
        id="vasodilation", place="microvasculature", unit="-", sd=0.5,
        change=Scaled(BED, -1.0, "stress"),
        equation="R_1, R_2, R_3 exp(−s φ)",
        sentence="the bed dilates more (or less) under stress than the rule says",
        settled_by="flow under stress and at rest",
        source="flow reserve 2.91 ± 0.78 in normal adults (PET, PMC3069313), 1.9 to 2.4 in children"
        " (Hamaoka et al. 1995, Circulation 92:2457); range ±0.2 to ±0.8, assumed",
    ),
    Effect(
        id="adenosine_vasodilation", place="microvasculature", unit="-", sd=0.5,
        change=Scaled(BED, -1.0, "adenosine"),
        equation="R_1, R_2, R_3 exp(−a φ)",
        sentence="adenosine dilates the bed more (or less) than the rule says",
        settled_by="a second dose of adenosine, or flow under it",
        source="200 in place of 140 µg/kg/min lowers the median FFR from 0.85 to 0.82 (dose study);"
        " range ±0.2 to ±0.8, assumed",
    ),
    Effect(
        id="r1_r3_dilation", place="microvasculature", unit="-", sd=0.7, one_sided=True,
        change=Scaled(("R_1", "R_3"), -LN_2, "stress"),
        equation="R_1, R_3 2^(−s φ)",
        sentence="arterial and venous resistances dilate under stress as well",
        settled_by="flow waveforms under stress",
        source="the two readings of Puelz et al. 2024: φ = 0 its equations, φ = 1 its prose; range "
        "0.3 to 1",
    ),
    Effect(
        id="autoregulation", place="microvasculature", unit="-", sd=1.0, one_sided=True,
        tolerance=GUESSED_FORM,
        change=Added("autoregulation"),
        equation="R_2 exp(φ (mean P_2 − 70)/70)",
        sentence="microvessels constrict where their pressure rises",
        settled_by="one more level of aortic pressure",
        source="range 0.4 to 1.6, assumed",
    ),
    Effect(
        id="stress_compliance", place="microvasculature", unit="-", sd=0.6,
        change=Scaled(("C_a", "C_im"), 1.0, "stress"),
        equation="C_a, C_im exp(s φ)",
        sentence="compliances change under stress differently from the rule",
        settled_by="flow waveforms under stress",
        source="range ±0.3 to ±1, assumed",
    ),
    Effect(
        id="back_pressure", place="microvasculature", unit="mmHg", sd=10.0, one_sided=True,
        two_starts=True,
        tolerance=GUESSED_FORM,
        change=Added("P_venous", MMHG),
        equation="P_venous = φ",
        sentence="flow stops at a pressure above zero",
        settled_by="right atrial or wedge pressure",
        source="in dogs, inflow stops at 19 to 31 mmHg and outflow at 10 to 14 mmHg (Chilian & "
        "Marcus 1984, Am J Physiol 247:H984); range 4 to 20",
    ),
    Effect(
        id="collateral_flow", place="microvasculature", unit="-", sd=0.2, one_sided=True,
        two_starts=True,
        tolerance=GUESSED_FORM, change=collateral("G_collateral"),
        equation="G = φ/(R_1 + R_2 + R_3) from aorta to bed",
        sentence="other vessels feed the same muscle",
        settled_by="an occlusion pressure",
        source="cut-off of the collateral flow index, 0.25; range 0.08 to 0.4, assumed",
    ),
    Effect(
        id="intramyocardial_pump", place="pump", unit="-", sd=0.4,
        tolerance=GUESSED_FORM,
        change=lambda c, size: c._replace(P_LV=c.P_LV * (1.0 + size)),
        equation="P_LV (1 + φ)",
        sentence="the heart muscle squeezes its vessels more (or less) than assumed",
        settled_by="left ventricular pressure",
        source="1.5 P_LV in left and 0.5 P_LV in right beds (coronary guide of SimVascular, after "
        "Kim et al. 2010); range ±0.15 to ±0.6, assumed",
    ),
    Effect(
        id="dobutamine_inotropy", place="pump", unit="-", sd=0.5, one_sided=True,
        change=lambda c, size: c._replace(P_LV=c.P_LV * (1.0 + c.dobutamine * size)),
        equation="P_LV (1 + d φ)",
        sentence="dobutamine makes the muscle squeeze harder than the aortic pressure shows",
        settled_by="left ventricular pressure under dobutamine",
        source="intraventricular gradients under inotropes; range 0.15 to 0.8, assumed",
    ),
    Effect(
        id="wall_viscoelasticity", place="wall", unit="s", sd=0.03, one_sided=True,
        two_starts=True,
        tolerance=GUESSED_FORM,
        change=Added("wall_time"),
        equation="C_a (e + (1 − e)/(1 + iωφ)), e = 0.5",
        sentence="the arterial wall is viscous as well as elastic",
        settled_by="a flow waveform",
        source="Alastruey et al. 2011 (J Biomech 44:2250); relaxation time nearly constant along "
        "the arteries of sheep (arXiv:1607.07973); range 0.01 to 0.06, assumed",
    ),
    Effect(
        id="wire_drift", place="sensor", unit="mmHg per condition", sd=2.5,
        change=lambda c, size: c._replace(distal_offset=c.distal_offset + c.order * size * MMHG),
        equation="P_distal + k φ, k = order of acquisition",
        sentence="the pressure wire drifts from one measurement to the next",
        settled_by="an equalisation check at the end",
        source="±2 mmHg misclassifies 21 % of FFRs (Cook et al. 2016, Circ Cardiovasc Interv "
        "9:e002988); range ±1 to ±4",
    ),
    Effect(
        id="sensor_height", place="sensor", unit="mmHg", sd=4.0,
        change=Added("distal_offset", MMHG),
        equation="P_distal + φ",
        sentence="the wire's sensor lies higher (or lower) than the aorta",
        settled_by="the sensor's height on CT",
        source="0.77 mmHg/cm; distal LAD 5.3 cm above, RCA 5.7 cm below the ostium (Cardiol J "
        "2021;28:41); FFR 0.72 supine, 0.81 prone (Kawaguchi et al. 2019, PMC6766341); range"
        " ±1.5 to ±7",
    ),
    Effect(
        id="sensor_gain", place="sensor", unit="-", sd=0.08,
        change=lambda c, size: c._replace(distal_gain=c.distal_gain * (1.0 + size)),
        equation="P_distal (1 + φ)",
        sentence="the wire's sensor reads pressures too large (or too small) by a factor",
        settled_by="an equalisation check at two levels of pressure",
        source="range ±0.03 to ±0.1, assumed",
    ),
    Effect(
        id="aortic_zero_error", place="sensor", unit="mmHg", sd=4.0,
        change=Added("aortic_offset", MMHG),
        equation="P_aorta + φ",
        sentence="the aortic transducer's zero is off",
        settled_by="zeroing again, and an equalisation check",
        source="range ±1.5 to ±7, assumed",
    ),
    Effect(
        id="catheter_damping", place="sensor", unit="s", sd=0.015, one_sided=True,
        tolerance=CRUDE_FORM, two_starts=True,
        change=Added("aortic_lag"),
        equation="τ dP_seen/dt + P_seen = P_aorta, τ = φ",
        sentence="the fluid-filled catheter smooths the aortic trace",
        settled_by="a flush test",
        source="natural frequency 18 to 42 rad/s and damping 0.07 to 0.7 of fluid-filled catheters;"
        " range 0.005 to 0.03",
    ),
    Effect(
        id="distal_damping", place="sensor", unit="s", sd=0.015, one_sided=True,
        tolerance=CRUDE_FORM,
        change=Added("distal_lag"),
        equation="τ dP_seen/dt + P_seen = P_distal, τ = φ",
        sentence="the distal trace is smoothed",
        settled_by="a flush test, or both sensors in one place",
        source="a filter of the console, or a fluid-filled distal catheter; range 0.005 to 0.03, "
        "assumed",
    ),
    Effect(
        id="signal_delay", place="sensor", unit="s", sd=0.012,
        tolerance=GUESSED_FORM,
        change=Added("distal_delay"),
        equation="P_distal(t − φ)",
        sentence="the distal trace is shifted in time relative to the aortic one",
        settled_by="both sensors in one place, or a flush test",
        source="lines and filters delay by 1 to 60 ms; assumed",
    ),
    Effect(
        id="aortic_waveform", place="inlet", unit="mmHg", sd=5.0,
        tolerance=CRUDE_FORM,
        change=Bell(NOTCH, NOTCH_WIDTH),
        equation="P_aorta + φ exp(−(t/T − 0.40)²/(2·0.03²))",
        sentence="the aortic pressure differs in shape from the assumed waveform",
        settled_by="the aortic trace itself",
        source="the waveform of Puelz et al. 2024 has no dicrotic notch; range ±2 to ±9, assumed",
    ),
)  # fmt: skip

CATALOGUE: tuple[Effect, ...] = tuple(
    effect._replace(forms=FORMS.get(effect.id, ())) for effect in _FIRST_FORMS
)
"""The effects that are tried by default, each with its further forms."""
