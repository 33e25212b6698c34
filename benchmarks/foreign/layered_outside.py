"""Causes outside the list of effects, on the layered bed and its records.

Sources: myocardial bridges: Ge et al. 1999; collapse of compliant segments: Katz et al. 1969;
underdamped catheters: Gardner 1981; pulsus alternans and respiratory swing: textbooks of
haemodynamics.
"""

import numpy as np

from benchmarks.foreign.form import Traces, either, log_uniform, signed
from benchmarks.foreign.layered_bed import LayerParameters
from benchmarks.foreign.layered_kinds import LayeredKind, Size
from benchmarks.foreign.layered_march import Elements, Moment, add_quadratic
from benchmarks.foreign.layered_reading import second_order
from benchmarks.foreign.patient import ForeignCondition

MAINS_HZ = 50.0
"""Frequency of the mains."""


def _distal_stenosis(size: Size) -> dict:
    def law(e: Elements, m: Moment, p: LayerParameters) -> None:
        e.R1 = e.R1 * (1.0 + size["linear"])
        add_quadratic(e, "1", size["quadratic"], m.Q)

    return {"law": law}


def _bridge(size: Size) -> dict:
    def law(e: Elements, m: Moment, p: LayerParameters) -> None:
        held = np.clip((m.P_lv - m.P_A + size["reach_mmHg"]) / 60.0, 0.0, 1.5)
        e.R1 = e.R1 * (1.0 + size["closing"] * held)

    return {"law": law}


def _vessel_collapse(size: Size) -> dict:
    def law(e: Elements, m: Moment, p: LayerParameters) -> None:
        below = np.logaddexp(0.0, (size["critical_mmHg"] - m.P_D) / 5.0)
        e.R0 = e.R0 * (1.0 + size["collapse"] * np.minimum(below, 6.0))

    return {"law": law}


def _distal_inertia(size: Size) -> dict:
    return {"change": lambda p, c: {**p, "L1": p["L1"] + size["L1"]}}


def _flow_error(size: Size) -> dict:
    return {"flow": lambda flow, c: flow * size["factor"]}


def _whipping(size: Size) -> dict:
    def sensors(t, P_aorta, P_distal, c: ForeignCondition) -> Traces:
        since = (t + 1e-9) % c.period
        swing = np.sin(2.0 * np.pi * size["Hz"] * since) * np.exp(-since / size["decay_s"])
        return P_aorta, P_distal + size["mmHg"] * swing

    return {"sensors": sensors}


def _moving_wire(size: Size) -> dict:
    def sensors(t, P_aorta, P_distal, c: ForeignCondition) -> Traces:
        share = 0.5 - 0.5 * np.cos(2.0 * np.pi * size["Hz"] * t)
        return P_aorta, P_distal + size["reach"] * share * (P_aorta - P_distal)

    return {"sensors": sensors}


def _alternans(size: Size) -> dict:
    def beats(place: int, c: ForeignCondition) -> tuple[float, float]:
        sign = 1.0 if place % 2 else -1.0
        return sign * size["systolic_mmHg"], 0.3 * sign * size["systolic_mmHg"]

    return {"beats": beats}


def _respiration(size: Size) -> dict:
    def sensors(t, P_aorta, P_distal, c: ForeignCondition) -> Traces:
        chest = size["mmHg"] * np.sin(2.0 * np.pi * size["Hz"] * t + size["start"])
        return P_aorta + chest, P_distal + chest

    return {"sensors": sensors}


def _thermal_trend(size: Size) -> dict:
    def sensors(t, P_aorta, P_distal, c: ForeignCondition) -> Traces:
        middle = 0.5 * t[-1]
        return P_aorta, P_distal + size["mmHg_per_s"] * (t - middle)

    return {"sensors": sensors}


def _mains_hum(size: Size) -> dict:
    def sensors(t, P_aorta, P_distal, c: ForeignCondition) -> Traces:
        return P_aorta, P_distal + size["mmHg"] * np.sin(2.0 * np.pi * MAINS_HZ * t + size["start"])

    return {"sensors": sensors}


