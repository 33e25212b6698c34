"""The command `template`, and schemas as `show --schema` prints them."""

import json
import pathlib
from collections.abc import Mapping

from study.case import json_schema
from study.case.patient_table import patients_template
from study.case.template import (
    EXAMPLE_FILE,
    RECORD_FILE,
    case_template,
    example_traces,
    record_template,
)
from study.cli.command_output import Answer
from study.cli.request import Request, ShowOptions, TemplateOptions
from study.report import documents
from study.store.output import OutputRefused, check_folder, write_files

CASE_FILE, PATIENTS_FILE = "case.toml", "patients.csv"


def template_command(request: Request[TemplateOptions]) -> Answer:
    """Print a template, or write it with its schema beside it, which editors check it against."""
    if request.options.csv:
        return _table(request)
    kind = "record" if request.options.record else "case"
    schema, name = json_schema.schema_text(kind), f"{kind}.schema.json"
    files = {CASE_FILE: case_template()}
    if request.options.record:
        files = {EXAMPLE_FILE: example_traces(), RECORD_FILE: record_template()}
    if request.options.schema:
        files = {name: schema}
    elif request.out is not None:
        main = list(files)[-1]
        files = {name: schema, **files, main: f"#:schema ./{name}\n{files[main]}"}
    text, written = list(files.values())[-1], _new_files(request.out, files)
    document = {"template": text, "files": [str(path) for path in written]}
    return Answer(document, written, text="" if written else text)


def _table(request: Request[TemplateOptions]) -> Answer:
    """Print a table of patients, or write it."""
    if request.options.schema:
        raise OutputRefused("--schema is of a case file or a record. Leave --csv or --schema out.")
    text = patients_template()
    written = _new_files(request.out, {PATIENTS_FILE: text})
    document = {"template": text, "files": [str(path) for path in written]}
    return Answer(document, written, text="" if written else text)


def schema_command(request: Request[ShowOptions]) -> Answer:
    """Print the JSON Schema of a kind of result, of a case file or of a record."""
    kind = request.options.schema
    assert kind is not None, "else a result is shown"
    inputs = kind in json_schema.KINDS
    text = json_schema.schema_text(kind) if inputs else documents.schema_text(kind)
    written = _new_files(request.out, {f"{kind}.schema.json": text})
    return Answer(json.loads(text), written, text="" if written else text)


def _new_files(out: pathlib.Path | None, files: Mapping[str, str]) -> list[pathlib.Path]:
    """Write texts into a folder, if one is given; a file that is there already is refused."""
    if out is None:
        return []
    folder = check_folder(out)
    for name in files:
        if (folder / name).exists():
            raise OutputRefused(f"{folder / name}: exists already. Name another --out.")
    return write_files(folder, files)
