"""What a result says, in words: the verdict, what the data determine, what looks implausible."""

import math
from collections.abc import Iterator

import jax.numpy as jnp
import numpy as np

from calibration.identifiability import RATIO_PARAMETERS, RatioIdentifiability
from calibration.identifiability import identifiability as combinations
from lumped import ML_PER_MIN, MM, MMHG
from study.case.laws import LINEAR, QUADRATIC
from study.case.model import Case
from study.report.body_words import body_notes
from study.report.documents.parts import Note
from study.report.headline import Reading, headline
from study.run.limits import CATHETER_MM
from study.run.patient import ContouredArtery, ratio_error
from study.run.reduced_results import CaseResult, Intervals, Run
from study.store.result_names import CALIBRATED, FIXED

FLOW_RANGE = (30.0, 200.0)
"""Resting flow of one coronary artery of an adult [mL/min]; right ones lie low, left ones high."""


def flow_range(case: Case) -> tuple[float, float]:
    """Usual resting flow of the anomalous artery: of the body, else of an adult [mL/min]."""
    usual = case.from_body.assumed.get("coronary.flow")
    return FLOW_RANGE if usual is None else (usual.low / ML_PER_MIN, usual.high / ML_PER_MIN)


ALPHA_RANGE = (0.1, 10.0)
"""Beyond this the nominal outlet was more than tenfold off [-]."""

RESERVE_RANGE = (1.5, 5.0)
"""Stress flow over resting flow in healthy arteries, children and adults [-]."""


def verdict(result: CaseResult) -> str:
    """The result in one or two sentences."""
    case = result.patient.case
    target = result.calibrations[case.surrogate.law].target
    if not result.patient.stresses:
        alpha = result.calibrations[case.surrogate.law].alpha
        return (
            f"The measured resting ratio of {target:.2f} is met with alpha = {alpha:.3g}. "
            "The case has no stress condition, so no FFR is predicted."
        )
    concluded = result.uncertainty is None
    return headline(stress_readings(result), what="Predicted FFR", concluded=concluded)


def stress_readings(result: CaseResult) -> list[Reading]:
    """FFR of every condition under stress by every law and rule, the case's own first."""
    case = result.patient.case
    found = []
    for name in result.patient.stresses:
        own, entry = result.run(name), case.conditions[name]
        runs = [r for r in result.runs if r.condition == name and r.boundary == CALIBRATED]
        for run in sorted(runs, key=lambda r: r is not own):
            law = f"the {run.law} law and " if len(result.calibrations) > 1 else ""
            words = f"{law}rule {run.rule}"
            found.append(
                Reading(name, words, run.ratio, run.ratio_sd, entry.ffr, ratio_error(entry))
            )
    return found


R0_CANCELS = (
    "Under the linear law the resting ratio fixes alpha/R0, and FFR depends on the two only "
    "through this quotient: it does not depend on R0."
)


def resistance_words(result: CaseResult) -> str:
    """Whether R0 matters to the predicted FFR of the case's own law; empty where it does."""
    if result.patient.case.surrogate.law != LINEAR or not result.patient.stresses:
        return ""
    if not result.patient.model.assumed:
        return R0_CANCELS
    R0 = float(result.patient.model.surrogate.R0)
    if "surrogate.R0" in result.patient.case.from_body.assumed:
        return (
            f"{R0_CANCELS} None is given, so {R0:.4g} dyn s/cm5 follows from the usual flow of the"
            " patient's body; alpha is then the resistance of the bed over the usual one."
        )
    return (
        f"{R0_CANCELS} None is given, so {R0:.4g} dyn s/cm5 is assumed; alpha and flow belong to it"
        " and are not the patient's."
    )


