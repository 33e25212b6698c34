"""What a result says of the patient's body, and of what was assumed from it."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from jaxfsi.opening import OUTLET, inlet_name, is_anomalous, is_segment
from lumped import ML_PER_MIN
from study.case.model import Case
from study.report.documents.parts import AssumedNumber, BodyNumbers
from study.store.json_form import ABSENT, Absent

BED_NOTICE = "The bed of the normal artery is that of [coronary]"
"""How the notice begins that the normal artery's bed is not in the size of the patient."""


def body_part(case: Case) -> BodyNumbers | Absent:
    """The body and the numbers that were assumed from it; absent where nothing is known of it."""
    own, found = case.body, case.from_body
    if all(n is None for n in (own.weight_kg, own.height, own.age_years, own.sex)):
        return ABSENT
    return BodyNumbers(
        weight_kg=own.weight_kg,
        height_cm=own.height,
        age_years=own.age_years,
        sex=own.sex,
        surface_area_m2=found.surface_area_m2,
        dominance=own.dominance,
        assumed={
            key: AssumedNumber(
                text=entry.text,
                value=entry.value / entry.factor,
                low=entry.low / entry.factor,
                high=entry.high / entry.factor,
                unit=entry.unit,
                source=entry.source,
            )
            for key, entry in found.assumed.items()
        },
    )


def body_notes(case: Case) -> Iterator[tuple[str, str]]:
    """Contradictions in the body, and that numbers were assumed from it; level and text."""
    yield from (("warning", text) for text in case.from_body.notices)
    texts = [entry.text for entry in case.from_body.assumed.values()]
    if texts:
        yield (
            "info",
            f"Not measured, but assumed from the body of the patient: {'; '.join(texts)}."
            " What the case gives is taken as measured.",
        )


def normal_bed_notes(
    case: Case, openings: Iterable[str], alpha: float
) -> Iterator[tuple[str, str]]:
    """That the normal artery has the published bed, where the case does not tell the body."""
    names = tuple(openings)
    if is_segment(names) or case.from_body.normal_bed is not None:
        return
    if all(n in (OUTLET, inlet_name(names)) or is_anomalous(n) for n in names):
        return
    rest = case.conditions.get("rest") or next(iter(case.conditions.values()))
    bed = case.normal_bed
    mean = (rest.P_systolic + 2.0 * rest.P_diastolic) / 3.0
    flow = (mean - bed.P_venous) / (bed.R_1 + bed.R_2 + bed.R_3) / ML_PER_MIN
    yield (
        "info",
        f"{BED_NOTICE} and is not scaled to the patient: at rest it carries {flow:.0f} mL/min,"
        f" with {1.0 / alpha:.2g} times the resistance of the tuned anomalous bed. Give height_cm"
        " in [body] to scale it.",
    )


def body_lines(document: Mapping[str, Any]) -> Iterator[str]:
    """The body of a document and the numbers that were assumed from it, for a terminal."""
    body = document.get("body")
    if not body:
        return
    yield f"body: {body_words(body)}"
    for entry in body["assumed"].values():
        span = f"[{entry['low']:.3g}, {entry['high']:.3g}]"
        span = span if entry["low"] < entry["high"] else ""
        yield f"  assumed: {entry['text']} {entry['value']:.3g} {span} {entry['unit']}".rstrip()
        yield f"           ({entry['source']})"
    yield ""


def body_words(body: Mapping[str, Any]) -> str:
    """The body in a few words."""
    area = body["surface_area_m2"]
    words = [
        "" if body["sex"] is None else body["sex"],
        "" if body["age_years"] is None else f"{body['age_years']:g} years",
        "" if body["weight_kg"] is None else f"{body['weight_kg']:g} kg",
        "" if body["height_cm"] is None else f"{body['height_cm']:g} cm",
        "" if area is None else f"{area:.2f} m2 (Haycock et al. 1978)",
        f"{body['dominance']} dominance",
    ]
    return ", ".join(word for word in words if word)
