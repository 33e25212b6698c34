"""The directive ``{public-data} PACKAGE``: public names that are neither classes nor functions.

Constants and aliases of types carry their words in the module that defines them, below or above
their value; `autodoc` looks for them in the package alone.
"""

import importlib
import inspect
from typing import ClassVar

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer
from sphinx.util.docutils import SphinxDirective

_LONGEST = 60
"""Characters of a value that is shown."""


class PublicData(SphinxDirective):
    """Entries of one package."""

    required_arguments = 1
    option_spec: ClassVar = {}

    def run(self) -> list[nodes.Node]:
        """Make the entries."""
        package = importlib.import_module(self.arguments[0])
        lines: list[str] = []
        for name in package.__all__:
            value = getattr(package, name)
            if inspect.isclass(value) or inspect.isroutine(value) or hasattr(value, "__wrapped__"):
                continue
            lines += _entry(self.arguments[0], name, value, *package.public_names[name])
        if not lines:
            return []
        holder = nodes.section(ids=["data"])
        holder += nodes.rubric(text="Constants and aliases")
        self.state.nested_parse(StringList(lines, source=self.arguments[0]), 0, holder)
        return holder.children


def _entry(package: str, name: str, value: object, module: str, own: str) -> list[str]:
    analyzer = ModuleAnalyzer.for_module(module)
    words = analyzer.find_attr_docs().get(("", own), [])
    made = [f".. py:data:: {name}", f"   :module: {package}"]
    text = " ".join(repr(value).split())
    if len(text) <= _LONGEST:
        made.append(f"   :value: {text}")
    return [*made, "", *(f"   {line}" for line in words), ""]


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("public-data", PublicData)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
