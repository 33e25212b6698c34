"""Effects of the bed and of the muscle around it on the layered bed.

Sources: myogenic tone: Johnson 1980, Kuo et al. 1988; zero-flow pressure: Bellamy 1978;
collateral flow index: Seiler 2003; wall models: Bergel 1961, the standard linear solid.
"""

import numpy as np

from benchmarks.foreign.form import either, log_uniform
from benchmarks.foreign.layered_bed import LAYERS, ROWS, LayerParameters
from benchmarks.foreign.layered_kinds import LayeredKind, Size
from benchmarks.foreign.layered_march import Elements, Moment
from benchmarks.foreign.patient import ForeignCondition

DEPTH = np.linspace(0.0, 1.0, LAYERS)
"""0 at the subendocardium, 1 at the subepicardium."""

TONE_RANGE = (0.3, 4.0)
"""Least and largest factor of an arteriole's resistance under its tone."""


def _stress_factor(name: str, only: str | None = None):
    """What multiplies the arterioles under stress, or under one drug only."""

    def build(size: Size) -> dict:
        def change(p: LayerParameters, c: ForeignCondition) -> LayerParameters:
            acts = c.stressed if only is None else c.drug == only
            return {**p, "R2": p["R2"] * size[name]} if acts else p

        return {"change": change}

    return build


def _reserve_by_layer(size: Size) -> dict:
    factors = np.exp(
        (1.0 - DEPTH) * np.log(size["subendocardial"]) + DEPTH * np.log(size["subepicardial"])
    )

    def change(p: LayerParameters, c: ForeignCondition) -> LayerParameters:
        return {**p, "R2": p["R2"] * factors} if c.stressed else p

    return {"change": change}


def _recruited(size: Size) -> dict:
    def change(p: LayerParameters, c: ForeignCondition) -> LayerParameters:
        return {**p, "R2": p["R2"] / (1.0 + size["opened"])} if c.drug == "adenosine" else p

    return {"change": change}


def _both_ends(size: Size) -> dict:
    def change(p: LayerParameters, c: ForeignCondition) -> LayerParameters:
        if not c.stressed:
            return p
        R1, R3 = p["R1"] * size["R1_factor"], p["R3"] * size["R3_factor"]
        return {**p, "R1": R1, "R3": R3}

    return {"change": change}


def _bounded_tone(size: Size) -> dict:
    low, high = (np.log(bound) for bound in TONE_RANGE)

    def tone(p: LayerParameters, P_A: np.ndarray, P_M: np.ndarray) -> np.ndarray:
        inside = 0.5 * (P_A + P_M)
        drive = size["gain"] * (inside - size["set_mmHg"]) / size["set_mmHg"]
        half = np.where(drive > 0.0, high, -low)
        return np.exp(half * np.tanh(drive / half))

    return {"tone": tone}


def _power_tone(size: Size) -> dict:
    def tone(p: LayerParameters, P_A: np.ndarray, P_M: np.ndarray) -> np.ndarray:
        power = size["power"] * np.where(p["stressed"] > 0.0, size["left_under_drugs"], 1.0)
        factor = (np.maximum(P_A, 5.0) / size["set_mmHg"]) ** power
        return np.clip(factor, *TONE_RANGE) * np.ones_like(P_M)

    return {"tone": tone}


def _stores(size: Size) -> dict:
    """Compliances of the artery and of the layers under stress."""

    def change(p: LayerParameters, c: ForeignCondition) -> LayerParameters:
        if not c.stressed:
            return p
        C = p["C"].copy()
        C[2] *= size.get("artery", 1.0)
        C[4:] *= size.get("muscle", 1.0)
        return {**p, "C": C}

    return {"change": change}


def _venous_back(size: Size) -> dict:
    return {"change": lambda p, c: {**p, "Pv": p["Pv"] + size["mmHg"]}}


def _layers_stop(size: Size) -> dict:
    def change(p: LayerParameters, c: ForeignCondition) -> LayerParameters:
        tone = size["under_adenosine"] if c.drug == "adenosine" else 1.0
        return {**p, "Pv": p["Pv"] + size["mmHg"] * tone * (1.4 - 0.8 * DEPTH)}

    return {"change": change}


def _conductance(p: LayerParameters) -> np.ndarray:
    return (1.0 / (p["R2"] + p["R3"])).sum(axis=0)


