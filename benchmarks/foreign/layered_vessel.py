"""Effects of the ostium and the proximal vessel on the layered bed.

Sources: losses of a narrowing: Young and Tsai 1973, Weisbach's coefficient of contraction; sizes of
intramural courses: Angelini 2007; inertia and viscosity of unsteady flow: Womersley 1955.
"""

import numpy as np

from benchmarks.foreign.form import either, log_uniform
from benchmarks.foreign.layered_bed import LayerParameters
from benchmarks.foreign.layered_kinds import LayeredKind, Size
from benchmarks.foreign.layered_march import Elements, Moment, add_quadratic
from benchmarks.foreign.patient import ForeignCondition
from lumped.units import MMHG

DENSITY, VISCOSITY = 1.06, 0.04
"""Of blood [g/cm³, g/(cm·s)]."""

LOSS = DENSITY / 2.0 / MMHG
"""Pressure of a jet of 1 cm/s [mmHg]."""


def scaled_R0(factor: float, p: LayerParameters) -> LayerParameters:
    """Elements with the proximal resistance multiplied."""
    return {**p, "R0": p["R0"] * factor}


def _turbulent_slit(size: Size) -> dict:
    area = size["area_mm2"] / 100.0
    k = size["coefficient"] * LOSS / area**2

    def law(e: Elements, m: Moment, p: LayerParameters) -> None:
        add_quadratic(e, "0", k, m.Q)

    return {"law": law}


def _sudden_expansion(size: Size) -> dict:
    share, area = size["area_share"], size["vessel_mm2"] / 100.0
    jet = share * (0.62 + 0.38 * share**3)
    forward = LOSS * (1.0 / jet - 1.0) ** 2 / area**2
    backward = 0.5 * LOSS * (1.0 - share) / (share * area) ** 2

    def law(e: Elements, m: Moment, p: LayerParameters) -> None:
        add_quadratic(e, "0", np.where(m.Q > 0.0, forward, backward), m.Q)

    return {"law": law}


def _hoop(size: Size) -> dict:
    def law(e: Elements, m: Moment, p: LayerParameters) -> None:
        closed = 1.0 / (1.0 + np.exp((size["half_mmHg"] - m.P_ao) / size["width_mmHg"]))
        open_area = 1.0 - size["narrowing"] * closed
        e.R0 = e.R0 * (1.0 + size["intramural_share"] * (open_area**-2 - 1.0))

    return {"law": law}


def _compressed(size: Size) -> dict:
    def law(e: Elements, m: Moment, p: LayerParameters) -> None:
        above = np.maximum(m.P_ao - size["onset_mmHg"], 0.0) * size["per_mmHg"]
        e.R0 = e.R0 * (1.0 + np.minimum(above**2, 2.5))

    return {"law": law}


def _slit_in_series(size: Size) -> dict:
    radius = size["diameter_mm"] / 20.0
    added = 8.0 * VISCOSITY * size["length_mm"] / 10.0 / (np.pi * radius**4) / MMHG

    def change(p: LayerParameters, c: ForeignCondition) -> LayerParameters:
        return {**p, "R0": p["R0"] + added}

    return {"change": change}


def _shrinks_with_dose(size: Size) -> dict:
    def change(p: LayerParameters, c: ForeignCondition) -> LayerParameters:
        return scaled_R0((1.0 - size["diameter_share"] * c.dose) ** -4, p)

    return {"change": change}


def _plug(size: Size) -> dict:
    L = DENSITY * size["length_mm"] * 10.0 / size["area_mm2"] / MMHG

    def change(p: LayerParameters, c: ForeignCondition) -> LayerParameters:
        return {**p, "L0": p["L0"] + L}

    return {"change": change}


def _plug_with_skin(size: Size) -> dict:
    L = DENSITY * size["length_mm"] * 10.0 / size["area_mm2"] / MMHG

    def change(p: LayerParameters, c: ForeignCondition) -> LayerParameters:
        beside = 1e-3 * size["skin_ms"] / max(L, 1e-9)
        return {**p, "L0": p["L0"] + L, "Y0": p["Y0"] + beside}

    return {"change": change}


