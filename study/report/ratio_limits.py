"""Each pressure ratio beside its limit: which side it is on, and whether an interval crosses it.

- Resting Pd/Pa 0.92: Jeremias et al. 2014, J Am Coll Cardiol 63:1253.
- iFR at rest 0.89: Götberg et al. 2017, N Engl J Med 376:1813; Davies et al. 2017, 376:1824.
- FFR 0.80 with a grey zone from 0.75: Pijls et al. 1996, N Engl J Med 334:1703; De Bruyne et al.
  2012, N Engl J Med 367:991.
"""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from study.report.number_formats import signed
from study.run.limits import FFR_GREY, FFR_THRESHOLD, IFR_THRESHOLD, REST_RATIO_THRESHOLD
from study.store.result_names import CALIBRATED

Document = Mapping[str, Any]
Interval = list[float]

_Z90 = 1.6448536

SOURCES = (
    "Limits: FFR 0.80, of adults with ordinary stenoses, with the grey zone 0.75 to 0.80 in which"
    " the decision is open (Pijls 1996, De Bruyne 2012); iFR 0.89 (Götberg 2017, Davies 2017);"
    " resting Pd/Pa 0.92, in some cohorts 0.91 (Jeremias 2014). None was set for anomalous"
    " arteries."
)


class LimitRow(NamedTuple):
    """A ratio beside its limit.

    Attributes:
        name: of the ratio and its condition.
        measured: measured value [-]; None where there is none.
        predicted: value of the model [-]; None where there is none.
        interval: its 90 % interval [-]; None where none is known.
        limit: its limit [-].
        sides: side of the measured and of the predicted value, in words.
        crossed: whether the limit lies within the interval; None where none is known.
    """

    name: str
    measured: float | None
    predicted: float | None
    interval: Interval | None
    limit: float
    sides: tuple[str, str]
    crossed: bool | None


def side(value: float | None, limit: float, grey: float | None = None) -> str:
    """On which side of a limit a ratio lies, in words; a dash where there is no ratio.

    Args:
        value: the ratio [-].
        limit: at or below which an obstruction is held to matter [-].
        grey: lower end of the grey zone, where the limit has one [-].
    """
    if value is None:
        return "–"
    if value > limit:
        return "above"
    if grey is None:
        return "at or below"
    return "grey zone" if value >= grey else "below the grey zone"


def limit_rows(document: Document) -> list[LimitRow]:
    """Ratios of a run or a study beside their limits, at rest first.

    Args:
        document: the document as JSON holds it, of a run or a study.
    """
    rest = _rest_of_study(document) if document["kind"] == "study" else _rest_of_run(document)
    return [*rest, *_stressed(document)]


def _row(
    name: str,
    measured: float | None,
    predicted: float | None,
    interval: Interval | None,
    limit: float,
    grey: float | None = None,
) -> LimitRow:
    sides = side(measured, limit, grey), side(predicted, limit, grey)
    crossed = None if interval is None else interval[0] <= limit <= interval[1]
    return LimitRow(name, measured, predicted, interval, limit, sides, crossed)


def _rest(
    ratios: tuple[float | None, float | None], waves: tuple[float | None, float | None]
) -> Iterator[LimitRow]:
    """The rows at rest, from the measured and the predicted Pd/Pa and iFR."""
    if any(value is not None for value in ratios):
        yield _row("resting Pd/Pa", *ratios, None, REST_RATIO_THRESHOLD)
    if any(value is not None for value in waves):
        yield _row("iFR at rest", *waves, None, IFR_THRESHOLD)


def _rest_of_run(document: Document) -> Iterator[LimitRow]:
    entry = document["conditions"].get("rest", {})
    run = next(
        (
            run
            for run in document["runs"]
            if (run["condition"], run["law"], run["boundary"])
            == ("rest", document["law"], CALIBRATED)
        ),
        {},
    )
    ratios = entry.get("measured_rest_ratio"), run.get("rest_ratio")
    return _rest(ratios, (entry.get("measured_ifr"), run.get("ifr")))


def _rest_of_study(document: Document) -> Iterator[LimitRow]:
    row = next((row for row in document["rows"] if row["condition"] == "rest"), {})
    ratios = row.get("measured"), row.get("fsi")
    return _rest(ratios, (row.get("measured_ifr"), row.get("ifr")))


def _stressed(document: Document) -> Iterator[LimitRow]:
    for reading, interval, _ in _predictions(document):
        name = f"FFR, {reading['condition']}"
        value = reading["ffr"]
        yield _row(name, reading["measured"], value, interval, FFR_THRESHOLD, FFR_GREY)


def _predictions(document: Document) -> Iterator[tuple[Mapping[str, Any], Interval | None, str]]:
    """Own reading of each condition under stress, its interval, and what that holds."""
    intervals = {entry["condition"]: entry for entry in document.get("uncertainty", [])}
    seen: set[str] = set()
    for reading in document.get("headline", {}).get("readings", []):
        condition = reading["condition"]
        if condition in seen:
            continue
        seen.add(condition)
        if condition in intervals:
            entry = intervals[condition]
            low, high = entry["interval_90"]
            held = "with all uncertainties included"
            yield {**reading, "ffr": entry["median"]}, [low, high], held
        elif reading["ffr_sd"] > 0.0:
            half = _Z90 * reading["ffr_sd"]
            held = "from the error of the resting ratio alone"
            yield reading, [reading["ffr"] - half, reading["ffr"] + half], held
        else:
            yield reading, None, ""


def measured_words(document: Document) -> list[str]:
    """Each measured stress ratio against the prediction, a sentence each; none where none is.

    Args:
        document: the document as JSON holds it, of a run or a study.
    """
    said = []
    for reading, interval, held in _predictions(document):
        measured = reading["measured"]
        if measured is None:
            continue
        text = (
            f"Measured FFR under {reading['condition']}: {measured:.3f}; predicted"
            f" {reading['ffr']:.3f}, a difference of {signed(reading['ffr'] - measured, 3)}"
        )
        if interval is not None:
            place = "inside" if interval[0] <= measured <= interval[1] else "outside"
            text += (
                f"; the measured value lies {place} the 90 % interval {interval[0]:.3f} to"
                f" {interval[1]:.3f} ({held})"
            )
        said.append(f"{text}.")
    return said