def _collateral(shares: np.ndarray | None):
    """Flow from a donor artery whose long channels pass on its mean pressure alone.

    Into the layers by their shares, or into the arteries where there are none.
    """

    def build(size: Size) -> dict:
        def change(p: LayerParameters, c: ForeignCondition) -> LayerParameters:
            mean = c.P_diastolic + 0.4 * (c.P_systolic - c.P_diastolic)
            return {**p, "donor": np.array(size["donor_share"] * mean)}

        def law(e: Elements, m: Moment, p: LayerParameters) -> None:
            g = size["index"] * _conductance(p)
            if shares is None:
                e.g_A, e.j_A = e.g_A + g, e.j_A + g * p["donor"]
            else:
                g = g * shares[:, None]
                e.g_M, e.j_M = e.g_M + g, e.j_M + g * p["donor"]

        return {"change": change, "law": law}

    return build


def _steeper_gradient(size: Size) -> dict:
    factors = np.exp(
        (1.0 - DEPTH) * np.log(size["subendocardial"]) + DEPTH * np.log(size["subepicardial"])
    )
    return {"change": lambda p, c: {**p, "squeeze": p["squeeze"] * factors}}


def _stronger(size: Size) -> dict:
    def change(p: LayerParameters, c: ForeignCondition) -> LayerParameters:
        harder = 1.0 + size["harder"] * c.dose if c.drug == "dobutamine" else 1.0
        return {**p, "squeeze": p["squeeze"] * harder}

    return {"change": change}


def _obstructed_ventricle(size: Size) -> dict:
    """A ventricle that peaks late and above the aorta."""

    def squeeze(phase: np.ndarray, shape: np.ndarray, c: ForeignCondition) -> np.ndarray:
        if c.drug != "dobutamine":
            return shape
        late = np.clip((phase - 0.0692) / (0.4 - 0.0692), 0.0, 1.0)
        return shape * (1.0 + size["gradient"] * c.dose * late ** size["skew"])

    return {"squeeze": squeeze}


def _voigt_wall(size: Size) -> dict:
    def change(p: LayerParameters, c: ForeignCondition) -> LayerParameters:
        eta = np.zeros(ROWS)
        eta[[0, 2]] = 1e-3 * size["ms"] / p["C"][[0, 2]]
        return {**p, "eta": eta}

    return {"change": change}


def _slow_wall(size: Size) -> dict:
    def change(p: LayerParameters, c: ForeignCondition) -> LayerParameters:
        C, eta = p["C"].copy(), p["eta"].copy()
        for fast, slow in ((0, 1), (2, 3)):
            C[slow] = size["share"] * C[fast]
            C[fast] = C[fast] - C[slow]
            eta[slow] = 1e-3 * size["ms"] / max(C[slow], 1e-9)
        return {**p, "C": C, "eta": eta}

    return {"change": change}


def _dilation(rng: np.random.Generator, more: tuple[float, float], less: tuple[float, float]):
    return log_uniform(rng, *more) if rng.random() < 0.5 else log_uniform(rng, *less)


def _dilation_by_layer(rng: np.random.Generator) -> Size:
    factor = _dilation(rng, (0.15, 0.6), (1.3, 2.6))
    apart = float(rng.uniform(1.0, 1.6))
    return {"subendocardial": factor * apart, "subepicardial": factor / apart}


def _gradient(rng: np.random.Generator) -> Size:
    factor = either(rng, 1.25, 2.2)
    return {"subendocardial": factor, "subepicardial": float(factor ** rng.uniform(0.0, 0.4))}


DILATION = (
    LayeredKind(
        "vasodilation", "arterioles", "arterioles",
        lambda rng: {"factor": _dilation(rng, (0.12, 0.65), (1.3, 3.0))},
        _stress_factor("factor"), {"factor": 1.0},
    ),
    LayeredKind(
        "vasodilation", "reserve_by_layer", "arterioles",
        _dilation_by_layer, _reserve_by_layer, {"subendocardial": 1.0, "subepicardial": 1.0},
    ),
    LayeredKind(
        "adenosine_vasodilation", "arterioles", "arterioles",
        lambda rng: {"factor": _dilation(rng, (0.1, 0.6), (1.35, 3.5))},
        _stress_factor("factor", "adenosine"), {"factor": 1.0},
    ),
    LayeredKind(
        "adenosine_vasodilation", "recruited", "arterioles",
        lambda rng: {
            "opened": float(rng.choice([log_uniform(rng, 0.5, 6.0), -rng.uniform(0.25, 0.7)])),
        },
        _recruited, {"opened": 0.0},
    ),
    LayeredKind(
        "r1_r3_dilation", "one_factor", "arteries and veins",
        lambda rng: dict.fromkeys(("R1_factor", "R3_factor"), log_uniform(rng, 0.55, 0.92)),
        _both_ends, {"R1_factor": 1.0, "R3_factor": 1.0},
    ),
    LayeredKind(
        "r1_r3_dilation", "apart", "arteries and veins",
        lambda rng: {
            "R1_factor": log_uniform(rng, 0.4, 0.95), "R3_factor": log_uniform(rng, 0.55, 0.92),
        },
        _both_ends, {"R1_factor": 1.0, "R3_factor": 1.0},
    ),
    LayeredKind(
        "autoregulation", "bounded_tone", "arterioles",
        lambda rng: {"gain": log_uniform(rng, 0.8, 5.0), "set_mmHg": float(rng.uniform(55, 75))},
        _bounded_tone, {"gain": 0.0, "set_mmHg": 65.0},
    ),
    LayeredKind(
        "autoregulation", "power_tone", "arterioles",
        lambda rng: {
            "power": log_uniform(rng, 0.8, 5.0), "set_mmHg": float(rng.uniform(65, 85)),
            "left_under_drugs": float(rng.uniform(0.4, 0.9)),
        },
        _power_tone, {"power": 0.0, "set_mmHg": 75.0, "left_under_drugs": 1.0},
    ),
)  # fmt: skip
"""Forms of the effects that change resistances of the bed."""

