"""The page of a vessel in a browser: drawn, moved, clicked, switched."""

import json

import numpy as np
import pytest

from study.report.packed_array import unpacked

_NO_WEBGL = """<script>
const known = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
  return kind.startsWith("webgl") ? null : known.call(this, kind, ...more);
};
</script>"""


def _display(selector):
    return f"getComputedStyle(document.querySelector('{selector}')).display"


@pytest.fixture(scope="module")
def found(browser, page_file):
    """What the page says of itself: canvas, motion, clicks, readings of every view."""
    browser.open(f"{page_file.as_uri()}#selftest")
    text = browser.waited("document.getElementById('selftest')?.textContent")
    found = json.loads(text)
    assert "error" not in found, found["error"]
    return found


def test_canvas_is_drawn_in_every_colouring(found):
    assert [entry["name"] for entry in found["colours"]] == ["ratio", "pressure", "moved", "wider"]
    for entry in found["colours"]:
        assert entry["share"] > 0.02
        assert entry["colours"] > 20


def test_the_scale_of_a_wider_lumen_is_in_thousandths_and_ends_at_the_artery(found, vessel):
    shape, view = vessel.data.shapes[0], vessel.data.views[-1]
    # 1 per mm shifted and mm² is 100 thousandths per mm² that is shifted by 0.1 mm
    known = 100.0 * unpacked(view.wider_per_mm3)
    (wider,) = [entry for entry in found["colours"] if entry["name"] == "wider"]
    artery = unpacked(shape.node_s_mm) >= 0.0
    assert wider["high"] == -wider["low"] == pytest.approx(np.abs(known[artery]).max(), rel=1e-6)
    assert "0.001 per mm²" in wider["legend"]
    assert "0.1 mm" in wider["legend"]
    for pick in found["views"][-1]["picks"]:
        assert pick["wider"] == pytest.approx(known[pick["node"]], rel=0.05)
        assert pick["shownWider"].startswith("+")
        assert float(pick["shownWider"].split()[0]) == pytest.approx(pick["wider"], rel=0.051)
    assert found["views"][0]["picks"][0]["shownWider"] == "–"


def test_the_slider_moves_the_wall_and_exaggeration_multiplies_it(found, vessel):
    view = vessel.data.views[-1]
    moved = unpacked(view.moved_mm)
    place = np.interp(0.35 * view.t_s[-1], view.t_s, np.arange(len(view.t_s)))
    low, share = int(place), place % 1.0
    at = (1.0 - share) * moved[low] + share * moved[low + 1] - moved[-1]
    # float32 positions on the card
    assert found["shift"] == pytest.approx(np.abs(at).max(), abs=1e-4)
    assert found["exaggerated"] == pytest.approx(10.0 * np.abs(at).max(), abs=1e-3)


def test_distal_outlet_shows_the_number_of_the_result(found, vessel):
    for entry, run in zip(found["views"], vessel.runs, strict=True):
        assert entry["id"] == run.id
        assert entry["distal"] == pytest.approx(run.ratio, rel=1e-14)
        assert f"{run.ratio:.3f}" in entry["shown"]


def test_a_click_reads_the_ratio_of_the_node_it_hits(found, vessel):
    for entry, view in zip(found["views"], vessel.data.views, strict=True):
        ratio = unpacked(view.node_ratio)
        assert len(entry["picks"]) > 50
        spread = ratio.max() - ratio.min()
        for pick in entry["picks"]:
            # the click lies within 2 % of the node's weight
            assert pick["ratio"] == pytest.approx(ratio[pick["node"]], abs=0.02 * spread)
            assert pick["text"] == f"{pick['ratio']:.3f}"


def test_a_place_of_the_slider_reads_its_section(found, vessel):
    course = vessel.data.views[-1].sections
    for entry in found["along"]:
        assert entry["ratio"] == course.ratio[entry["k"]]


def test_without_graphics_the_picture_and_the_curves_remain(browser, page_file):
    text = page_file.read_text(encoding="utf-8")
    broken = page_file.with_name("no-webgl.html")
    begin = '<script type="application/json" id="vessel-colours">'
    assert begin in text
    broken.write_text(text.replace(begin, _NO_WEBGL + begin), encoding="utf-8")
    browser.open(broken.as_uri())
    browser.waited("document.body?.classList.contains('flat') || null")
    assert browser.value(_display("section.still")) == "block"
    assert browser.value(_display(".frame")) == "none"
    assert browser.value("document.querySelectorAll('#pullback path').length") > 2
    browser.value("document.getElementById('along').value = 0")
    browser.value("document.getElementById('along').dispatchEvent(new Event('input'))")
    assert browser.value("document.getElementById('at-where').textContent").startswith("0.")


def test_paper_shows_the_picture_in_place_of_the_controls(browser, page_file):
    browser.open(page_file.as_uri())
    browser.waited("document.body?.classList.contains('live') || null")
    browser.waited("document.body?.classList.contains('live') || null")
    controls, picture = _display("section.live-only"), _display("section.still")
    assert (browser.value(controls), browser.value(picture)) == ("block", "none")
    browser.call("Emulation.setEmulatedMedia", media="print")
    assert (browser.value(controls), browser.value(picture)) == ("none", "block")


def test_a_page_without_axis_motion_or_whole_cycle_says_so(browser, bare_page):
    browser.open(f"{bare_page.as_uri()}#selftest")
    found = json.loads(browser.waited("document.getElementById('selftest')?.textContent"))
    assert "error" not in found, found["error"]
    assert [entry["name"] for entry in found["colours"]] == ["ratio", "pressure"]
    assert found["shift"] == 0.0
    assert "no whole cycle" in found["views"][0]["shown"]
    assert browser.value(_display("#pullback-panel")) == "none"
    assert browser.value(_display("#rigid-note")) == "block"
