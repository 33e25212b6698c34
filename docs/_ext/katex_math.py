"""Mathematics rendered by the copy of KaTeX in `_static/katex`; no server is asked."""

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.math import get_node_equation_number

_START = """
document.addEventListener("DOMContentLoaded", () => {
  for (const node of document.querySelectorAll(".math")) {
    const options = {displayMode: node.tagName === "DIV", throwOnError: false};
    katex.render(node.textContent, node, options);
  }
});
"""


def _inline(writer, node: nodes.math) -> None:
    writer.body.append(f'<span class="math notranslate">{writer.encode(node.astext())}</span>')
    raise nodes.SkipNode


def _display(writer, node: nodes.math_block) -> None:
    label = node.get("label")
    if label:
        number = get_node_equation_number(writer, node)
        writer.body.append(f'<span class="eqno" id="{node["ids"][0]}">({number})</span>')
    text = node.astext().strip()
    if "\\\\" in text and "\\begin" not in text:
        text = f"\\begin{{aligned}}{text}\\end{{aligned}}"
    writer.body.append(f'<div class="math notranslate">{writer.encode(text)}</div>\n')
    raise nodes.SkipNode


def _files(app: Sphinx, page, template, context, doctree) -> None:
    if doctree is None or not any(doctree.findall(_is_math)):
        return
    app.add_css_file("katex/katex.min.css")
    app.add_js_file("katex/katex.min.js")
    app.add_js_file(None, body=_START)


def _is_math(node: nodes.Node) -> bool:
    return isinstance(node, nodes.math | nodes.math_block)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer."""
    app.add_html_math_renderer(
        "katex", inline_renderers=(_inline, None), block_renderers=(_display, None)
    )
    app.config.html_math_renderer = "katex"
    app.connect("html-page-context", _files)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
