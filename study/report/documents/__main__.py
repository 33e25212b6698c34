"""Writes the JSON Schemas of all documents: `python -m study.report.documents`."""

from study.report.documents import KINDS, schema_path, schema_text

for kind in KINDS:
    schema_path(kind).write_text(schema_text(kind), encoding="utf-8")