def identifiability(result: CaseResult) -> list[str]:
    """What the measured resting ratio determines, and what it leaves open."""
    case = result.patient.case
    own = result.calibrations[case.surrogate.law]
    rest = case.conditions["rest"]
    factor = math.exp(1.96 * own.sd_log) if own.sd_log < 10.0 else math.inf
    source = "assumed from repeated measurements" if rest.ffr_sd is None else "given in the case"
    return [
        *_determined(result.run("rest"), ratio_error(rest)),
        "Alpha belongs to the R0 (and K) used here: another R0 gives another alpha at the same "
        f"ratio. With an error of {ratio_error(rest):.3f} in the measured ratio ({source}), alpha "
        f"= {own.alpha:.3g} is known to within a factor of {factor:.2f} (95 %).",
        "How the total divides between R_1, R_2 and R_3 does not show at rest, but it decides what "
        "the printed stress rule does, because that rule changes R_2 alone.",
    ]


def _determined(rest: Run, error: float) -> list[str]:
    """Which combination of parameters the ratio fixes, from its sensitivities at fixed α."""
    names = tuple(name for name in (*RATIO_PARAMETERS, "K") if name in rest.at_fixed_alpha)
    slopes = jnp.array([rest.at_fixed_alpha[name] for name in names])
    data = combinations(rest.ratio * slopes[None, :] / error, names)
    found = RatioIdentifiability(jnp.array(rest.ratio), names, slopes, data)
    return list(found.sentences() if rest.law == LINEAR else data.sentences()[:2])


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def notes(result: CaseResult) -> list[Note]:
    """What looks implausible or needs care, the warnings first."""
    case = result.patient.case
    found = [
        *(Note("warning", f"{law.capitalize()} law left out: {why}")
          for law, why in result.failures.items()),
        *_flow_notes(result),
        *_alpha_notes(result),
        *_waveform_notes(result),
        *_reserve_notes(result),
        *_vessel_notes(result),
        *(Note(*entry) for entry in interval_notes(result.uncertainty)),
        *(Note(*entry) for entry in body_notes(case)),
    ]  # fmt: skip
    said = resistance_words(result)
    if said:
        found.append(Note("info", said))
    if result.patient.model.assumed:
        pass
    elif case.anatomy is None or result.patient.vessel is None:
        found.append(Note("info", "No contours: the resistance is the one given in the case."))
    elif case.surrogate.R0 is not None:
        drawn = result.patient.models.get(QUADRATIC)
        if drawn is not None:
            text = "R0 of the linear law is taken from the case, not the contours; quadratic law:"
            found.append(Note("info", f"{text} {drawn.origin}."))
    return sorted(found, key=lambda note: note.level != "warning")


def interval_notes(intervals: Intervals | None) -> Iterator[tuple[str, str]]:
    """Conditions without an interval, and what would narrow that of others; level and text."""
    if intervals is None:
        return
    yield from (("warning", text) for text in intervals.failures.values())
    pooled = [one.condition for one in intervals.found if one.evidence.pooled]
    if pooled:
        yield (
            "info",
            f"The response to stress ({_listed(pooled)}) is pooled over drugs or ages: give drug"
            " in [condition.NAME] and age_years in [body], where known, to narrow it.",
        )


def _flow_notes(result: CaseResult) -> Iterator[Note]:
    low, high = flow_range(result.patient.case)
    for law in result.calibrations:
        if result.patient.models[law].assumed:
            continue
        run = result.run("rest", law=law)
        flow = run.flow_ml_per_min
        if low <= flow <= high:
            continue
        cause = (
            "the resistance used for the artery is too small to explain the measured ratio: a "
            "narrower lumen than the image shows, the pressure wire in it, or losses that the "
            "law leaves out"
            if flow > high
            else "the resistance used for the artery is large for the measured ratio"
        )
        yield Note(
            "warning",
            f"With the {law} law the measured ratio implies a resting flow of {flow:.0f} mL/min; "
            f"a coronary artery carries about {low:.0f} to {high:.0f}. Probably {cause}.",
        )


def _alpha_notes(result: CaseResult) -> Iterator[Note]:
    low, high = ALPHA_RANGE
    for law, fit in result.calibrations.items():
        if not low <= fit.alpha <= high and not result.patient.models[law].assumed:
            where = "below" if fit.alpha < low else "above"
            yield Note(
                "warning",
                f"Alpha = {fit.alpha:.3g} with the {law} law lies far {where} 1: the outlet "
                "differs more than tenfold from the nominal one. "
                + _nominal_words(result.patient.case),
            )


