"""A haemodynamic condition of a case, and what it shares with one of a record."""

import dataclasses
from typing import Annotated, ClassVar, Literal

from pydantic.dataclasses import dataclass

from study.case.beat import Beat
from study.case.schema import Location, Number, Quantity, Word, keys_of

FFR_MEANING = (
    "FFR is mean distal over mean aortic pressure; at 1 or above there is no loss to calibrate: "
    "usually the wire has drifted or lies lower than the aortic sensor; correct it, or omit ffr"
)

SystolicPressure = Annotated[
    Number, Quantity("pressure", "mmHg", 30.0, 300.0, text="aortic", example=110.0)
]
DiastolicPressure = Annotated[
    Number, Quantity("pressure", "mmHg", 20.0, 200.0, text="aortic", example=65.0)
]
Period = Annotated[
    Number,
    Quantity(
        "time", "s", 0.2, 3.0, aliases=("heart_rate", "HR"), text="60 / heart rate", example=0.8
    ),
]  # fmt: skip


@dataclass(frozen=True)
class Condition:
    """A haemodynamic condition of the patient: [condition.rest], and any number under stress.

    The condition at rest is the one named so; calibration needs its ffr, the resting Pd/Pa. All
    others, under any name, are stress. At rest, pressures, period and cardiac output may be left
    out where [body] tells them.
    """

    added_later: ClassVar[frozenset[str]] = frozenset(
        {"drug", "flow_reserve", "flow_reserve_sd", "ifr"}
    )
    name: str
    kind: Annotated[
        Literal["rest", "stress"],
        Word(required=False, text="stress for every condition but rest", example="rest"),
    ]
    P_systolic: SystolicPressure
    P_diastolic: DiastolicPressure
    period: Period
    cardiac_output: Annotated[
        Number | None,
        Quantity(
            "flow", "l_per_min", 0.15, 40.0, aliases=("CO",), text="cardiac output", example=4.5
        ),
    ] = None  # fmt: skip
    stroke_volume: Annotated[
        Number | None,
        Quantity("volume", "ml", 1.0, 300.0, aliases=("SV",), text="stroke volume", example=60.0),
    ] = None
    ffr: Annotated[
        Number | None,
        Quantity(
            "ratio", "", 0.0, 1.0, exclusive=True, advice=FFR_MEANING, example=0.91,
            text="measured mean distal over mean aortic pressure",
        ),
    ] = None  # fmt: skip
    ffr_sd: Annotated[
        Number | None,
        Quantity(
            "ratio", "", 0.0, 0.3, exclusive=True, text="standard deviation of ffr", example=0.01
        ),
    ] = None  # fmt: skip
    ifr: Annotated[
        Number | None,
        Quantity(
            "ratio", "", 0.0, 1.1, exclusive=True, example=0.93,
            text="at rest: measured instantaneous wave-free ratio, compared with the model",
        ),
    ] = None  # fmt: skip
    flow_reserve: Annotated[
        Number | None,
        Quantity(
            "ratio", "", 0.3, 8.0, example=2.2,
            text="under stress: measured mean flow in the artery over that at rest",
        ),
    ] = None  # fmt: skip
    flow_reserve_sd: Annotated[
        Number | None,
        Quantity(
            "ratio", "", 0.0, 3.0, exclusive=True, text="its sd; 15 % of it if not given",
            example=0.3,
        ),
    ] = None  # fmt: skip
    drug: Annotated[
        Literal["adenosine", "dobutamine", "other"] | None,
        Word(text="given under stress; default: by the condition's name", example="dobutamine"),
    ] = None
    waveform: Annotated[
        Beat | None,
        Location(
            described="CSV file with time_s,P_aorta_mmHg", text="one measured beat",
            example="rest_beat.csv",
        ),
    ] = None  # fmt: skip

    def without_outcome(self) -> "Condition":
        """The condition without its drug and what was measured of its flow: what drives a run."""
        return dataclasses.replace(
            self,
            ffr=None,
            ffr_sd=None,
            ifr=None,
            flow_reserve=None,
            flow_reserve_sd=None,
            drug=None,
        )


CONDITION = keys_of(Condition)

CONDITION_NAME = r"[A-Za-z][A-Za-z0-9_-]{0,39}"
"""Names that a condition may have."""

MOST_CONDITIONS = 100
"""Of a case or a record: some are rest and drugs, many are a slip."""
