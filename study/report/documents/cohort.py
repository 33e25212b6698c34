"""The document of the command `cohort`, `cohort.json`."""

import dataclasses

from study.report.cohort_rows import Pair
from study.store.json_form import ABSENT, Absent
from study.store.provenance import Provenance


@dataclasses.dataclass(frozen=True)
class CohortPatient:
    """What became of a case.

    Attributes:
        name: of the case.
        side: anomalous artery, `left` or `right`; None where the case does not say.
        status: exit status of its command; 0 is done.
        reason: why it failed; empty where it did not.
        seconds: that its command took; with Dask since it was submitted.
        alpha: scale of the resistances of the anomalous outlet, calibrated [-]; None where there
            is none.
        extra_runs: runs of the calibration in 3D beyond the first; None in 0D.
        kept: whether an earlier command computed it.
        date: when its result was made.
        commit: of the checkout that made it; None for an installed package.
    """

    name: str
    side: str | None
    status: int
    reason: str
    seconds: float
    alpha: float | None
    extra_runs: int | None
    kept: bool
    date: str | None
    commit: str | None


@dataclasses.dataclass(frozen=True)
class CohortGroup:
    """Agreement of predicted and measured ratios in a condition, rule and boundary.

    Attributes:
        condition: name of the condition.
        rule: stress rule; None at rest.
        boundary: outlet, see `study.report.cohort_results`.
        n: number of pairs.
        bias: mean of predicted less measured [-].
        sd: standard deviation of the differences [-]; None for one pair.
        low: lower limit of agreement [-].
        high: upper limit of agreement [-].
        rmse: root mean square difference [-].
        r: Pearson's correlation [-]; None where it has none.
        bias_95: half width of the 95 % confidence interval of the bias [-].
        limit_95: the same of each limit of agreement [-].
        largest_error: largest difference, without its sign [-].
    """

    condition: str
    rule: str | None
    boundary: str
    n: int
    bias: float
    sd: float | None
    low: float | None
    high: float | None
    rmse: float
    r: float | None
    bias_95: float | None
    limit_95: float | None
    largest_error: float


@dataclasses.dataclass(frozen=True)
class CohortChange:
    """What calibration changes, over the patients with both outlets.

    Attributes:
        condition: name of the condition.
        rule: stress rule; None at rest.
        boundary: the fixed outlet.
        n: number of patients.
        rmse_fixed: root mean square difference to the measured ratio, fixed [-].
        rmse_calibrated: the same, calibrated [-].
        rmse_change: relative change of it [-]; None where it was zero.
        bias_fixed: mean difference, fixed [-].
        bias_calibrated: the same, calibrated [-].
        sd_fixed: standard deviation of the differences, fixed [-]; None for one patient.
        sd_calibrated: the same, calibrated [-].
    """

    condition: str
    rule: str | None
    boundary: str
    n: int
    rmse_fixed: float
    rmse_calibrated: float
    rmse_change: float | None
    bias_fixed: float
    bias_calibrated: float
    sd_fixed: float | None
    sd_calibrated: float | None


@dataclasses.dataclass(frozen=True)
class CohortInterval:
    """FFR of a patient with its interval.

    Attributes:
        patient: name of the case.
        side: anomalous artery, `left` or `right`; None where the case does not say.
        condition: name of the condition.
        measured: measured ratio; None where there is none [-].
        median: of FFR [-].
        low: its 5th percentile [-].
        high: its 95th percentile [-].
        chance_at_or_below_threshold: of 0.80 or less [-].
    """

    patient: str
    side: str | None
    condition: str
    measured: float | None
    median: float
    low: float
    high: float
    chance_at_or_below_threshold: float


@dataclasses.dataclass(frozen=True)
class CohortDocument:
    """Predicted and measured ratios of many patients.

    Attributes:
        format: name and version of the layout.
        kind: `cohort`.
        mode: `curve` in 0D, `3d` the whole algorithm.
        patients: what became of each case.
        pairs: predicted ratios, beside the measured ones where there are any.
        groups: their agreement by condition, rule and boundary.
        changes: what calibration changes.
        provenance: inputs, options, versions.
        intervals: FFR with intervals; absent where no case has one.
    """

    format: str
    kind: str
    mode: str
    patients: list[CohortPatient]
    pairs: list[Pair]
    groups: list[CohortGroup]
    changes: list[CohortChange]
    provenance: Provenance
    intervals: list[CohortInterval] | Absent = ABSENT
