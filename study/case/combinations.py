"""Values that are plausible one by one and not together: a slip of unit shows in what they imply.

An unusual patient passes: the bounds leave a factor of three beyond a premature newborn and an
adult under stress (a coronary carries some 2 mL/min in the one, 500 to 1000 in the other).
"""

import math
from collections.abc import Mapping
from typing import Any

from lumped.units import ML_PER_MIN, MMHG
from study.case.ostium import R0
from study.case.schema import UNITS, Quantity, convert, readable, spellings
from study.case.table_reader import Context

FLOW_ML_PER_MIN = (0.5, 3000.0)
"""Mean flow through one coronary artery that no patient leaves [mL/min]."""

USUAL_FLOW_ML_PER_MIN = 80.0

RATIO_ERROR = 0.02
"""Of a measured ratio: twice this is given to both sides."""

LEAST_RATIO = 0.2
"""Distal over aortic mean pressure below which even an occluded artery does not fall."""


def check_case(values: Mapping[str, Any], document: Mapping[str, Any], context: Context) -> None:
    """Refuse values of a case that do not go together; faults go to the context.

    Args:
        values: what the tables hold, in CGS.
        document: the parsed file.
        context: where faults are collected.
    """
    _check_venous(values, document, context)
    _check_uncertainty(values, context)
    rest, artery = values["condition"].get("rest"), values.get("surrogate") or {}
    if rest is None or artery.get("R0") is None:
        return
    ffr, high, low = rest["ffr"], rest["P_systolic"], rest["P_diastolic"]
    given = document.get("surrogate", {})
    named = (k for k in spellings(R0) if isinstance(k, Quantity) and k.key in given)
    key = next(named, None)
    if ffr is None or high is None or low is None or key is None or high <= low:
        return
    K = (artery.get("K") or 0.0) if artery.get("law") == "quadratic" else 0.0
    mean = (high + 2.0 * low) / 3.0

    def flow(R: float, slack: float) -> float:
        drop = max(1.0 - ffr + slack, 0.0) * mean
        return 2.0 * drop / (R + math.sqrt(R**2 + 4.0 * K * drop)) / ML_PER_MIN

    R = artery["R0"]
    least, most = FLOW_ML_PER_MIN
    if flow(R, 2.0 * RATIO_ERROR) >= least and flow(R, -2.0 * RATIO_ERROR) <= most:
        return
    stated = given[key.key]
    number = stated.get("value") if isinstance(stated, dict) else stated
    problem = (
        f"with the resting ratio {ffr:g} this lets {flow(R, 0.0):.3g} mL/min through the coronary"
    )
    allowed = f"a flow of {least:g} to {most:g} mL/min"
    cure = "check R0, its unit and the resting ratio"
    if isinstance(number, int | float):
        readings = {u: convert(float(number), u, key) for u in UNITS["resistance"] if u != key.unit}
        flows = {u: flow(R * value / float(number), 0.0) for u, value in readings.items()}
        unit = min(flows, key=lambda u: abs(math.log(flows[u] / USUAL_FLOW_ML_PER_MIN)))
        if least <= flows[unit] <= most:
            cure = f"is it in {readable(unit)}? then write {key.key} = {readings[unit]:.4g}"
    context.add(f"surrogate.{key.key}", number, problem, cure, allowed)


def _check_venous(values: Mapping[str, Any], document: Mapping[str, Any], context: Context) -> None:
    venous = (values.get("coronary") or {}).get("P_venous")
    for name, condition in values["condition"].items():
        low = condition["P_diastolic"]
        if venous is not None and low is not None and venous >= low:
            problem = f"not below P_diastolic_mmHg of condition.{name}: no blood would flow"
            cure = "check both values and their units"
            value = document.get("coronary", {}).get("P_venous_mmHg")
            context.add("coronary.P_venous_mmHg", value, problem, cure, f"below {low / MMHG:g}")
            return


