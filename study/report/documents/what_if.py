"""The document of the command `what-if`, `what-if.json`."""

import dataclasses

from study.report.documents.parts import Note
from study.run.what_if_parts import OperatedLumen, OperatedRatio
from study.store.provenance import Provenance


@dataclasses.dataclass(frozen=True)
class WhatIfDocument:
    """Lumen, loss and ratios before and after an operation.

    Attributes:
        format: name and version of the layout.
        kind: `what-if`.
        patient: id of the patient.
        operation: `unroof`, `reimplant` or `stent`.
        diameter_mm: of a stent; None: that of the artery beyond its intramural course.
        mode: `0d` or `3d`.
        law: law of the artery in 0D; `curve` in 3D.
        rule: the case's own stress rule.
        alpha: scale of the resistances of the bed, the same before and after [-].
        verdict: the change in a sentence.
        before: the artery before.
        after: the artery after.
        ratios: of each condition, at rest first.
        notes: what is kept, what is idealised.
        provenance: inputs, options, versions.
    """

    format: str
    kind: str
    patient: str
    operation: str
    diameter_mm: float | None
    mode: str
    law: str
    rule: str
    alpha: float
    verdict: str
    before: OperatedLumen
    after: OperatedLumen
    ratios: list[OperatedRatio]
    notes: list[Note]
    provenance: Provenance
