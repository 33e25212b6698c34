"""The document of the command `plan-measurement`, `plan.json`."""

from diagnosis import Record, noise_of
from diagnosis.next_measurement import ISOLATED, next_measurements
from lumped.units import MMHG
from study.report.diagnosis_results import measurements
from study.report.documents.plan import PlanDocument, SensorSet
from study.report.uncertainty_part import uncertainty_parts
from study.run.diagnosis import Plan
from study.run.reduced_results import Intervals
from study.store.json_form import ABSENT
from study.store.layouts import FORMAT
from study.store.provenance import Provenance

_MOST_MEASUREMENTS = 6


def plan_document(
    record: Record,
    plan: Plan,
    provenance: Provenance,
    intervals: tuple[Intervals, str] | None = None,
) -> PlanDocument:
    """What to measure next, and what sets of sensors could show in these conditions.

    Args:
        record: the record.
        plan: what was found for it.
        provenance: where the result comes from.
        intervals: FFR of a case with intervals, and the law of its artery; None without.
    """
    found = plan.diagnosis
    return PlanDocument(
        kind="plan",
        format=FORMAT,
        id=record.id,
        next_measurements=[]
        if found is None
        else measurements(next_measurements(found, _MOST_MEASUREMENTS)),
        sensors={
            name: SensorSet(
                isolable=[effect for effect, gain in row.items() if gain >= ISOLATED],
                expected_log_bayes_factor={effect: round(gain, 3) for effect, gain in row.items()},
            )
            for name, row in plan.isolability.items()
        },
        noise_sd_mmHg=noise_of(record).pressure_sd / MMHG,
        provenance=provenance,
        uncertainty=(
            ABSENT if intervals is None else uncertainty_parts(intervals[0].found, intervals[1])
        ),
    )