def check_recorded(
    values: Mapping[str, Any],
    beats: Mapping[str, Any],
    heading: str,
    traces: str,
    context: Context,
) -> None:
    """Refuse values of a recorded condition that do not go together; faults go to the context.

    Args:
        values: of the condition [mmHg, mL/s, s].
        beats: beats of each sensor [mmHg, mL/s].
        heading: name of the condition's table.
        traces: the key that names its file.
        context: where faults are collected.
    """
    _check_flow(values["mean_Q"], f"{heading}.mean_flow_ml_per_min", context)
    if "Q" in beats and values["mean_Q"] is None:
        _check_flow(float(beats["Q"].mean()), f"{traces}, Q_coronary_ml_per_min", context)
    _check_means(values, heading, context)
    aorta, distal = values["mean_P_aorta"], values["mean_P_distal"]
    if "P_aorta" in beats and "P_distal" in beats:
        aorta, distal = (float(beats[name].mean()) for name in ("P_aorta", "P_distal"))
    ratio = values["ffr"]
    if aorta is None or distal is None or ratio is None:
        return
    if abs(distal / aorta - ratio) > 5.0 * RATIO_ERROR:
        problem = f"mean distal over mean aortic pressure is {distal / aorta:.3g}"
        cure = "correct the one that is wrong; ffr is the ratio of the two means"
        context.add(f"{heading}.ffr", ratio, problem, cure, f"within {5.0 * RATIO_ERROR:g} of that")


def _check_flow(flow: float | None, key: str, context: Context) -> None:
    if flow is None or flow <= 0.0:
        return
    least, most = FLOW_ML_PER_MIN
    value = flow / ML_PER_MIN
    if least <= value <= most:
        return
    cure = "check the value and its unit (mL/min)"
    for name, unit in (("l/min", "l_per_min"), ("mL/s", "ml_per_s")):
        read = value * UNITS["flow"][unit] / ML_PER_MIN
        if 2.0 <= read <= 1000.0:
            cure = f"is this {name}? then write {read:.4g}"
            break
    problem = f"{value:.3g} mL/min through a coronary"
    context.add(key, float(f"{value:.6g}"), problem, cure, f"{least:g} to {most:g} mL/min")


def _check_means(values: Mapping[str, Any], heading: str, context: Context) -> None:
    """Refuse a mean outside the pressures that it is the mean of."""
    high, low = values["P_systolic"], values["P_diastolic"]
    aorta, distal = values["mean_P_aorta"], values["mean_P_distal"]
    kPa = UNITS["pressure"]["kPa"] / MMHG
    if high is None or low is None:
        return
    for name, mean, least in (
        ("mean_P_aorta", aorta, 0.9 * low),
        ("mean_P_distal", distal, LEAST_RATIO * (aorta or (high + 2.0 * low) / 3.0)),
    ):
        if mean is None or least <= mean <= 1.05 * high:
            continue
        problem = f"does not go with P_systolic_mmHg = {high:g} and P_diastolic_mmHg = {low:g}"
        cure = "check the value and its unit (mmHg)"
        if 0.5 * low <= mean * kPa <= 1.05 * high:
            cure = f"is this kPa? then write {mean * kPa:.4g}"
        allowed = f"{least:.4g} to {1.05 * high:.4g} mmHg"
        context.add(f"{heading}.{name}_mmHg", mean, problem, cure, allowed)


def _check_uncertainty(values: Mapping[str, Any], context: Context) -> None:
    """Refuse a range of venous pressures that is none, a deviation of nothing, iFR under stress."""
    known = values.get("uncertainty") or {}
    low, high = known.get("P_venous_low"), known.get("P_venous_high")
    if low is not None and high is not None and not low < high:
        context.add(
            "uncertainty.P_venous_high_mmHg",
            high / MMHG,
            f"the largest venous pressure is not above the least one, {low / MMHG:g} mmHg",
            "give P_venous_low_mmHg and P_venous_high_mmHg in ascending order",
            f"above {low / MMHG:g}",
        )
    for name, entry in values["condition"].items():
        for key in () if context.faults else ("flow_reserve", "ffr"):  # a refused number is None
            if entry.get(key) is None and entry.get(f"{key}_sd") is not None:
                context.add(
                    f"condition.{name}.{key}_sd",
                    entry[f"{key}_sd"],
                    f"a standard deviation without its {key}",
                    f"add {key}, or leave {key}_sd out",
                )
        if name != "rest" and entry.get("ifr") is not None:
            context.add(
                f"condition.{name}.ifr",
                entry["ifr"],
                "iFR is measured at rest, without a drug",
                "move it to [condition.rest]; mean distal over mean aortic pressure is ffr",
            )
    rest = values["condition"].get("rest") or {}
    if rest.get("drug") is not None:
        problem, cure = "a drug is given under stress, not at rest", "leave drug out here"
        context.add("condition.rest.drug", rest["drug"], problem, cure)
    if rest.get("flow_reserve") is not None:
        context.add(
            "condition.rest.flow_reserve",
            rest["flow_reserve"],
            "a flow reserve is measured under stress",
            "move it to the condition under stress in which it was measured",
        )
