"""The site builds without a warning, loads nothing from elsewhere, and no link within it is dead.

The gallery is not run here: `tests/test_examples.py` runs its programs, `make docs` all of it.
"""

import html.parser
import importlib
import pathlib
import subprocess
import sys
import urllib.parse

import pytest

pytest.importorskip("sphinx", reason="the extra docs is not installed")
pytest.importorskip("furo", reason="the extra docs is not installed")

ROOT = pathlib.Path(__file__).parents[1]
_LOADED = {"script": "src", "img": "src", "link": "href", "iframe": "src"}
_NOT_LOADED = ("search", "canonical", "next", "prev", "index")


class Page(html.parser.HTMLParser):
    """Links, anchors and loaded files of a page."""

    def __init__(self, path):
        super().__init__()
        self.links, self.ids, self.loaded = set(), set(), set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        """Gather what a tag names."""
        given = {name: value or "" for name, value in attrs}
        self.ids |= {given[name] for name in ("id", "name") if name in given}
        if tag == "a" and "href" in given:
            self.links.add(given["href"])
        if tag in _LOADED and _LOADED[tag] in given and given.get("rel") not in _NOT_LOADED:
            self.loaded.add(given[_LOADED[tag]])


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Folder of the pages."""
    out = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-n", "-W", "--keep-going", "-q", "-b", "html"]
    # Objects in the table of contents of each page take a third of the time and add no link.
    command += ["-D", "plot_gallery=0", "-D", "toc_object_entries=0"]
    command += ["-D", "smartquotes=0"]  # which add no link either
    command += ["-d", str(out / "doctrees"), "docs", str(out / "html")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-4000:]
    return out / "html"


def _pages(site):
    return {path: Page(path) for path in sorted(site.rglob("*.html"))}


def test_links_within_the_site_lead_somewhere_and_nothing_is_loaded_from_elsewhere(site):
    pages, dead = _pages(site), []
    for path, page in pages.items():
        for link in sorted(page.links | page.loaded):
            parts = urllib.parse.urlsplit(link)
            if parts.scheme or parts.netloc:
                assert link not in page.loaded or parts.scheme == "data", (path, link)
                continue
            target = path if not parts.path else (path.parent / urllib.parse.unquote(parts.path))
            target = target.resolve()
            anchor = urllib.parse.unquote(parts.fragment)
            known = not anchor or target not in pages or anchor in pages[target].ids
            if not target.exists() or not known:
                dead.append(f"{path.relative_to(site)}: {link}")
    assert dead == []


def test_every_public_name_has_an_entry(site):
    from sphinx.util.inventory import InventoryFile

    with (site / "objects.inv").open("rb") as stream:
        found = InventoryFile.load(stream, "", lambda _, name: name)
    known = {name for kind, names in found.items() if kind.startswith("py:") for name in names}
    missing = []
    for page in sorted((ROOT / "docs/reference/api").glob("[!i]*.md")):
        package = importlib.import_module(page.stem)
        missing += [f"{page.stem}.{n}" for n in package.__all__ if f"{page.stem}.{n}" not in known]
    assert missing == []
