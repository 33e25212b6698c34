"""A virtual cohort: children with an anomalous artery whose "measured" ratios a richer model gave.

``python -m benchmarks.virtual_cohort DIR`` writes it anew, and with ``apart`` behind DIR the
variant whose drugs act apart. Three left and
seven right arteries are drawn from the sampler of `jaxfsi.anatomy`; pressures, rates and outputs
from what is usual at that body size. The truth behind the measurements has what the calibrated
model has not:

| effect | in the truth | the calibrated model |
|---|---|---|
| loss of the artery | curve of the drawn lumen times a factor: oblique take-off, wire | curve |
| dynamic narrowing | under dobutamine the loss grows with (1 − δ)⁻² | the same |
| drug | factors of R_2 and R_3 of its own for each | one rule |
| venous pressure | 8 mmHg | 0 |
| sensor | noise of 0.01 | none |

Variant ``apart``: adenosine does not dilate the bed of the anomalous artery, whose resistances R_2
and R_3 are a third above those at rest; all else stays as drawn. With it calibration hardly lowers
the RMSE under adenosine, as in the paper; with drugs that act ``alike`` it does (see the README).

Every draw and its seed are kept in ``truth.json``. The truth is a 0D model: it is not a 3D run on a
finer mesh. The curve that a case file gives is that of its lumen by the reduced law; in mode 3d the
ramp takes its place.
"""

import json
import math
import pathlib
import sys
from typing import Any, Literal, NamedTuple, cast, get_args

import jax.numpy as jnp
import numpy as np

from calibration import PressureFlowLaw, lumen_law
from jaxfsi import Lumen
from jaxfsi.anatomy import sample_anatomies
from jaxfsi.anatomy.sources.parameters import (
    ADULT_SURFACE_AREA_M2,
    PARAMETER_RANGES,
    SyntheticParameters,
)
from lumped import (
    MM,
    MMHG,
    HaemodynamicCondition,
    Shooting,
    StressRule,
    Surrogate,
    condition_from_clinic,
    nominal_coronary,
    pressure_ratio,
    solve_periodic,
)
from study.case.blood import BloodParameters

SEED = 20240503
SIDES = ("left",) * 3 + ("right",) * 7
_ADULT_ANNULUS = SyntheticParameters().annulus_radius
_POINTS = 96
_VENOUS = 8.0 * MMHG
_NOISE = 0.01
Drugs = Literal["alike", "apart"]
UNDILATED = {"R_2": 1.3, "R_3": 1.3}
"""Adenosine of the variant `apart`."""

_UNITS = {"cm": ("_mm", 1.0 / MM), "rad": ("_deg", 180.0 / math.pi), "": ("", 1.0)}


class Truth(NamedTuple):
    """What is behind the measurements of one patient.

    Attributes:
        alpha: scale of the coronary resistances.
        loss: factor of the artery's curve.
        narrowing: δ, share of the width that is lost under dobutamine.
        rules: what each drug does to the coronary bed.
    """

    alpha: float
    loss: float
    narrowing: float
    rules: dict[str, dict[str, float]]


def artery_lumen(p: SyntheticParameters, *, n_frames: int = 60) -> Lumen:
    """Cross-sections of the drawn artery: ostium, intramural course, reference vessel.

    Ellipses whose half axes go over into each other within one and a half widths.
    """
    half = [
        (p.ostium_major / 2.0, p.ostium_minor / 2.0),
        p.intramural_half_axes,
        (p.reference_radius, p.reference_radius),
    ]
    blend = 1.5 * p.ostium_minor
    end = p.intramural_length + p.distal_length
    s = np.linspace(0.0, end, n_frames)
    places = [0.0, blend, p.intramural_length, min(p.intramural_length + 2.0 * blend, 0.95 * end)]
    nodes = (half[0], half[1], half[1], half[2])
    places = np.maximum.accumulate(np.array(places) + 1e-6 * np.arange(4))
    major, minor = (np.interp(s, places, [axes[i] for axes in nodes]) for i in (0, 1))
    angle = 2.0 * np.pi * np.arange(_POINTS) / _POINTS
    contours = np.stack([major[:, None] * np.cos(angle), minor[:, None] * np.sin(angle)], axis=2)
    return Lumen(jnp.asarray(contours), jnp.asarray(s))


def artery_law(p: SyntheticParameters) -> PressureFlowLaw:
    """Pressure-flow curve of the drawn artery by the reduced law."""
    blood = BloodParameters()
    return lumen_law(artery_lumen(p), mu=blood.mu, rho=blood.rho_f, Q_reference=1.0)


def draw_truth(generator: np.random.Generator, drugs: Drugs = "alike") -> Truth:
    """Draw what the calibrated model does not know.

    Args:
        generator: draws; as many in either variant.
        drugs: whether adenosine dilates as dobutamine does, or not at all (`apart`).
    """

    def about(mean: float, spread: float) -> float:
        return float(mean * math.exp(spread * np.clip(generator.standard_normal(), -2.0, 2.0)))

    truth = Truth(
        alpha=about(0.2, 0.35),
        loss=about(1.8, 0.25),
        narrowing=float(generator.uniform(0.0, 0.12)),
        rules={
            "adenosine": {
                "R_2": about(0.5, 0.15),
                "R_3": about(0.7, 0.15),
                "C_a": 1.5,
                "C_im": 1.5,
            },
            "dobutamine": {"R_2": about(0.5, 0.15), "R_3": about(0.85, 0.1), "C_a": 2.0},
        },
    )
    if drugs == "apart":
        truth = truth._replace(rules={**truth.rules, "adenosine": dict(UNDILATED)})
    return truth