def _narrowed_diameter(rng: np.random.Generator) -> Size:
    return {"diameter_share": float(rng.choice([rng.uniform(0.03, 0.13), -rng.uniform(0.04, 0.2)]))}


VESSEL = (
    LayeredKind(
        "quadratic_loss", "turbulent_slit", "ostium",
        lambda rng: {
            "area_mm2": log_uniform(rng, 1.4, 4.0), "coefficient": float(rng.uniform(1.0, 1.6)),
        },
        _turbulent_slit, {"area_mm2": 1.5, "coefficient": 0.0},
    ),
    LayeredKind(
        "quadratic_loss", "sudden_expansion", "ostium",
        lambda rng: {
            "area_share": log_uniform(rng, 0.28, 0.54), "vessel_mm2": float(rng.uniform(4.5, 7.0)),
        },
        _sudden_expansion, {"area_share": 1.0, "vessel_mm2": 5.0},
    ),
    LayeredKind(
        "dynamic_narrowing", "hoop", "intramural course",
        lambda rng: {
            "narrowing": float(rng.uniform(0.12, 0.5)),
            "intramural_share": float(rng.uniform(0.5, 0.9)),
            "half_mmHg": float(rng.uniform(90.0, 115.0)),
            "width_mmHg": float(rng.uniform(6.0, 14.0)),
        },
        _hoop,
        {"narrowing": 0.0, "intramural_share": 0.7, "half_mmHg": 100.0, "width_mmHg": 10.0},
    ),
    LayeredKind(
        "dynamic_narrowing", "compressed", "intramural course",
        lambda rng: {
            "onset_mmHg": float(rng.uniform(58.0, 78.0)),
            "per_mmHg": 1.0 / rng.uniform(45.0, 120.0),
        },
        _compressed, {"onset_mmHg": 65.0, "per_mmHg": 0.0},
    ),
    LayeredKind(
        "proximal_resistance", "factor", "proximal vessel",
        lambda rng: {"factor": either(rng, 1.5, 2.8)},
        lambda size: {"change": lambda p, c: scaled_R0(size["factor"], p)},
        {"factor": 1.0},
    ),
    LayeredKind(
        "proximal_resistance", "slit_in_series", "ostium",
        lambda rng: {
            "diameter_mm": float(rng.uniform(1.05, 1.4)),
            "length_mm": float(rng.uniform(5.0, 14.0)),
        },
        _slit_in_series, {"diameter_mm": 1.2, "length_mm": 0.0},
    ),
    LayeredKind(
        "stress_narrowing", "all_stress", "proximal vessel",
        lambda rng: {"factor": either(rng, 1.12, 2.0)},
        lambda size: {
            "change": lambda p, c: scaled_R0(size["factor"] if c.stressed else 1.0, p)
        },
        {"factor": 1.0},
    ),
    LayeredKind(
        "stress_narrowing", "shrinks_with_dose", "proximal vessel",
        _narrowed_diameter, _shrinks_with_dose, {"diameter_share": 0.0},
    ),
    LayeredKind(
        "inertance", "plug", "proximal vessel",
        lambda rng: {
            "length_mm": float(rng.uniform(8.0, 25.0)), "area_mm2": log_uniform(rng, 2.5, 8.0),
        },
        _plug, {"length_mm": 0.0, "area_mm2": 3.0},
    ),
    LayeredKind(
        "inertance", "plug_with_skin", "proximal vessel",
        lambda rng: {
            "length_mm": float(rng.uniform(10.0, 35.0)),
            "area_mm2": log_uniform(rng, 2.5, 7.0),
            "skin_ms": float(rng.uniform(8.0, 30.0)),
        },
        _plug_with_skin, {"length_mm": 0.0, "area_mm2": 3.0, "skin_ms": 0.0},
    ),
)  # fmt: skip
"""Forms of the effects of the proximal vessel."""
