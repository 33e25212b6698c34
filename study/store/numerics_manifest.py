"""Numerical content of modules, and the manifest that holds what was decided about it.

The content of a module is its syntax tree without what moves no number: comments, formatting,
docstrings, annotations, imports for them, and the words of a `raise`. The manifest,
``numerics.json``, holds a digest of the content of every module that decides kept numbers, and a
version of every part of the numerics (`study.store.numerics`). A version is a count and the
digest of its part when it was raised: two branches that raise it do not raise it to the same.
"""

import ast
import hashlib
import json
import pathlib
import re
from collections.abc import Mapping
from typing import Any, NamedTuple

ROOT = pathlib.Path(__file__).resolve().parents[2]
"""Folder of the packages."""

MANIFEST = pathlib.Path(__file__).with_name("numerics.json")

_LINE = re.compile(r'\s*"([^"]+)": "([^"]*)",?\s*')
_SHORT, _STAMP = 20, 8
_LEFT_OUT = frozenset(
    ("annotation", "returns", "ctx", "type_comment", "type_params", "type_ignores", "kind")
)
_OF_ANNOTATIONS = frozenset(("__future__", "typing", "collections.abc", "jaxtyping", "types"))


class Manifest(NamedTuple):
    """What was decided; None where a merge left more than one value.

    Attributes:
        versions: of the parts, by name.
        modules: digest of the content of each module, by path.
    """

    versions: dict[str, str | None]
    modules: dict[str, str | None]


def content_digest(source: bytes) -> str:
    """Digest of the numerical content of a module; of its bytes where it is no Python."""
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError):
        return hashlib.sha256(source).hexdigest()[:_SHORT]
    imports: list[str] = []
    body = [node for node in tree.body if not _imported(node, imports)]
    out: list[str] = sorted(imports)
    _walk(body, out, silent=False)
    return hashlib.sha256("\x1f".join(out).encode()).hexdigest()[:_SHORT]


def _imported(node: ast.stmt, found: list[str]) -> bool:
    """Whether a statement is an import; what it brings, in a form that knows no order."""
    match node:
        case ast.ImportFrom(module=module, names=names, level=level):
            if module not in _OF_ANNOTATIONS:
                found += [f"from {level} {module} {a.name} {a.asname}" for a in names]
        case ast.Import(names=names):
            found += [f"import {a.name} {a.asname}" for a in names if a.name not in _OF_ANNOTATIONS]
        case ast.If(test=ast.Name(id="TYPE_CHECKING")):
            pass
        case _:
            return False
    return True


def _walk(node: Any, out: list[str], *, silent: bool) -> None:
    """Write a tree down; words count only where they are not silent."""
    if isinstance(node, ast.Constant):
        words = isinstance(node.value, str)
        out.append("words" if words and silent else repr(node.value))
    elif isinstance(node, ast.AST):
        out.append(type(node).__name__)
        silent = silent or isinstance(node, ast.Raise)
        for name, value in ast.iter_fields(node):
            if name not in _LEFT_OUT and value is not None and value != []:
                out.append(name)
                _walk(value, out, silent=silent)
    elif isinstance(node, list):
        out.append("[")
        for entry in node:
            if not _is_text(entry):
                _walk(entry, out, silent=silent)
        out.append("]")
    else:
        out.append(repr(node))


def _is_text(node: Any) -> bool:
    """Whether a statement is a docstring, of whatever stands before it."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def read_manifest(path: pathlib.Path = MANIFEST) -> Manifest:
    """The manifest; one with marks of a merge is read as far as it is decided."""
    found = Manifest({}, {})
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError:
        return found
    for line in lines:
        entry = _LINE.fullmatch(line)
        if entry is None:
            continue
        name, value = entry.groups()
        table = found.modules if name.endswith(".py") else found.versions
        table[name] = value if table.get(name, value) == value else None
    return found


def write_manifest(manifest: Manifest, path: pathlib.Path = MANIFEST) -> None:
    """Write a manifest: a line an entry and an empty one between, so that git merges them."""
    tables = []
    for title, table in manifest._asdict().items():
        lines = [f"{json.dumps(k)}: {json.dumps(v)}" for k, v in sorted(table.items())]
        tables.append(f"{json.dumps(title)}: {{\n\n" + ",\n\n".join(lines) + "\n\n}")
    path.write_text("{\n" + ",\n".join(tables) + "\n}\n", encoding="utf-8")


def joint_digest(digests: Mapping[str, str]) -> str:
    """Digest of some modules together."""
    text = "\n".join(f"{name} {digest}" for name, digest in sorted(digests.items()))
    return hashlib.sha256(text.encode()).hexdigest()[:_SHORT]


def raised(path: pathlib.Path, part: str, digests: Mapping[str, str]) -> str:
    """The version of a part after a change.

    Args:
        path: the manifest; all versions that a merge left there count.
        part: its name.
        digests: of the content of its modules.
    """
    counts = [0]
    text = path.read_text(encoding="utf-8") if path.is_file() else ""
    for line in text.splitlines():
        entry = _LINE.fullmatch(line)
        if entry is not None and entry[1] == part:
            counts.append(int(entry[2].split("-")[0]))
    return f"{max(counts) + 1}-{joint_digest(digests)[:_STAMP]}"
