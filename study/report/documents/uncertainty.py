"""FFR with an interval in a document."""

import dataclasses

from study.store.json_form import ABSENT, Absent


@dataclasses.dataclass(frozen=True)
class UncertaintyCause:
    """What one number of the patient does to the interval.

    Attributes:
        name: of the number.
        share: of the variance, to first order [-].
        change: of FFR by one standard deviation of the number [-].
        interval_if_known: 5th and 95th percentile of FFR if the resting ratio were measured twice,
            the flow reserve to 15 %, any other number known to 15 % of its standard deviation [-].
    """

    name: str
    share: float
    change: float
    interval_if_known: list[float]


@dataclasses.dataclass(frozen=True)
class UncertaintyLevel:
    """How a costlier model corrects the samples.

    Attributes:
        of: the costlier model, `periodic states` of the 0D model or `runs in 3D`.
        runs: of it.
        correction: `shift`, `scale` or `linear` in all numbers.
        error: standard deviation that the correction leaves in FFR; the samples have it too [-].
        correlation: of both models' FFR, each run left out; None with less than three runs [-].
        failed: further runs without FFR, since the lumen collapsed.
    """

    of: str
    runs: int
    correction: str
    error: float
    correlation: float | None
    failed: int = 0


@dataclasses.dataclass(frozen=True, kw_only=True)
class UncertainFFR:
    """FFR of a condition under stress, with all that is uncertain.

    Attributes:
        condition: name of the condition.
        law: law of the artery, `linear` or `quadratic`.
        median: of FFR [-].
        interval_90: its 5th and 95th percentile [-].
        sd: its standard deviation [-].
        chance_at_or_below_threshold: of 0.80 or less [-].
        quantiles: 41 quantiles of FFR, from 0.5 % to 99.5 % in equal steps [-].
        n_samples: samples behind them.
        n_effective: as many of equal weight say as much.
        causes: by their share, largest first.
        bed_factor: median resistance of the bed under stress over that at rest, before a flow
            reserve narrows it [-].
        bed_factor_90: its 5th and 95th percentile [-].
        bed_factor_source: where it comes from.
        rule_bed_factors: the same of each stress rule [-].
        stress_loss: median losses of the artery under stress over those at rest [-].
        flow_reserve: measured flow under stress over that at rest [-].
        flow_reserve_sd: its standard deviation [-].
        bed_factor_90_after: 5th and 95th percentile of the bed factor with it [-].
        levels: how costlier models correct the samples, in turn.
    """

    condition: str
    law: str
    median: float
    interval_90: list[float]
    sd: float
    chance_at_or_below_threshold: float
    quantiles: list[float]
    n_samples: int
    n_effective: float
    causes: list[UncertaintyCause]
    bed_factor: float
    bed_factor_90: list[float]
    bed_factor_source: str
    rule_bed_factors: dict[str, float]
    stress_loss: float
    flow_reserve: float | Absent = ABSENT
    flow_reserve_sd: float | Absent = ABSENT
    bed_factor_90_after: list[float] | Absent = ABSENT
    levels: list[UncertaintyLevel] | Absent = ABSENT