def draw_conditions(generator: np.random.Generator) -> dict[str, dict[str, float]]:
    """Pressures [mmHg] and cycle lengths [s] of a child at rest and under either drug."""
    systolic = 104.0 + 7.0 * float(np.clip(generator.standard_normal(), -2, 2))
    diastolic = 60.0 + 5.0 * float(np.clip(generator.standard_normal(), -2, 2))
    rate = 78.0 + 9.0 * float(np.clip(generator.standard_normal(), -2, 2))
    changes = {
        "rest": (1.0, 1.0, 1.0),
        "adenosine": (0.93, 0.9, 1.25),
        "dobutamine": (1.2, 0.97, 1.95),
    }
    return {
        name: {
            "P_systolic_mmHg": round(systolic * up, 1),
            "P_diastolic_mmHg": round(diastolic * down, 1),
            "period_s": round(60.0 / (rate * faster), 3),
        }
        for name, (up, down, faster) in changes.items()
    }


def true_ratio(
    law: PressureFlowLaw, truth: Truth, name: str, condition: HaemodynamicCondition
) -> float:
    """Ratio of the truth, without noise."""
    narrower = (1.0 - truth.narrowing) ** -2 if name == "dobutamine" else 1.0
    factor = truth.loss * narrower
    surrogate = Surrogate(
        R0=float(law.R0) * factor,
        K=float(law.K) * factor,
        alpha=truth.alpha,
        coronary=nominal_coronary(P_venous=_VENOUS),
    )
    none = {"R_2": 1.0, "C_a": 1.0, "C_im": 1.0}
    rule = None if name == "rest" else StressRule(**{**none, **truth.rules[name]})
    network = surrogate.network(condition, rule=rule)
    return float(pressure_ratio(solve_periodic(network, condition.period, Shooting())))


def patients(drugs: Drugs = "alike") -> list[dict[str, Any]]:
    """All patients of the cohort: anatomy, conditions, measured ratios and the truth."""
    found = []
    drawn = {
        side: sample_anatomies([SEED, k], SIDES.count(side), side=side, age="paediatric")
        for k, side in enumerate(("left", "right"))
    }
    for i, side in enumerate(SIDES):
        generator = np.random.default_rng([SEED, 100 + i])
        p = drawn[side][SIDES[:i].count(side)]
        law, truth, conditions = (
            artery_law(p),
            draw_truth(generator, drugs),
            draw_conditions(generator),
        )
        for name, entry in conditions.items():
            condition = condition_from_clinic(**entry)
            exact = true_ratio(law, truth, name, condition)
            measured = exact + _NOISE * float(generator.standard_normal())
            entry["ffr"] = round(min(measured, 0.995), 3)
            entry["exact"] = exact
        area = ADULT_SURFACE_AREA_M2 * (p.annulus_radius / _ADULT_ANNULUS) ** 2
        rest = conditions["rest"]
        rest["cardiac_output_l_per_min"] = round(3.6 * min(max(area, 0.8), 2.1), 2)
        found.append(
            {
                "id": f"virtual-{'l' if side == 'left' else 'r'}-{i + 1:02d}",
                "side": side,
                "seed": [SEED, 100 + i],
                "anatomy": p,
                "law": (float(law.R0), float(law.K)),
                "truth": truth,
                "conditions": conditions,
            }
        )
    return found


def case_text(patient: dict[str, Any]) -> str:
    """The case file of a patient."""
    p = patient["anatomy"]
    a, b = patient["law"]
    lines = [
        "# A virtual child: nothing here was measured. See README.md beside this folder.",
        "[patient]",
        f'id = "{patient["id"]}"',
        "[anatomy]",
        'kind = "synthetic"',
        f'side = "{p.side}"',
    ]
    for name, (_, _, unit) in PARAMETER_RANGES.items():
        if not name.startswith("thickness"):
            suffix, factor = _UNITS[unit]
            lines.append(f"{name}{suffix} = {getattr(p, name) * factor:.5g}")
    lines += [
        "[wall]",
        f"thickness_per_radius = {{ factor = {p.thickness_per_radius:.5g},"
        f" min_mm = {p.thickness_minimum / MM:.5g}, max_mm = {p.thickness_maximum / MM:.5g} }}",
        "[surrogate]  # curve of the drawn lumen by the reduced law",
        'law = "quadratic"',
        f"R0_dyn_s_per_cm5 = {a:.6g}",
        f"K_dyn_s2_per_cm8 = {b:.6g}",
    ]
    for name, entry in patient["conditions"].items():
        lines.append(f"[condition.{name}]")
        lines += [f"{key} = {value:g}" for key, value in entry.items() if key != "exact"]
    return "\n".join(lines) + "\n"


def main(argv: list[str] | None = None) -> None:
    """Write the cohort into a folder."""
    place, *rest = sys.argv[1:] if argv is None else argv
    folder, drugs = pathlib.Path(place), rest[0] if rest else "alike"
    if drugs not in get_args(Drugs):
        raise SystemExit(f"{drugs} is no variant; write one of {', '.join(get_args(Drugs))}")
    record = {}
    for patient in patients(cast(Drugs, drugs)):
        place = folder / patient["id"]
        place.mkdir(parents=True, exist_ok=True)
        (place / "case.toml").write_text(case_text(patient), encoding="utf-8")
        record[patient["id"]] = {
            "seed": patient["seed"],
            **patient["truth"]._asdict(),
            "exact_ratios": {n: entry["exact"] for n, entry in patient["conditions"].items()},
        }
    head = {"seed": SEED, "noise": _NOISE} | ({} if drugs == "alike" else {"drugs": drugs})
    text = json.dumps({**head, "patients": record}, indent=1) + "\n"
    (folder / "truth.json").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
