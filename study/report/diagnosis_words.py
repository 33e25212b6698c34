"""What a diagnosis says and advises, in sentences for people who have to act on it."""

from collections.abc import Mapping

import numpy as np

from diagnosis import Diagnosis, Effect, find_effect
from diagnosis.next_measurement import VISIBLE, next_measurements, usual_visibility
from diagnosis.shrink import held_out_gap
from diagnosis.steadiness import WORDS
from diagnosis.verdict import NO_GAP
from diagnosis.where import forcing_shares
from lumped import MMHG
from study.report.number_formats import with_sd

LISTED, MOST_LISTED = 0.05, 5
"""Probability from which a cause of an ambiguous set is listed, and how many are."""

DEMONSTRATED = 0.05
"""Chance from noise alone below which the misfit of the base model is a gap."""

LIKELY_PLACE = 0.1
"""Share of a free forcing's evidence from which its place is told."""

_LOOK = {
    "ostium": "the ostium and proximal vessel (narrowing over the beat)",
    "wall": "the vessel walls",
    "microvasculature": "the microvessels (resistance over the beat)",
    "pump": "the heart muscle's squeeze (its time course, how long it ejects)",
    "inlet": "the aortic pressure that the model is given",
    "aortic sensor": "the aortic catheter (damping, whip, clipping)",
    "distal sensor": "the pressure wire (echo, whip, clipping, contact with the wall)",
    "flow sensor": "the measured flow (calibration, angle of the probe, area of the vessel)",
}


def sentence(diagnosis: Diagnosis, chance: float) -> str:
    """The verdict in a sentence or two.

    Args:
        diagnosis: the diagnosis.
        chance: that noise alone leaves so large a misfit of the base model.
    """
    judgement, effects = diagnosis.judgement, diagnosis.effects
    if judgement.unlike_beats:
        ways = "; ".join(WORDS[way] for way in judgement.unlike_beats)
        return (
            f"The beats of the record are not alike: {ways}. One mean beat does not represent them,"
            " so no cause is named."
        )
    if judgement.verdict == "no_gap":
        return (
            "No gap can be demonstrated: measurement error and the patient's unknowns explain the "
            "record. Effects that calibration absorbs may still act."
        )
    if judgement.verdict == "named":
        parts = [find_effect(effects, name).sentence for name in judgement.named]
        what = "The gap" if chance < DEMONSTRATED else "The record"
        return f"{what} is explained: {'; and '.join(parts)}."
    if judgement.verdict == "unknown":
        return _partly(diagnosis, chance)
    return f"{_found(diagnosis, chance)}; the data cannot tell between: {_several(diagnosis)}."


def _found(diagnosis: Diagnosis, chance: float) -> str:
    """Whether there is a gap: the base model misses the data, or fits them with odd unknowns."""
    if chance < DEMONSTRATED:
        return "There is a gap"
    none = diagnosis.judgement.probabilities["none"]
    return (
        f"The base model meets the data within their noise (p = {chance:.2g}), so no gap is "
        f"demonstrated, but it needs unusual unknowns (probability of no gap {none:.2g})"
    )


def _several(diagnosis: Diagnosis) -> str:
    """The likeliest of a set, and how many more there are."""
    names = diagnosis.judgement.named
    likely = [n for n in names if diagnosis.judgement.probabilities[n] >= LISTED][:MOST_LISTED]
    likely = likely or list(names[:MOST_LISTED])
    more = len(names) - len(likely)
    rest = f"; and {more} less likely causes or pairs" if more > 1 else ""
    return ", ".join(_plain(n) for n in (likely if more > 1 else names)) + rest


def _partly(diagnosis: Diagnosis, chance: float) -> str:
    """The verdict where something acts that is not in the catalogue."""
    near = ", ".join(_plain(name) for name in diagnosis.judgement.named)
    if not diagnosis.judgement.confirmed:
        fits = "fits the data" if diagnosis.judgement.closed else "fits part of the data"
        return (
            f"{_found(diagnosis, chance)}. {near.capitalize()} {fits}, but predicts the conditions"
            " that were left out worse than the model without it, so the cause is a different one."
        )
    if diagnosis.known_part:
        known = (find_effect(diagnosis.effects, name).sentence for name in diagnosis.known_part)
        parts = "; and ".join(known)
        return f"The gap is explained in part: {parts}. What is left is not in the catalogue."
    return (
        f"{_found(diagnosis, chance)}, and no effect of the catalogue explains it. "
        f"The nearest is {near}, which leaves part of it unexplained."
    )


def to_do(diagnosis: Diagnosis, conditions: list[str]) -> list[str]:
    """What follows from the verdict, in order.

    Args:
        diagnosis: the diagnosis.
        conditions: names of the record's conditions.
    """
    return [*_of_verdict(diagnosis, conditions), *bed_remark(diagnosis)]


def bed_remark(diagnosis: Diagnosis) -> list[str]:
    """What it means that the bed of the muscle is not the model's."""
    if not diagnosis.record.n_sensors or diagnosis.other_bed < 0.5:
        return []
    return [
        "Keep in mind: the waveforms suggest that the coronary bed is not the single layer of the "
        f"model (probability {diagnosis.other_bed:.2f}). The diagnosis allows for this; an effect "
        "that changes the distal trace less than such a bed does can go unnoticed."
    ]


