"""The directive ``{benchmark} NAME``: a table made from `docs/benchmarks/NAME.json`.

Options: ``columns``, those to show with a heading each (``column: heading; column``); ``where``,
rows to show (``column = value``). Below the table stand command, commit, machine and date.
"""

import json
import pathlib
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

STORED = pathlib.Path(__file__).parents[1] / "benchmarks"


class BenchmarkTable(SphinxDirective):
    """Table of a stored result."""

    required_arguments = 1
    option_spec: ClassVar = {
        "columns": directives.unchanged,
        "where": directives.unchanged,
        "notes": directives.flag,
    }

    def run(self) -> list[nodes.Node]:
        """Make the table."""
        path = STORED / f"{self.arguments[0]}.json"
        self.env.note_dependency(str(path))
        document = json.loads(path.read_text(encoding="utf-8"))
        rows = _chosen(document["result"]["rows"], self.options.get("where"))
        if not rows:
            raise self.error(f"{path.name} has no rows where {self.options.get('where')}")
        columns = _columns(rows, self.options.get("columns"))
        missing = [key for key in columns if not any(key in row for row in rows)]
        if missing:
            raise self.error(f"{path.name} has no column {', '.join(missing)}")
        shown = [[_cell(row.get(key, "")) for key in columns] for row in rows]
        found: list[nodes.Node] = [_table(list(columns.values()), shown), _facts(document)]
        notes = document["result"]["notes"]
        if "notes" in self.options and notes:
            items = [nodes.list_item("", nodes.paragraph(text=note)) for note in notes]
            found.append(nodes.bullet_list("", *items))
        return found


def _chosen(rows: list[dict[str, Any]], where: str | None) -> list[dict[str, Any]]:
    for part in (where or "").split(";"):
        if "=" in part:
            key, value = (text.strip() for text in part.split("=", 1))
            rows = [row for row in rows if str(row.get(key, "")) in value.split("|")]
    return rows


def _columns(rows: list[dict[str, Any]], asked: str | None) -> dict[str, str]:
    if asked is None:
        return {key: key.replace("_", " ") for row in rows for key in row}
    parts = [part.partition(":") for part in asked.split(";")]
    return {key.strip(): (heading or key).strip() for key, _, heading in parts}


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _table(headings: list[str], rows: list[list[str]]) -> nodes.Node:
    group = nodes.tgroup(cols=len(headings))
    group += [nodes.colspec(colwidth=1) for _ in headings]
    group += nodes.thead("", _row(headings))
    group += nodes.tbody("", *(_row(row) for row in rows))
    return nodes.table("", group, classes=["benchmark"])


def _row(cells: list[str]) -> nodes.row:
    return nodes.row("", *(nodes.entry("", nodes.paragraph(text=cell)) for cell in cells))


def _facts(document: dict[str, Any]) -> nodes.Node:
    machine = document["machine"]
    seed = f", seed {document['seed']}" if "seed" in document else ""
    load = ", ".join(f"{value:.1f}" for value in machine["load"])
    text = (
        f"{seed}, commit {machine['commit']}, {machine['date'][:10]}, {machine['cpus']} cores"
        f" (load at the start {load}), jax {machine['jax']}"
    )
    line = nodes.paragraph("", "", nodes.literal(text=document["command"]), nodes.Text(text))
    line["classes"].append("provenance")
    return line


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("benchmark", BenchmarkTable)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
