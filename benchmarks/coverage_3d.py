"""Whether 90 % intervals from 0D cover what 3D says of patients that another hand drew.

As `benchmarks.coverage`, but the truth is a 3D run with a bending wall: an anatomy drawn from the
published distributions, with the pressures, the bed, its dilation, the venous pressure and the
squeeze that `benchmarks.independent_patients` drew. What is measured of it has the errors drawn
there: of the resting ratio, the pressures, the losses of the lumen and, in a third of the patients,
the flow reserve. The interval is that of `jaxfsi run --uncertainty`. α of the truth is what the
drawn resting ratio asks for in 0D; what 3D then has at rest is the true resting ratio.
"""

import json
import pathlib
import sys
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from benchmarks.beats import beat, kept_in
from benchmarks.coverage import IM_FACTOR, REST_RATIO_ERROR
from benchmarks.independent_patients import patients
from benchmarks.virtual_cohort import artery_law, case_text
from jaxfsi.anatomy import sample_anatomies
from jaxfsi.anatomy.sources.cohort import Age
from study import read_case
from study.run.patient import load_patient
from study.run.progress import Progress
from study.run.ratio_uncertainty import uncertain_ratios
from study.store.result_files import SIMULATION_FILE

SEED = 4117
N_PATIENTS = 12
WORKERS = 2
HIGHEST_RATIO = 0.995
_AGES: dict[str, Age] = {"adult": "adult", "child": "paediatric"}
_CARDIAC_OUTPUT = {"adult": 5.6, "child": 4.2}
_BED = ("R_1", "R_2", "R_3")


def run(rounds: int = 1, folder: pathlib.Path | None = None) -> dict[str, Any]:
    """Run the truth of every patient in 3D and predict it.

    Args:
        rounds: not used: a beat is run once.
        folder: where runs are kept; a temporary one if it is not given.

    Returns:
        {"name", "rows", "notes", "passed"}, ready for JSON.
    """
    del rounds
    rows = kept_in(folder, _rows)
    whole = [row for row in rows if "covered" in row]
    covered = sum(row["covered"] for row in whole)
    width = float(np.mean([row["width"] for row in whole])) if whole else float("nan")
    return {
        "name": "coverage_3d",
        "rows": rows,
        "notes": [
            f"{covered} of {len(whole)} true FFR lie in their interval, {width:.3f} wide on average"
        ],
        # of twelve, 90 % cover nine or more in 97 of 100 cohorts
        "passed": len(whole) == N_PATIENTS and covered >= 9,
    }


def _rows(folder: pathlib.Path) -> list[dict[str, Any]]:
    drawn = list(enumerate(patients(N_PATIENTS, SEED)))
    with ThreadPoolExecutor(WORKERS) as pool:
        truths = list(pool.map(lambda one: _truth(folder, *one), drawn))
    return [_row(folder, patient, truth) for (_, patient), truth in zip(drawn, truths, strict=True)]


def _truth(folder: pathlib.Path, number: int, patient: Mapping[str, Any]) -> dict[str, Any]:
    """Resting ratio, FFR and flows of a patient in 3D, and the losses of its lumen."""
    true, age = patient["truth"], patient["age_group"]
    (anatomy,) = sample_anatomies((SEED, number), 1, side=patient["side"], age=_AGES[age])
    law = artery_law(anatomy)
    conditions = {
        "rest": {**true["rest"], "ffr": min(true["rest_ratio"], HIGHEST_RATIO)},
        patient["drug"]: dict(true["stress"]),
    }
    conditions["rest"]["cardiac_output_l_per_min"] = _CARDIAC_OUTPUT[age]
    text = case_text(
        {
            "id": patient["id"],
            "anatomy": anatomy,
            "law": (float(law.R0), float(law.K)),
            "conditions": conditions,
        }
    )
    text += f"[coronary]\nP_venous_mmHg = {true['venous_mmHg']}\nim_factor = {true['grip']}\n"
    text += "[stress.factors]\n" + "".join(f"{R} = {true['bed_factor']}\n" for R in _BED)
    found: dict[str, Any] = {"law": law}
    for condition in conditions:
        row = beat(patient["id"], folder / patient["id"], text, condition)
        print(f"  {row}", file=sys.stderr, flush=True)
        kind = "rest" if condition == "rest" else "stress"
        found[kind], found[f"{kind}_flow"] = row.get("ratio"), _flow(folder, patient, condition)
    return found


def _flow(folder: pathlib.Path, patient: Mapping[str, Any], condition: str) -> float:
    """Mean flow of the anomalous artery in the last run of a condition [mL/min]."""
    place = folder / patient["id"]
    files = [place / "viscous" / condition / SIMULATION_FILE, place / condition / SIMULATION_FILE]
    file = next((file for file in files if file.is_file()), None)
    if file is None:
        return float("nan")
    ports = json.loads(file.read_text(encoding="utf-8"))["cycles"][-1]["ports"]
    return next(port["mean_Q_ml_per_min"] for name, port in ports.items() if "anomalous" in name)


def _row(folder: pathlib.Path, patient: Mapping[str, Any], truth: dict[str, Any]) -> dict[str, Any]:
    row = {key: patient[key] for key in ("id", "age_group", "side", "drug")}
    if truth["rest"] is None or truth["stress"] is None:
        return row | {"why": "no whole beat"}
    patient_seen = load_patient(read_case(_measured(folder, patient, truth)))
    try:
        (found,) = uncertain_ratios(patient_seen, Progress()).found
    except RuntimeError as error:
        return row | {"why": str(error)}
    low, high = found.found.interval()
    return row | {
        "rest_ratio": truth["rest"],
        "ffr": truth["stress"],
        "median": found.found.median,
        "low": low,
        "high": high,
        "width": high - low,
        "covered": bool(low <= truth["stress"] <= high),
    }


def _measured(
    folder: pathlib.Path, patient: Mapping[str, Any], truth: Mapping[str, Any]
) -> pathlib.Path:
    """The case file of what was measured of a patient, each with the error drawn for it."""
    true, seen, drug = patient["truth"], patient["measured"], patient["drug"]
    ratio = truth["rest"] + seen["rest_ratio"] - true["rest_ratio"]
    stress = dict(seen["stress"])
    if seen["cfr"] is not None:
        stress["flow_reserve"] = (
            truth["stress_flow"] / truth["rest_flow"] * (seen["cfr"] / true["cfr"])
        )
    lines = ["[patient]", f'id = "{patient["id"]}"', "[surrogate]", 'law = "quadratic"']
    for key, name in (("R0_dyn_s_per_cm5", "R0"), ("K_dyn_s2_per_cm8", "K")):
        lines.append(f"{key} = {float(getattr(truth['law'], name)) * seen[key] / true[key]:.6g}")
    rest = {
        **seen["rest"],
        "ffr": min(ratio, HIGHEST_RATIO),
        "ffr_sd": REST_RATIO_ERROR,
    }
    for name, entry in (("rest", rest), (drug, stress)):
        lines.append(f"[condition.{name}]")
        lines += [f"{key} = {value:.6g}" for key, value in entry.items()]
    lines += ["[coronary]", f"im_factor = {IM_FACTOR[patient['side']]}"]
    lines += ["[body]", f"age_years = {true['age']:.3g}"]
    file = folder / patient["id"] / "measured.toml"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file
