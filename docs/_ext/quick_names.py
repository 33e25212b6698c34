"""Names that no object of the site ends in are not searched for: most words in backticks.

Sphinx holds each name that it does not know against the ends of all that it knows.
"""

from sphinx.application import Sphinx
from sphinx.domains.python import PythonDomain


class QuickPythonDomain(PythonDomain):
    """Python names, found as Sphinx finds them, or at once where there are none."""

    _count = -1
    _ends: frozenset[str] = frozenset()

    def find_obj(self, env, modname, classname, name, typ, searchmode=0):
        """Objects of a name; see `PythonDomain.find_obj`."""
        if self._count != len(self.objects):
            self._count = len(self.objects)
            self._ends = frozenset(full.rpartition(".")[2] for full in self.objects)
        if name.removesuffix("()").rpartition(".")[2] not in self._ends:
            return []
        return super().find_obj(env, modname, classname, name, typ, searchmode)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the domain."""
    app.add_domain(QuickPythonDomain, override=True)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