def _ringing(size: Size) -> dict:
    def sensors(t, P_aorta, P_distal, c: ForeignCondition) -> Traces:
        slowness = 1.0 / (2.0 * np.pi * size["Hz"])
        rung = second_order(P_aorta, slowness, size["damping"])
        return P_aorta + size["share"] * (rung - P_aorta), P_distal

    return {"sensors": sensors}


OUTSIDE_KINDS = (
    LayeredKind(
        "outside:distal_stenosis", "branch", "behind the sensor",
        lambda rng: {
            "linear": float(rng.uniform(0.3, 1.2)), "quadratic": log_uniform(rng, 4.0, 14.0),
        },
        _distal_stenosis, {"linear": 0.0, "quadratic": 0.0},
    ),
    LayeredKind(
        "outside:bridge", "systolic", "behind the sensor",
        lambda rng: {
            "closing": log_uniform(rng, 6.0, 30.0), "reach_mmHg": float(rng.uniform(10.0, 40.0)),
        },
        _bridge, {"closing": 0.0, "reach_mmHg": 0.0},
    ),
    LayeredKind(
        "outside:vessel_collapse", "limp_segment", "proximal vessel",
        lambda rng: {
            "collapse": log_uniform(rng, 0.25, 0.8),
            "critical_mmHg": float(rng.uniform(60.0, 78.0)),
        },
        _vessel_collapse, {"collapse": 0.0, "critical_mmHg": 70.0},
    ),
    LayeredKind(
        "outside:distal_inertia", "long_branch", "behind the sensor",
        lambda rng: {"L1": log_uniform(rng, 0.15, 0.5)}, _distal_inertia, {"L1": 0.0},
    ),
    LayeredKind(
        "outside:flow_error", "factor", "flow",
        lambda rng: {"factor": either(rng, 1.35, 1.9)}, _flow_error, {"factor": 1.0},
    ),
    LayeredKind(
        "outside:whipping", "ejection", "wire",
        lambda rng: {
            "mmHg": signed(rng, 3.0, 9.0), "Hz": log_uniform(rng, 7.0, 18.0),
            "decay_s": float(rng.uniform(0.05, 0.15)),
        },
        _whipping, {"mmHg": 0.0, "Hz": 10.0, "decay_s": 0.1},
    ),
    LayeredKind(
        "outside:moving_wire", "slides_to_the_ostium", "wire",
        lambda rng: {
            "reach": float(rng.uniform(0.6, 1.0)), "Hz": float(rng.uniform(0.25, 0.6)),
        },
        _moving_wire, {"reach": 0.0, "Hz": 0.3}, 5,
    ),
    LayeredKind(
        "outside:pulsus_alternans", "strong_and_weak", "heart",
        lambda rng: {"systolic_mmHg": float(rng.uniform(4.0, 10.0))},
        _alternans, {"systolic_mmHg": 0.0}, 5,
    ),
    LayeredKind(
        "outside:respiration", "chest_pressure", "chest",
        lambda rng: {
            "mmHg": float(rng.uniform(2.0, 6.0)), "Hz": float(rng.uniform(0.25, 0.5)),
            "start": float(rng.uniform(0.0, 6.28)),
        },
        _respiration, {"mmHg": 0.0, "Hz": 0.3, "start": 0.0}, 5,
    ),
    LayeredKind(
        "outside:thermal_trend", "ramp", "wire",
        lambda rng: {"mmHg_per_s": signed(rng, 0.8, 2.5)},
        _thermal_trend, {"mmHg_per_s": 0.0}, 5,
    ),
    LayeredKind(
        "outside:mains_hum", "distal", "amplifier",
        lambda rng: {
            "mmHg": log_uniform(rng, 0.4, 1.8), "start": float(rng.uniform(0.0, 6.28)),
        },
        _mains_hum, {"mmHg": 0.0, "start": 0.0},
    ),
    LayeredKind(
        "outside:ringing_catheter", "underdamped", "catheter",
        lambda rng: {
            "share": 1.0, "Hz": log_uniform(rng, 7.0, 16.0),
            "damping": float(rng.uniform(0.08, 0.22)),
        },
        _ringing, {"share": 0.0, "Hz": 10.0, "damping": 0.2},
    ),
)  # fmt: skip
"""Causes outside the list."""
