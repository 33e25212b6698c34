"""What the tables of a record hold: noise, and measured conditions."""

from typing import Annotated, Literal, get_args

from pydantic.dataclasses import dataclass

from study.case.condition import (
    CONDITION_NAME,
    FFR_MEANING,
    DiastolicPressure,
    Period,
    SystolicPressure,
)
from study.case.parameters import PatientParameters
from study.case.schema import Flag, Location, Number, Quantity, Word, keys_of

Drug = Literal["none", "adenosine", "dobutamine"]
"""What was given under a condition."""


@dataclass(frozen=True)
class NoiseParameters:
    """Noise, as standard deviations.

    That of the mean beat is estimated from the scatter of the beats where three or more were
    recorded.
    """

    pressure_sd: Annotated[
        Number | None,
        Quantity(
            "pressure", "mmHg", 0.02, 20.0, example=1.0,
            text="of one sample of the mean beat, not of one beat",
        ),
    ] = None  # fmt: skip
    pressure_offset_sd: Annotated[
        Number | None,
        Quantity(
            "pressure", "mmHg", 0.01, 20.0, text="zero error of a whole pressure trace", example=0.5
        ),
    ] = None  # fmt: skip
    flow_relative_sd: Annotated[
        Number | None,
        Quantity("ratio", "", 0.001, 1.0, text="of a flow, over its mean in a beat", example=0.05),
    ] = None
    ffr_sd: Annotated[
        Number | None, Quantity("ratio", "", 0.0005, 0.2, text="of a pressure ratio", example=0.01)
    ] = None


@dataclass(frozen=True)
class Recorded:
    """One table for each condition, under any name, in the order in which they were measured.

    Each needs the aortic pressures and the period, and something to compare with: ffr, means or
    traces.
    """

    name: Annotated[str, Word(pattern=CONDITION_NAME, described="a short name")]
    drug: Annotated[
        Drug,
        Word(text="by default what the name says", example="none"),
    ]
    period: Period
    P_systolic: SystolicPressure
    P_diastolic: DiastolicPressure
    order: Annotated[
        Number | None,
        Quantity(
            "number", "", 0.0, 20.0, whole=True, text="place in time; default: as in this file",
            example=0,
        ),
    ] = None  # fmt: skip
    mean_P_aorta: Annotated[
        Number | None, Quantity("pressure", "mmHg", 20.0, 250.0, text="aortic mean", example=86.5)
    ] = None
    mean_P_distal: Annotated[
        Number | None, Quantity("pressure", "mmHg", 5.0, 250.0, text="distal mean", example=78.5)
    ] = None
    ffr: Annotated[
        Number | None,
        Quantity(
            "ratio", "", 0.0, 1.15, exclusive=True, advice=FFR_MEANING, example=0.91,
            text="mean distal over mean aortic pressure",
        ),
    ] = None  # fmt: skip
    mean_Q: Annotated[
        Number | None,
        Quantity(
            "flow", "ml_per_min", 0.0, 2000.0, exclusive=True, name="mean_flow",
            text="coronary flow", example=130.0,
        ),
    ] = None  # fmt: skip
    waveform: Annotated[
        str | None,
        Location(
            described="CSV file with time_s,P_aorta_mmHg,P_distal_mmHg",
            text="traces beside this file", example="rest.csv", older=("file",),
        ),
    ] = None  # fmt: skip
    held_out: Annotated[bool, Flag(text="true: predicted only, then compared")] = False


PATIENT, NOISE, CONDITION = keys_of(PatientParameters), keys_of(NoiseParameters), keys_of(Recorded)
DRUGS = get_args(Drug)
