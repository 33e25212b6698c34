"""How deep the imports within `study` go."""

import ast
import functools
import pathlib

import study

_ROOT = pathlib.Path(study.__file__).parent
LONGEST_CHAIN = 14
"""Modules of the longest chain of imports; lower it when the chain gets shorter."""


def _imports(package: pathlib.Path) -> dict[str, set[str]]:
    """For each module of a package, those of it that are imported at its top level."""
    root = package.parent
    paths = {
        ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__"): path
        for path in package.rglob("*.py")
    }
    found: dict[str, set[str]] = {}
    for module, path in paths.items():
        body = ast.parse(path.read_text(encoding="utf-8")).body
        parts = [
            (n.module, name.name) for n in body if isinstance(n, ast.ImportFrom) for name in n.names
        ]
        parts += [(n.name, "") for node in body if isinstance(node, ast.Import) for n in node.names]
        named = (f"{of}.{name}" if f"{of}.{name}" in paths else of for of, name in parts)
        found[module] = {str(name) for name in named if name in paths and name != module}
    return found


def longest_chain(imports: dict[str, set[str]]) -> list[str]:
    """Longest chain of modules, each of which imports the next."""

    @functools.cache
    def below(module: str) -> tuple[str, ...]:
        return (module, *max(map(below, sorted(imports[module])), key=len, default=()))

    return list(max(map(below, sorted(imports)), key=len))


def test_longest_chain_of_a_diamond():
    assert longest_chain({"a": {"b", "d"}, "b": {"c"}, "c": {"d"}, "d": set()}) == list("abcd")


def test_imports_within_study_stay_shallow():
    chain = longest_chain(_imports(_ROOT))
    assert len(chain) <= LONGEST_CHAIN, " -> ".join(chain)
