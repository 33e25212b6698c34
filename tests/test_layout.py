"""Sizes of modules and functions, names of classes, and how deep the imports within `study` go."""

import ast
import builtins
import dis
import functools
import pathlib
import symtable
import types

import study

_ROOT = pathlib.Path(study.__file__).parent
_MEASURED = ("lumped", "jaxfsi", "calibration", "diagnosis", "study", "benchmarks", "examples")
MODULE_LINES, FUNCTION_LINES = 400, 60
LONGER = {
    ("jaxfsi/core/laws/fluid.py", "fluid_residual"): 69,  # one weak form between fusion barriers
    ("jaxfsi/core/statics/equilibrium.py", "_equilibrium"): 97,  # closures of one implicit root
}
"""Functions that may be longer, up to so many lines; take out what is not."""
SHARED_NAMES = {"RESULTS", "Note"}
"""Classes of one name with one meaning: result codes (as in equinox), and a remark as computed and
as written."""
LONGEST_CHAIN = 10
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


def only_constants(module: str, path: pathlib.Path) -> set[str]:
    """Modules of other rooms of which a module imports nothing but constants."""
    names: dict[str, list[str]] = {}
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("study."):
            names.setdefault(node.module, []).extend(alias.name for alias in node.names)
    room = module.split(".")[1:2]
    others = {of: found for of, found in names.items() if of.split(".")[1:2] != room}
    return {of for of, found in others.items() if all(name.isupper() for name in found)}


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


def _modules() -> list[pathlib.Path]:
    return [p for name in _MEASURED for p in sorted((_ROOT.parent / name).rglob("*.py"))]


def _function_lines(path: pathlib.Path) -> dict[tuple[str, str], int]:
    """Lines of each function without its docstring, by module and name."""
    where, found = path.relative_to(_ROOT.parent).as_posix(), {}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.end_lineno:
            first, lines = node.body[0], node.end_lineno - node.lineno + 1
            if ast.get_docstring(node, clean=False) is not None and first.end_lineno:
                lines -= first.end_lineno - first.lineno + 1
            found[where, node.name] = max(lines, found.get((where, node.name), 0))
    return found


def test_modules_and_functions_are_short():
    longer = {}
    for path in _modules():
        lines = len(path.read_text(encoding="utf-8").splitlines())
        assert lines <= MODULE_LINES, f"{path} has {lines} lines"
        functions = _function_lines(path)
        longer |= {name: n for name, n in functions.items() if n > FUNCTION_LINES}
    assert longer == LONGER


def test_a_constant_of_another_room_lies_in_a_module_that_imports_nothing_of_study():
    imports = _imports(_ROOT)
    heavy = {
        (module, of)
        for module in imports
        if (path := (_ROOT.parent / module.replace(".", "/")).with_suffix(".py")).is_file()
        for of in only_constants(module, path)
        if imports[of]
    }
    assert not heavy


def test_a_class_name_has_one_meaning():
    where: dict[str, list[str]] = {}
    for path in _modules():
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                where.setdefault(node.name, []).append(path.relative_to(_ROOT.parent).as_posix())
    repeated = {name: paths for name, paths in where.items() if len(paths) > 1}
    assert repeated.keys() <= SHARED_NAMES, repeated


def _undefined(path: pathlib.Path) -> set[str]:
    """Global names that a module reads and nowhere defines; strings of shapes are no names."""
    text = path.read_text(encoding="utf-8")
    code = compile(text, str(path), "exec", dont_inherit=True)
    table = symtable.symtable(text, str(path), "exec")
    known = {s.get_name() for s in table.get_symbols() if s.is_assigned() or s.is_imported()}
    known |= set(dir(builtins)) | {"__file__", "__name__", "__doc__", "__path__"}
    known |= {name for scope in _scopes(table) for name in _declared_global(scope)}
    return {name for name in _read_globals(code) if name not in known}


def _scopes(table):
    yield table
    for child in table.get_children():
        yield from _scopes(child)


def _declared_global(table) -> set[str]:
    return {s.get_name() for s in table.get_symbols() if s.is_declared_global()}


def _read_globals(code) -> set[str]:
    steps = list(dis.get_instructions(code))
    found = {step.argval for step in steps if step.opname in ("LOAD_GLOBAL", "LOAD_NAME")}
    assigned = {step.argval for step in steps if step.opname == "STORE_NAME"}
    inner = (part for part in code.co_consts if isinstance(part, types.CodeType))
    return (found - assigned).union(*(_read_globals(part) for part in inner))


def test_no_module_reads_a_name_that_nothing_defines():
    own = {"__module__", "__qualname__", "__annotations__"}  # of a class body
    faults = {str(path): names for path in _modules() if (names := _undefined(path) - own)}
    assert not faults
