"""Packages whose public names are imported on first use.

An ``__init__`` lists its names as imports below ``if TYPE_CHECKING:`` and hands over to
`import_on_first_use`, which reads them there. A command that refuses its input then imports
neither JAX nor the libraries for drawing and meshing.
"""

import ast
import importlib
import pathlib
import sys
import types
from typing import Any


class LazyPackage(types.ModuleType):
    """A package that imports each public name from its module on first access."""

    public_names: dict[str, tuple[str, str]]
    """Module and name there of each public name."""

    def __getattr__(self, name: str) -> Any:
        """Import a public name on first access."""
        if name.startswith("__") or name not in self.public_names:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        module, own = self.public_names[name]
        value = getattr(importlib.import_module(module), own)
        types.ModuleType.__setattr__(self, name, value)
        return value

    def __setattr__(self, name: str, value: Any) -> None:
        """Keep modules from taking a public name: `lumped.march` is the function.

        The import system binds each module to its package under the module's own name.
        """
        if name not in self.public_names or not isinstance(value, types.ModuleType):
            types.ModuleType.__setattr__(self, name, value)

    def __dir__(self) -> list[str]:
        """All public names, imported or not."""
        return sorted({*vars(self), *self.public_names})


def import_on_first_use(package: str) -> None:
    """Give a package its public names, each imported on first use.

    Args:
        package: name of the package; its ``__init__`` lists them below ``if TYPE_CHECKING:``.
    """
    module = sys.modules[package]
    assert module.__file__ is not None
    tree = ast.parse(pathlib.Path(module.__file__).read_text(encoding="utf-8"))
    imports = [
        part
        for block in tree.body
        if isinstance(block, ast.If) and ast.unparse(block.test) == "TYPE_CHECKING"
        for part in block.body
        if isinstance(part, ast.ImportFrom)
    ]
    names = {
        name.asname or name.name: (f"{part.module}", name.name)
        for part in imports
        for name in part.names
    }
    vars(module)["public_names"] = names
    module.__class__ = LazyPackage
