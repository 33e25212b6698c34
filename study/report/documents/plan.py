"""The document of the command `plan-measurement`, `plan.json`."""

import dataclasses

from study.report.documents.parts import NextMeasurement
from study.report.documents.uncertainty import UncertainFFR
from study.store.json_form import ABSENT, Absent
from study.store.provenance import Provenance


@dataclasses.dataclass(frozen=True)
class SensorSet:
    """What a set of sensors could show in the conditions of the record.

    Attributes:
        isolable: effects that it would tell from no gap and from every other effect.
        expected_log_bayes_factor: ln of the evidence expected for an effect of typical size over
            its nearest rival [-], by effect.
    """

    isolable: list[str]
    expected_log_bayes_factor: dict[str, float]


@dataclasses.dataclass(frozen=True)
class PlanDocument:
    """What to measure next.

    Attributes:
        kind: `plan`.
        format: name and version of the layout.
        id: id of the record.
        next_measurements: measurements that would tell the likeliest causes apart, best first;
            none where the record holds no data.
        sensors: what each set of sensors could show.
        noise_sd_mmHg: standard deviation of a sample of a pressure.
        provenance: inputs, options, versions.
        uncertainty: FFR with intervals, their causes and what would shrink them; absent without
            a case that has a resting ratio and a condition under stress.
    """

    kind: str
    format: str
    id: str
    next_measurements: list[NextMeasurement]
    sensors: dict[str, SensorSet]
    noise_sd_mmHg: float
    provenance: Provenance
    uncertainty: list[UncertainFFR] | Absent = ABSENT
