"""A sweep over α, as plain classes."""

import dataclasses

from study.store.json_form import ABSENT, Absent


@dataclasses.dataclass(frozen=True, kw_only=True)
class SweepRow:
    """The periodic state with an α.

    Attributes:
        alpha: scale of the resistances of the outlet [-].
        rest_ratio: at rest, mean distal over mean aortic pressure [-].
        ffr: the same under stress [-].
        ifr: instantaneous wave-free ratio [-].
        mean_P_aorta_mmHg: mean aortic pressure.
        mean_P_distal_mmHg: mean distal pressure.
        mean_flow_ml_per_min: mean coronary flow.
        systolic_share: share of the flow that passes in systole [-].
    """

    alpha: float
    rest_ratio: float | Absent = ABSENT
    ffr: float | Absent = ABSENT
    ifr: float
    mean_P_aorta_mmHg: float
    mean_P_distal_mmHg: float
    mean_flow_ml_per_min: float
    systolic_share: float


@dataclasses.dataclass(frozen=True)
class SweepResult:
    """Ratios and means of a patient over α.

    Attributes:
        patient: id of the patient.
        law: law of the artery, `linear` or `quadratic`.
        condition: name of the condition.
        rule: stress rule; None at rest.
        measured: measured ratio of the condition [-].
        error_estimate: largest of the periodic states, relative [-].
        rows: one an α.
    """

    patient: str
    law: str
    condition: str
    rule: str | None
    measured: float | None
    error_estimate: float
    rows: list[SweepRow]
