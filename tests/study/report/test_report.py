"""The report and the text summary of the demo patient."""

import html.parser
import json
import re

import pytest

from study.report.page import html_report
from study.report.summary import summary
from study.store.stored_document import load_document


@pytest.fixture(scope="module")
def page(demo):
    assert demo.status == 0, demo.stderr
    return (demo.folder / "report.html").read_text(encoding="utf-8")


def test_report_stands_alone(page):
    outside = re.findall(r"(?:src|href)\s*=\s*[\"']([^\"'#][^\"']*)|url\(([^#)][^)]*)\)", page)
    assert outside == []
    assert "<script" not in page
    assert "@import" not in page


def test_report_has_its_figures_and_parts(page):
    assert page.count("<svg") == 5
    for part in (
        "Predicted FFR", "Is it plausible?", "Waveforms", "Lumen and its resistance",
        "What moves FFR", "What the measurement determines", "How the paper was read",
        "Provenance", "not a medical device",
    ):  # fmt: skip
        assert part in page


def test_verdict_comes_first(page):
    body = page[page.index("<main>") :]
    assert body.index("Predicted FFR") < body.index("<table>")


class Balance(html.parser.HTMLParser):
    """Counts open tags that are never closed."""

    def __init__(self):
        html.parser.HTMLParser.__init__(self)
        self.open = []

    def handle_starttag(self, tag, attrs):
        if tag not in ("meta", "br", "link"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_report_is_well_formed(page):
    parser = Balance()
    parser.feed(page)
    assert parser.open == []


def test_clip_paths_of_different_figures_do_not_share_names(page):
    names = re.findall(r"<clipPath id=\"([^\"]+)\"", page)
    assert len(names) == len(set(names)) > 5


def test_report_can_be_made_again_from_the_stored_result(demo, page):
    assert html_report(load_document(demo.folder)) == page


def test_text_from_the_case_is_escaped(demo):
    document = load_document(demo.folder)
    document["sources"] = {"patient": "<script>alert(1)</script>"}
    assert "<script>" not in html_report(document)


def test_summary_names_every_condition_and_alpha(demo):
    text = summary(load_document(demo.folder))
    for word in ("rest", "dobutamine", "adenosine", "printed", "all", "alpha = 0.27"):
        assert word in text


def test_report_without_anatomy_and_stress(demo):
    document = json.loads(json.dumps(load_document(demo.folder)))
    document["vessel"] = None
    document["conditions"] = {"rest": document["conditions"]["rest"]}
    for part in ("runs", "waveforms", "sensitivities"):
        document[part] = [e for e in document[part] if e["condition"] == "rest"]
    page = html_report(document)
    assert page.count("<svg") == 3
    assert "Lumen and its resistance" not in page
