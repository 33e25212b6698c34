"""The document of the command `sweep`, `sweep.json`."""

import dataclasses

from study.run.sweep_parts import SweepRow
from study.store.provenance import Provenance


@dataclasses.dataclass(frozen=True)
class SweepDocument:
    """Ratios and flows over α, under the case's own law.

    Attributes:
        format: name and version of the layout.
        kind: `sweep`.
        patient: id of the patient.
        law: law of the artery, `linear` or `quadratic`.
        condition: name of the condition.
        rule: stress rule; None at rest.
        measured: measured ratio of the condition [-].
        error_estimate: largest of the periodic states, relative [-].
        rows: one an α.
        provenance: inputs, options, versions.
    """

    format: str
    kind: str
    patient: str
    law: str
    condition: str
    rule: str | None
    measured: float | None
    error_estimate: float
    rows: list[SweepRow]
    provenance: Provenance