BED = (
    LayeredKind(
        "stress_compliance", "whole_bed", "arteries and muscle",
        lambda rng: dict.fromkeys(("artery", "muscle"), either(rng, 1.25, 2.8)),
        _stores, {"artery": 1.0, "muscle": 1.0},
    ),
    LayeredKind(
        "stress_compliance", "muscle", "muscle",
        lambda rng: {"muscle": either(rng, 1.25, 3.0)}, _stores, {"muscle": 1.0},
    ),
    LayeredKind(
        "back_pressure", "venous", "veins",
        lambda rng: {"mmHg": float(rng.uniform(10.0, 30.0))}, _venous_back, {"mmHg": 0.0},
    ),
    LayeredKind(
        "back_pressure", "layers_stop", "muscle",
        lambda rng: {
            "mmHg": float(rng.uniform(12.0, 38.0)), "under_adenosine": float(rng.uniform(0.5, 0.9)),
        },
        _layers_stop, {"mmHg": 0.0, "under_adenosine": 0.7},
    ),
    LayeredKind(
        "collateral_flow", "epicardial", "arteries",
        lambda rng: {
            "index": log_uniform(rng, 0.2, 0.8), "donor_share": float(rng.uniform(0.85, 1.0)),
        },
        _collateral(None), {"index": 0.0, "donor_share": 0.9},
    ),
    LayeredKind(
        "collateral_flow", "deep", "muscle",
        lambda rng: {
            "index": log_uniform(rng, 0.2, 0.8), "donor_share": float(rng.uniform(0.8, 1.0)),
        },
        _collateral(np.array([0.6, 0.3, 0.1])), {"index": 0.0, "donor_share": 0.9},
    ),
    LayeredKind(
        "intramyocardial_pump", "all_layers", "muscle",
        lambda rng: {"factor": either(rng, 1.15, 1.9)},
        lambda size: {"change": lambda p, c: {**p, "squeeze": p["squeeze"] * size["factor"]}},
        {"factor": 1.0},
    ),
    LayeredKind(
        "intramyocardial_pump", "steeper_gradient", "muscle",
        _gradient, _steeper_gradient, {"subendocardial": 1.0, "subepicardial": 1.0},
    ),
    LayeredKind(
        "dobutamine_inotropy", "stronger", "muscle",
        lambda rng: {"harder": float(rng.uniform(0.1, 0.55))}, _stronger, {"harder": 0.0},
    ),
    LayeredKind(
        "dobutamine_inotropy", "obstructed_ventricle", "muscle",
        lambda rng: {
            "gradient": float(rng.uniform(0.12, 0.6)), "skew": float(rng.uniform(0.5, 1.5)),
        },
        _obstructed_ventricle, {"gradient": 0.0, "skew": 1.0},
    ),
    LayeredKind(
        "wall_viscoelasticity", "voigt", "arteries",
        lambda rng: {"ms": log_uniform(rng, 3.0, 30.0)}, _voigt_wall, {"ms": 0.0},
    ),
    LayeredKind(
        "wall_viscoelasticity", "slow_wall", "arteries",
        lambda rng: {"share": float(rng.uniform(0.25, 0.7)), "ms": log_uniform(rng, 15.0, 80.0)},
        _slow_wall, {"share": 0.0, "ms": 0.0},
    ),
)  # fmt: skip
"""Forms of the effects that change stores, sources and the muscle."""
