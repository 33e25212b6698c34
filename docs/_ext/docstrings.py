"""Docstrings of the code as reStructuredText: drawings, equations, bars and stars as they stand.

A paragraph with characters of drawings, and an indented block below a line that ends in a colon,
are shown letter by letter. ``|Q|`` is no substitution, and ``*batch`` opens no emphasis.
"""

import importlib
import re

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

_DRAWN = re.compile("[─│┬┴┤├┼⏚┐┌└┘]")
_CODE = re.compile(r"(``.*?``|`[^`]*`)")
_TABLE = re.compile(r"^\s*\|.*\|\s*$")


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip())


def _paragraphs(lines: list[str]) -> list[list[str]]:
    found: list[list[str]] = [[]]
    for line in lines:
        if line.strip():
            found[-1].append(line)
        else:
            found.append([])
    return [part for part in found if part]


def _literal(lines: list[str]) -> list[str]:
    least = min(_indent(line) for line in lines)
    return ["::", "", *(f"    {line[least:]}" for line in lines)]


def _drawing(part: list[str]) -> list[str]:
    """A paragraph that draws: its first words stay text, so that the rest keeps its columns."""
    head, colon, rest = part[0].partition(": ")
    if not colon:
        return _literal(part)
    return [f"{head}:", "", *_literal([" " * (len(head) + 2) + rest, *part[1:]])]


def _grid(part: list[str]) -> list[str]:
    """A table in Markdown as a list table."""
    rows = [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in part]
    made = [".. list-table::", "   :header-rows: 1", ""]
    for row in (rows[0], *rows[2:]):
        made += [f"   {'*' if k == 0 else ' '} - {cell}" for k, cell in enumerate(row)]
    return made


def prepare(app: Sphinx, what: str, name: str, obj: object, options, lines: list[str]) -> None:
    """Mark what is to be shown letter by letter; before Napoleon reads the sections."""
    if what in ("attribute", "property", "data") and lines:
        lines[0] = lines[0].replace(": ", " – ", 1)  # words before a colon would be its type
    made: list[str] = []
    parts, inside = _paragraphs(lines), False
    for part in parts:
        inside = inside and _indent(part[0]) > 0
        if inside:
            made += [*part, ""]
        elif any(_DRAWN.search(line) for line in part):
            made += [*_drawing(part), ""]
        elif all(_TABLE.match(line) for line in part):
            made += [*_grid(part), ""]
        else:
            made += [*part, ""]
            inside = made[-2].endswith("::")
    for k, line in enumerate(made[:-2]):
        below = made[k + 2]
        if line.endswith(":") and not line.endswith("::") and not made[k + 1]:
            made[k] += ":" if _indent(below) > _indent(line) else ""
    lines[:] = made


def escape(app: Sphinx, what: str, name: str, obj: object, options, lines: list[str]) -> None:
    """Escape bars and stars outside code and literal blocks; after Napoleon."""
    literal_below: int | None = None
    for k, line in enumerate(lines):
        if literal_below is not None and line.strip():
            if _indent(line) > literal_below:
                continue
            literal_below = None
        if line.rstrip().endswith("::") and not line.strip().startswith(".. "):
            literal_below = _indent(line)
        if line.strip().startswith("* -"):
            continue
        parts = _CODE.split(line)
        parts[::2] = [re.sub(r"(?<!\\)\|", r"\\|", part) for part in parts[::2]]
        if ":vartype" in line or ":type" in line:
            parts[::2] = [re.sub(r"(?<![\\*])\*(?=\w)", r"\\*", part) for part in parts[::2]]
        lines[k] = "".join(parts)


_NAMES = {"~jaxlib._jax.Array": "Array", "jaxlib._jax.Array": "Array", "~numpy.ndarray": "ndarray"}


def shorten(
    app: Sphinx,
    what: str,
    name: str,
    obj: object,
    options: object,
    signature: str | None,
    returned: str | None,
) -> tuple[str | None, str | None] | None:
    """Arrays by their usual names."""
    if signature is None and returned is None:
        return None
    for long, short in _NAMES.items():
        signature = signature and signature.replace(long, short)
        returned = returned and returned.replace(long, short)
    return signature, returned


PACKAGES = (
    "lumped", "jaxfsi", "jaxfsi.anatomy", "jaxfsi.meshing", "jaxfsi.mesh_files", "jaxfsi.core",
    "jaxfsi.simulation", "jaxfsi.fields", "calibration", "diagnosis", "study",
)  # fmt: skip
"""Packages whose public names have pages."""


def _public() -> dict[str, str]:
    """Public name by the place where an object is defined, which annotations name."""
    found: dict[str, str] = {}
    for package in PACKAGES:
        for name, (module, own) in importlib.import_module(package).public_names.items():
            found.setdefault(f"{module}.{own}", f"{package}.{name}")
    return found


def resolve(
    app: Sphinx, env: BuildEnvironment, node: pending_xref, inner: nodes.Element
) -> nodes.Element | None:
    """Link a name of the place of its definition to the page of its public name."""
    if node.get("refdomain") != "py":
        return None
    target = _PUBLIC.get(str(node["reftarget"]))
    if target is None:
        return None
    domain = env.domains["py"]
    return domain.resolve_xref(env, node["refdoc"], app.builder, "obj", target, node, inner)


_PUBLIC = _public()


def setup(app: Sphinx) -> dict[str, bool]:
    """Hook in before and after Napoleon."""
    app.connect("autodoc-process-docstring", prepare, priority=400)
    app.connect("autodoc-process-docstring", escape, priority=900)
    app.connect("autodoc-process-signature", shorten)
    app.connect("missing-reference", resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
