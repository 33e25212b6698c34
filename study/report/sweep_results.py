"""The document of the command `sweep`, and its rows as CSV."""

import csv
import io

from study.report.documents.sweep import SweepDocument
from study.run.sweep_parts import SweepResult
from study.store.json_form import as_json
from study.store.layouts import FORMAT
from study.store.provenance import Provenance


def sweep_document(found: SweepResult, provenance: Provenance) -> SweepDocument:
    """The document of a sweep.

    Args:
        found: what it found.
        provenance: where the result comes from.
    """
    return SweepDocument(format=FORMAT, kind="sweep", **vars(found), provenance=provenance)


def sweep_table(found: SweepResult) -> str:
    """The rows as CSV."""
    rows = as_json(found.rows)
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return buffer.getvalue()
