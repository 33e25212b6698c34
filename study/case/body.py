"""The table [body] of a case. What follows from it: `study.case.from_body`."""

from typing import Annotated, Literal

from pydantic.dataclasses import dataclass

from study.case.schema import Number, Quantity, Word


@dataclass(frozen=True)
class BodyParameters:
    """The body of the patient. What the case does not give at rest is assumed from it.

    Pressures need age, height and sex; the heart rate needs age; the cardiac output weight and
    height; the flow of the coronary arteries, and with it their beds, height. A number that the
    case gives always wins, and the result says which ones were assumed and from which source
    (docs/body.md). The age also tells which flow reserves of the literature apply.
    """

    weight_kg: Annotated[
        Number | None,
        Quantity("body mass", "kg", 5.0, 250.0, name="weight", text="weight", example=36.0),
    ] = None
    height: Annotated[
        Number | None,
        Quantity("length", "cm", 60.0, 230.0, text="standing", example=144.0),
    ] = None
    age_years: Annotated[
        Number | None,
        Quantity("number", "years", 2.0, 110.0, name="age", text="age", example=11.0),
    ] = None
    sex: Annotated[
        Literal["female", "male"] | None,
        Word(text="for pressures and growth charts", example="female"),
    ] = None
    dominance: Annotated[
        Literal["right", "left", "balanced"],
        Word(text="artery that supplies the inferior wall of the left ventricle"),
    ] = "right"
    anomalous_artery: Annotated[
        Literal["left", "right"] | None,
        Word(
            text="where [anatomy] does not say which; default: right", example="right"
        ),
    ] = None  # fmt: skip
