"""The table [uncertainty] of a case: how well its numbers are known.

Each default has its source in `calibration.patient_inputs`, and in `calibration.stress_evidence`
where the response to stress is not given.
"""

from typing import Annotated

from pydantic.dataclasses import dataclass

from lumped.nominal import IM_FACTOR_SD, LOSS_SD, P_VENOUS_RANGE, PERIOD_SD, PRESSURE_SD
from study.case.schema import Number, Quantity


@dataclass(frozen=True)
class UncertaintyParameters:
    """How well the numbers of a case are known, for --uncertainty of jaxfsi run and study.

    Without bed_factor the response of the bed to stress follows from flow reserves in the
    literature, for the drug (key drug of the condition, else its name: adenosine, dobutamine, or
    any other) and the age of the patient, age_years in [body]. So does stress_loss. Without
    lumen_sd, which jaxfsi diagnose uses, the lumen is known to 0.1 mm by ultrasound, 0.2 by CT.
    """

    pressure_sd: Annotated[
        Number,
        Quantity("pressure", "mmHg", 0.0, 30.0, text="sd of each aortic pressure"),
    ] = PRESSURE_SD
    period_sd: Annotated[
        Number, Quantity("ratio", "", 0.0, 0.3, text="sd of the period, relative")
    ] = PERIOD_SD
    loss_sd: Annotated[Number, Quantity("ratio", "", 0.0, 1.5, text="sd of log R0 and log K")] = (
        LOSS_SD
    )
    im_factor_sd: Annotated[
        Number, Quantity("ratio", "", 0.0, 1.5, text="sd of the logarithm of im_factor")
    ] = IM_FACTOR_SD
    P_venous_low: Annotated[
        Number, Quantity("pressure", "mmHg", 0.0, 30.0, text="least one where [coronary] has 0")
    ] = P_VENOUS_RANGE[0]
    P_venous_high: Annotated[
        Number, Quantity("pressure", "mmHg", 0.1, 40.0, text="largest venous pressure")
    ] = P_VENOUS_RANGE[1]
    bed_factor: Annotated[
        Number | None,
        Quantity(
            "ratio", "", 0.05, 2.0, text="resistance of the bed under stress over that at rest",
            example=0.45,
        ),
    ] = None  # fmt: skip
    bed_factor_sd: Annotated[
        Number, Quantity("ratio", "", 0.0, 1.5, text="sd of its logarithm, where it is given")
    ] = 0.3
    stress_loss: Annotated[
        Number | None,
        Quantity(
            "ratio", "", 0.2, 10.0, text="losses of the artery under stress over those at rest",
            example=1.2,
        ),
    ] = None  # fmt: skip
    stress_loss_sd: Annotated[
        Number, Quantity("ratio", "", 0.0, 1.5, text="sd of its logarithm, where it is given")
    ] = 0.2
    lumen_sd: Annotated[
        Number | None,
        Quantity(
            "length", "mm", 0.01, 1.0, text="sd of the half-axes of the lumen as scanned",
            example=0.1,
        ),
    ] = None  # fmt: skip