def _of_verdict(diagnosis: Diagnosis, conditions: list[str]) -> list[str]:
    """What follows from the verdict itself."""
    verdict = diagnosis.judgement.verdict
    if diagnosis.judgement.unlike_beats:
        return [
            "Record again, in a steady rhythm, with a wire that was equalised at body temperature "
            "and stays in its place, six beats or more.",
            "Do not rely on this model for a condition that was not measured.",
        ]
    if verdict == "no_gap":
        steps = ["Use the calibrated model as it is."]
        if diagnosis.record.n_sensors == 0:
            steps.append(
                "Few effects show in pressure ratios or means. To look further, record both "
                "pressures over the beat, and the mean flow."
            )
        else:
            steps += _hidden(diagnosis)
        return [*steps, *doubts(diagnosis.judgement.probabilities)]
    if verdict == "named":
        checks = [*_predicted(diagnosis), *_held_out(diagnosis, conditions)]
        return [*_additions(diagnosis), *checks]
    if verdict == "ambiguous":
        measurements = [
            f"Measure: {n.sensor}. It tells {_plain(n.separates[0])} from {_plain(n.separates[1])}."
            for n in next_measurements(diagnosis, 1)
        ]
        return [
            "Add nothing to the model yet: predictions differ with the cause.",
            *(measurements or ["No single measurement on the list would tell them apart."]),
        ]
    beside = max(diagnosis.beside, key=lambda h: diagnosis.beside[h])
    shares = forcing_shares(diagnosis, beside)
    places = sorted((n for n in shares if shares[n] >= LIKELY_PLACE), key=lambda n: -shares[n])
    return [
        "Do not rely on this model for a condition that was not measured.",
        "Look at the instruments first, then where a disturbance would mimic the gap best: "
        + "; ".join(f"{_LOOK[n]}, share {shares[n]:.2f}" for n in places)
        + ". Places that leave the same trace cannot be told apart.",
    ]


def doubts(probabilities: Mapping[str, float]) -> list[str]:
    """What speaks against a verdict of no gap, where that is not the most probable.

    Args:
        probabilities: see `Judgement`.
    """
    likeliest = max(probabilities, key=lambda name: probabilities[name])
    if likeliest == "none":
        return []
    return [
        f"Keep in mind: {_plain(likeliest)} has probability {probabilities[likeliest]:.2f}, no gap "
        f"{probabilities['none']:.2f}. To avoid false alarms a gap is stated only where the latter "
        f"is below {NO_GAP:.2f}; a second or quieter record would decide."
    ]


def size_of(effect: Effect, size: float, sd: float) -> str:
    """The size of an effect with its standard deviation and unit."""
    return with_sd(size, sd) + ("" if effect.unit == "-" else f" {effect.unit}")


def _hidden(diagnosis: Diagnosis) -> list[str]:
    """Effects that would not show in the record at their usual size, and what would show them."""
    effects = [e for e in diagnosis.effects if usual_visibility(diagnosis, e.id) < VISIBLE]
    if not effects:
        return []
    parts = "; ".join(f"{_plain(e.id)} (would need {e.settled_by})" for e in effects)
    return [f"Not visible in this record at their usual size: {parts}."]


def _predicted(diagnosis: Diagnosis) -> list[str]:
    """How the named effect predicts what was left out."""
    gain = diagnosis.predicted
    if gain is None:
        return []
    if np.any(np.asarray(diagnosis.record.held_out) > 0.5):
        what, value = "the held-out conditions", float(gain.held_out)
    else:
        what, value = "conditions left out in turn", float(np.sum(gain.left_out))
    how = "better than" if value > 1.0 else "as well as"
    return [f"It predicts {what} {how} no gap does (gain in ln density {value:.1f})."]


def _additions(diagnosis: Diagnosis) -> list[str]:
    best = diagnosis.judgement.best
    steps = []
    for name in diagnosis.judgement.named:
        effect = find_effect(diagnosis.effects, name)
        h = best if name in best else (name,)
        fitted = diagnosis.fits[h]
        size = float(fitted.sizes[[e.id for e in diagnosis.effects].index(name)])
        sd = float(fitted.size_sd[h.index(name)])
        verb = "Correct the record for" if effect.place == "sensor" else "Add to the model:"
        stated = size_of(effect, size, sd)
        steps.append(f"{verb} {_plain(name)}, {stated}. To confirm: {effect.settled_by}.")
    return steps


def _held_out(diagnosis: Diagnosis, conditions: list[str]) -> list[str]:
    steps = []
    for h in held_out_gap(diagnosis):
        if h.P_distal_rms is None:
            continue
        before, after, floor = (rms / MMHG for rms in h.P_distal_rms)
        better = "shrinks" if after < before else "does not shrink"
        steps.append(
            f"Checked on {_plain(conditions[h.condition])}, which took no part in the fit: the "
            f"error of the distal pressure {better}, {before:.1f} to {after:.1f} mmHg (noise alone "
            f"{floor:.1f})."
        )
    return steps


def _plain(name: str) -> str:
    return {"none": "no gap", "unknown": "something not in the catalogue"}.get(
        name, name.replace("_", " ").replace("+", " with ")
    )
