"""What a case takes from the body of its patient, while it is read.

The numbers are those of `calibration.body_priors`. At rest they stand in for a period, pressures
and a cardiac output that the case does not give; they set the beds of both coronary arteries
(`calibration.body_bed`), the size of a drawn anatomy and the aorta behind an ultrasound pullback.
A case that gives one of the two pressures has the other one in the usual proportion to it.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import calibration
import lumped
from study.case.anatomy import IvusAnatomy, SyntheticAnatomy
from study.case.assumed import Assumed, FromBody
from study.case.body import BodyParameters
from study.case.parameters import CoronaryParameters
from study.case.table_reader import Context

_ADULT_YEARS = 20.0
"""End of the growth charts."""

_LARGEST_SCORE = 5.0
_SURFACE_SLACK = 0.15

_REST = ("P_systolic", "P_diastolic", "period")
_RESISTANCES = ("R_1", "R_2", "R_3")


class Usual:
    """What is usual of a patient, and what of it a case came to assume."""

    def __init__(self, parameters: BodyParameters):
        """Nothing is computed for a body of which nothing is known."""
        self.parameters = parameters
        self.assumed: dict[str, Assumed] = {}
        p = parameters
        known = (p.weight_kg, p.height, p.age_years, p.sex)
        self.known = any(number is not None for number in known)
        if self.known:
            male = None if p.sex is None else float(p.sex == "male")
            self.body = calibration.Body(p.weight_kg, p.height, p.age_years, male)
            self.spreads = calibration.body_priors(self.body, dominance=p.dominance)

    def has(self, *names: str) -> bool:
        """Whether all these numbers follow from the body."""
        return self.known and all(name in self.spreads for name in names)

    def value(self, name: str) -> float:
        """The median of a number [CGS]."""
        return calibration.central_range(self.spreads[name])[0]

    def assume(self, key: str, name: str, *, text: str = "", scale: float = 1.0) -> float:
        """Note that a case takes a number, times a scale, for one that it does not give."""
        prior = next(prior for prior in calibration.PRIORS if prior.name == name)
        spread = self.spreads[name]
        median, low, high = (scale * end for end in calibration.central_range(spread))
        self.assumed[key] = Assumed(
            text=text or prior.text,
            value=median,
            low=low,
            high=high,
            unit=prior.unit,
            factor=prior.factor,
            source=prior.source,
            sd=scale * float(spread.sd) if isinstance(spread, calibration.Normal) else None,
            log_sd=float(spread.log_sd) if isinstance(spread, calibration.LogNormal) else None,
        )
        return self.assumed[key].value


def supplied_at_rest(usual: Usual, table: Mapping[str, Any], context: Context) -> tuple[str, ...]:
    """Fields of the condition at rest that need not be given, since the body tells them.

    A measured beat has its own pressures and period. A body at fault is mended first: what it
    would tell is not asked for.
    """
    if "waveform" in table:
        return ()
    if any(fault.key.startswith("body.") for fault in context.faults):
        return _REST
    return tuple(name for name in _REST if usual.has(name))


def fill_rest(usual: Usual, values: dict[str, Any], given: Mapping[str, bool]) -> None:
    """Put what is usual in place of what the condition at rest does not give.

    Args:
        usual: of the patient.
        values: of the condition; changed.
        given: by field, whether the file gives it, be it at fault.
    """
    for name in (name for name in _REST if usual.has(name) and not given[name]):
        other = {"P_systolic": "P_diastolic", "P_diastolic": "P_systolic"}.get(name)
        scale = 1.0
        if other is not None and given[other] and values[other] is not None:
            scale = values[other] / usual.value(other)
        values[name] = usual.assume(f"condition.rest.{name}", name, scale=scale)
    period = values["period"]
    if values["cardiac_output"] is not None or given["cardiac_output"] or period is None:
        return
    if values["stroke_volume"] is not None:
        values["cardiac_output"] = values["stroke_volume"] / period
    elif usual.has("stroke_volume"):
        _assume_output(usual, values, period, measured=given["period"])


def _assume_output(usual: Usual, values: dict[str, Any], period: float, *, measured: bool) -> None:
    """The usual stroke volume over the period, whose own spread adds where it is assumed too."""
    key = "condition.rest.cardiac_output"
    values["cardiac_output"] = usual.assume(key, "stroke_volume", scale=1.0 / period)
    volume = usual.assumed[key]
    spread = 0.0 if measured else usual.assumed["condition.rest.period"].log_sd or 0.0
    log_sd = math.hypot(volume.log_sd or 0.0, spread)
    known = calibration.LogNormal(volume.value, log_sd)
    _, low, high = calibration.central_range(known)
    usual.assumed[key] = dataclasses.replace(
        volume,
        text="cardiac output at rest",
        low=low,
        high=high,
        unit="l/min",
        factor=lumped.L_PER_MIN,
        source=f"stroke volume over period; {volume.source}",
        log_sd=log_sd,
    )


def complete(
    usual: Usual, values: dict[str, Any], document: Mapping[str, Any], context: Context
) -> FromBody:
    """Size the anatomy and the coronary beds; values that the body tells are put in place.

    Args:
        usual: of the patient.
        values: what the tables hold, by table; `anatomy` and `coronary` are changed.
        document: the parsed file.
        context: where faults are collected.
    """
    if not usual.known:
        return FromBody()
    area = None
    if usual.has("sinus_diameter"):
        area = float(calibration.body_surface_area(usual.body))
        values["anatomy"] = _sized(usual, values["anatomy"], area)
    artery = _anomalous_artery(usual.parameters, values["anatomy"], context)
    normal = None
    rest = values["condition"].get("rest")
    if rest is not None and usual.has("left_flow") and not context.faults:
        mean = (rest["P_systolic"] + 2.0 * rest["P_diastolic"]) / 3.0
        venous = (values["coronary"] or {}).get("P_venous")
        if venous is not None and venous < mean:  # else nothing flows, which `check_case` refuses
            normal = _beds(usual, values, document.get("coronary", {}), artery, mean)
        _assume_loss(usual, values, rest["ffr"], mean, artery)
    notices = tuple(_notices(usual, values["anatomy"], area))
    return FromBody(dict(usual.assumed), area, normal, notices)


def _sized(usual: Usual, anatomy: Any, area: float) -> Any:
    """The anatomy in the size of the body, where the case gives none."""
    if isinstance(anatomy, SyntheticAnatomy) and anatomy.body_surface_area_m2 is None:
        usual.assumed["anatomy.body_surface_area"] = Assumed(
            "body surface area, which sizes the drawn anatomy", area, area, area, "m2", 1.0,
            "Haycock et al. 1978, J Pediatr 93:62, from weight and height",
        )  # fmt: skip
        return dataclasses.replace(anatomy, body_surface_area_m2=area)
    known = ("aorta_radius", "aorta_centerline")
    if isinstance(anatomy, IvusAnatomy) and all(getattr(anatomy, key) is None for key in known):
        text = "radius of the aorta at the ostium"
        radius = usual.assume("anatomy.aorta_radius", "sinus_diameter", text=text, scale=0.5)
        return dataclasses.replace(anatomy, aorta_radius=radius)
    return anatomy


def _anomalous_artery(parameters: BodyParameters, anatomy: Any, context: Context) -> str:
    stated = parameters.anomalous_artery
    drawn = anatomy.side if isinstance(anatomy, SyntheticAnatomy) else None
    if stated is not None and drawn is not None and stated != drawn:
        problem = f"the anatomy is drawn with an anomalous {drawn} artery"
        cure = "leave anomalous_artery out, or correct side below [anatomy]"
        context.add("body.anomalous_artery", stated, problem, cure, f'"{drawn}"')
    return drawn or stated or "right"


def _beds(
    usual: Usual, values: dict[str, Any], given: Mapping[str, Any], artery: str, mean: float
) -> dict[str, float]:
    """Size the anomalous bed, unless the case gives a resistance of it; returns the normal one."""
    own = CoronaryParameters(**values["coronary"])
    other = "left" if artery == "right" else "right"
    if not any(key.startswith(_RESISTANCES) for key in given):
        text = f"flow at rest of the anomalous ({artery}) artery, which sets its bed"
        flow = usual.assume("coronary.flow", f"{artery}_flow", text=text)
        stated = {name for name in ("C_a", "C_im") if any(key.startswith(name) for key in given)}
        sized = _for_flow(own, flow, mean)
        kept = {name: value for name, value in sized.items() if name not in stated}
        own = dataclasses.replace(own, **kept)
        values["coronary"] = dataclasses.asdict(own)
    text = f"flow at rest of the normal ({other}) artery, which sets its bed"
    return _for_flow(own, usual.assume("normal_artery.flow", f"{other}_flow", text=text), mean)


def _for_flow(parameters: CoronaryParameters, flow: float, mean: float) -> dict[str, float]:
    bed = lumped.nominal_coronary(**dataclasses.asdict(parameters))
    sized = calibration.bed_for_flow(bed, flow, mean)
    return {name: float(getattr(sized, name)) for name in (*_RESISTANCES, "C_a", "C_im")}


def _assume_loss(
    usual: Usual, values: Mapping[str, Any], ffr: float | None, mean: float, artery: str
) -> None:
    """R0 of the linear law where nothing else tells it: the drop at rest over the usual flow."""
    given = values["surrogate"]
    drawn = isinstance(values["anatomy"], IvusAnatomy)
    if ffr is None or given["R0"] is not None or given["law"] != "linear" or drawn:
        return
    flow = usual.value(f"{artery}_flow")
    usual.assume("surrogate.R0", f"{artery}_flow", text="R0 of the anomalous artery")
    entry = usual.assumed["surrogate.R0"]
    drop = (1.0 - ffr) * mean
    usual.assumed["surrogate.R0"] = dataclasses.replace(
        entry,
        value=drop / flow,
        low=drop / entry.high,
        high=drop / entry.low,
        unit="dyn s/cm5",
        factor=1.0,
        source=f"the drop at rest over its usual flow; {entry.source}",
    )


def _notices(usual: Usual, anatomy: Any, area: float | None) -> list[str]:
    p, found = usual.parameters, []
    if p.age_years is not None and p.age_years <= _ADULT_YEARS and p.sex is not None:
        male, scores = float(p.sex == "male"), {}
        if p.weight_kg is not None:
            words = f"weight of {p.weight_kg:g} kg"
            scores[words] = calibration.modified_weight_score(p.weight_kg, p.age_years, male)
        if p.height is not None:
            words = f"height of {p.height:g} cm"
            scores[words] = calibration.modified_height_score(p.height, p.age_years, male)
        found += [
            f"A {words} and an age of {p.age_years:g} years contradict each other:"
            f" {float(score):+.1f} standard deviations on the growth charts. Check [body]: all that"
            " is assumed from it follows these numbers."
            for words, score in scores.items()
            if abs(float(score)) > _LARGEST_SCORE
        ]
    drawn = anatomy.body_surface_area_m2 if isinstance(anatomy, SyntheticAnatomy) else None
    if area is not None and drawn is not None and abs(drawn / area - 1.0) > _SURFACE_SLACK:
        found.append(
            f"The anatomy is drawn for {drawn:.2f} m2 of body surface, the body has {area:.2f} m2;"
            " leave body_surface_area_m2 out to draw it for this body."
        )
    return found