def _nominal_words(case: Case) -> str:
    if "coronary.flow" in case.from_body.assumed:
        return "The nominal one carries the usual flow of the patient's body, so 1 is usual."
    return (
        "The nominal total stands for a single branch (18 mL/min at 80 mmHg), so values of 0.1 to "
        "0.5 are usual for a whole artery."
    )


def _waveform_notes(result: CaseResult) -> Iterator[Note]:
    reversed_ = [
        run for run in result.runs if run.boundary == CALIBRATED and run.systolic_share < 0.0
    ]
    if reversed_:
        names = sorted({run.condition for run in reversed_})
        laws = sorted({run.law for run in reversed_})
        yield Note(
            "warning",
            f"The mean flow in systole is negative ({_listed(names)}; {_listed(laws)} law): "
            f"{_squeezed(result.patient.case)}, so the squeezed volume leaves backwards. "
            "Mean ratios hardly depend on it; the flow waveform does.",
        )


def _squeezed(case: Case) -> str:
    if "coronary.flow" in case.from_body.assumed:
        return "three quarters of the published resistance lie behind the squeezed C_im"
    return "alpha scales the resistances but not C_im"


def _reserve_notes(result: CaseResult) -> Iterator[Note]:
    low, high = RESERVE_RANGE
    rest = result.run("rest")
    slight: dict[str, list[float]] = {}
    for name in result.patient.stresses:
        for rule in result.patient.rules:
            reserve = result.run(name, rule=rule).mean_Q / rest.mean_Q
            if not low <= reserve <= high:
                slight.setdefault(rule, []).append(reserve)
    for rule, values in slight.items():
        bounds = f"{min(values):.1f}" if len(values) == 1 else _times(values)
        yield Note(
            "warning",
            f'Under the rule "{rule}" flow rises only {bounds}-fold from rest; healthy arteries '
            f"reach {low:g} to {high:g}. The predicted FFR is probably too high."
            if max(values) < low
            else f'Under the rule "{rule}" flow changes {bounds}-fold from rest; healthy arteries '
            f"reach {low:g} to {high:g}.",
        )


def _times(values: list[float]) -> str:
    low, high = f"{min(values):.1f}", f"{max(values):.1f}"
    return low if low == high else f"{low}- to {high}"


def _vessel_notes(result: CaseResult) -> Iterator[Note]:
    vessel = result.patient.vessel
    if vessel is None:
        return
    minor = float(np.min(np.asarray(vessel.calipers.minor)))
    ratio = minor / (CATHETER_MM * MM)
    limit = f"{CATHETER_MM:.2f} mm"
    text = (
        f"The narrowest minor axis is {minor / MM:.2f} mm; the ultrasound catheter itself is "
        f"{limit} thick and holds the lumen open to that width."
    )
    yield Note("warning" if ratio < 1.1 else "info", text)
    yield _drop_note(result, vessel)


def _drop_note(result: CaseResult, vessel: ContouredArtery) -> Note:
    """The drop that the contours explain at ordinary flows against the one that was measured."""
    rest = result.run("rest")
    least, most = flow_range(result.patient.case)
    Q = np.array([least, most]) * ML_PER_MIN
    low, high = np.asarray(vessel.losses.law.pressure_drop(Q)) / MMHG
    needed = rest.drop_mmHg
    text = (
        f"The measured ratio means a mean drop of {needed:.1f} mmHg at rest. The contours "
        f"explain {low:.1f} mmHg at {least:.0f} mL/min and {high:.1f} mmHg at "
        f"{most:.0f} mL/min."
    )
    return Note("warning" if needed > high else "info", text)


def fixed_error(result: CaseResult) -> float:
    """Resting ratio with the nominal outlet, less the measured one [-]."""
    law = result.patient.case.surrogate.law
    return result.run("rest", boundary=FIXED).ratio - result.calibrations[law].target
