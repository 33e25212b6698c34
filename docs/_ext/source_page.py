"""The role ``{src}`lumped/blocks.py```: a link to a page with the source of a file.

A file that is not there is a warning, and so ends the build.
"""

import pathlib
import posixpath

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.docutils import SphinxRole

ROOT = pathlib.Path(__file__).parents[2]
_LOG = logging.getLogger(__name__)


class SourceRole(SphinxRole):
    """Link to the page of a file of the repository, or the name of a folder as code."""

    def run(self) -> tuple[list[nodes.Node], list[nodes.system_message]]:
        """Make the node."""
        path = ROOT / self.text
        literal = nodes.literal(text=self.text)
        if not path.exists():
            _LOG.warning("no file %s", self.text, location=(self.env.docname, self.lineno))
        if path.suffix != ".py":
            return [literal], []
        sources = getattr(self.env, "source_pages", set()) | {self.text}
        self.env.source_pages = sources
        folder = posixpath.dirname(self.env.docname) or "."
        page = posixpath.relpath(f"code/{self.text}.html", folder)
        return [nodes.reference("", "", literal, refuri=page, internal=True)], []


def _pages(app: Sphinx):
    for name in sorted(getattr(app.env, "source_pages", set())):
        text = (ROOT / name).read_text(encoding="utf-8")
        body = app.builder.highlighter.highlight_block(text, "python", linenos="inline")
        yield f"code/{name}", {"title": name, "body": f"<h1>{name}</h1>{body}"}, "page.html"


def _merge(app: Sphinx, env, docnames, other) -> None:
    env.source_pages = getattr(env, "source_pages", set()) | getattr(other, "source_pages", set())


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the role and its pages."""
    app.add_role("src", SourceRole())
    app.connect("html-collect-pages", _pages)
    app.connect("env-merge-info", _merge)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
