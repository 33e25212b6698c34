"""The data of the page of a vessel against an independent computation, and the page itself."""

import base64
import dataclasses
import hashlib
import importlib.resources
import io
import json
import re

import numpy as np
import pytest
from PIL import Image

from study.case.faults import CaseError
from study.report.packed_array import unpacked
from study.report.stored_vessel import stored_vessel, vessel_beside
from study.report.study_vessel import vessel_files
from study.report.vessel_colours import low_end, ratio_colours
from study.report.vessel_data import joined
from study.report.vessel_page import vessel_page

LENGTH, P_INLET, DROP, PULSE, PERIOD = 2.0, 100.0, 25.0, 12.0, 0.8


def test_ratio_along_the_vessel_is_that_of_its_pressures(vessel):
    view, run = vessel.data.views[-1], vessel.runs[-1]
    assert view.ratio == run.ratio
    s = np.array(vessel.data.shapes[0].sections.s_mm) / 10.0
    mean_inlet, mean_outlet = (run.cycle.ports[n].mean_P_mmHg for n in ("inlet", "outlet"))
    fall = (s / LENGTH) ** 2 * (mean_inlet - mean_outlet)
    # linear between nodes 2/30 cm apart, and rounded
    error = (mean_inlet - mean_outlet) / 30.0**2 / 4.0 / mean_inlet + 1e-6
    assert np.abs(np.array(view.sections.ratio) - (mean_inlet - fall) / mean_inlet).max() < error
    z = unpacked(vessel.data.shapes[0].points_mm)[:, 2] / 10.0
    nodes = unpacked(view.node_ratio)
    exact = (mean_inlet - (z / LENGTH) ** 2 * (mean_inlet - mean_outlet)) / mean_inlet
    # half of 1e-6, and places rounded to 0.002 mm
    assert np.abs(nodes - exact).max() < 0.5e-6 + 0.0002 * DROP / LENGTH / P_INLET
    assert view.least_ratio == pytest.approx(nodes.min(), abs=1e-6)


def test_pressure_and_motion_are_within_half_a_quantum(vessel):
    view = vessel.data.views[-1]
    t = np.array(view.t_s)
    z = unpacked(vessel.data.shapes[0].points_mm)[:, 2] / 10.0
    wave = PULSE * np.sin(2.0 * np.pi * t / PERIOD)
    exact = P_INLET - DROP * (z[None] / LENGTH) ** 2 + wave[:, None]
    assert np.abs(unpacked(view.node_P_mmHg) - exact).max() < 0.0101 + 0.0002 * DROP / LENGTH
    moved = np.linalg.norm(unpacked(view.moved_mm), axis=2)
    bulge = 0.1 * np.sin(np.pi * t / PERIOD) ** 2
    assert np.abs(moved - 2.0 * bulge[:, None]).max() < 0.0005 * np.sqrt(3.0) + 1e-6
    area = unpacked(view.sections.area_mm2)
    polygon = 12.0 * 2.0**2 * np.sin(2.0 * np.pi / 24.0)
    assert area == pytest.approx(np.tile(polygon * (1.0 + bulge[:, None]) ** 2, area.shape[1]),
                                 abs=6e-4)  # fmt: skip
    density = unpacked(view.wider_per_mm3)
    assert density[-1] == pytest.approx(1e-3 * len(density), rel=1e-3)


def test_nodes_know_their_distance_from_the_ostium(vessel):
    shape = vessel.data.shapes[0]
    z = unpacked(shape.points_mm)[:, 2]
    # axis points lie 0.1 mm apart
    assert np.abs(unpacked(shape.node_s_mm) - z).max() <= 0.05 + 0.02
    assert vessel.data.views[-1].distal_s_mm == pytest.approx(10.0 * LENGTH)


def test_page_needs_nothing_from_outside_and_escapes_names(vessel):
    page = vessel_page(vessel.data, "study.html")
    addresses = re.findall(r"""(?:src|href)=["']?([^"' >]+)""", page.split("<script>")[0])
    assert addresses
    assert all(a.startswith("data:image/png") or a == "study.html" for a in addresses)
    assert "default-src 'none'" in page
    assert "tube &amp; &lt;b&gt;" in page
    assert "<b>" not in page
    held = re.search(r'id="vessel-data">(.*?)</script>', page, re.DOTALL)
    assert held is not None
    found = json.loads(held[1])
    assert found["patient"] == "tube & <b>"
    assert len(found["views"]) == 2


def test_bundle_is_made_of_the_sources_beside_it():
    folder = importlib.resources.files("study.report") / "viewer"
    names = sorted(file.name for file in (folder / "source").iterdir())
    digest = hashlib.sha256()
    for name in ["package.json", *(f"source/{name}" for name in names)]:
        digest.update(f"{name}\n{(folder / name).read_text('utf-8')}".encode())
    bundle = (folder / "bundle.js").read_text("utf-8")
    assert f"sources {digest.hexdigest()};" in bundle[:200], "make viewer"
    assert "</script" not in bundle
    assert "<!--" not in bundle


def test_fallback_picture_shows_the_vessel(vessel):
    address = vessel.data.views[-1].picture
    content = base64.b64decode(address.removeprefix("data:image/png;base64,"))
    pixels = np.asarray(Image.open(io.BytesIO(content)).convert("RGB")).reshape(-1, 3)
    assert np.mean(np.any(pixels < 250, axis=1)) > 0.05
    assert len(content) < 120_000


def test_limit_parts_the_colours():
    values = np.array([0.7999, 0.80, 0.8001, 1.0])
    colours = ratio_colours(values, 0.75, 0.80)
    assert np.allclose(colours[0], colours[1], atol=2e-3)
    assert np.abs(colours[1] - colours[2]).max() > 0.2
    assert low_end(0.93, 0.80) == pytest.approx(0.75)
    assert low_end(0.41, 0.80) == pytest.approx(0.40)


def _written(folder, data, kind):
    folder.mkdir()
    for name, text in vessel_files(data, kind).items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


def test_stored_data_make_the_same_page(vessel, tmp_path):
    folder = _written(tmp_path / "study", vessel.data, "study")
    found = stored_vessel(folder, "study")
    assert found == vessel.data
    page = (folder / "study-vessel.html").read_text(encoding="utf-8")
    assert vessel_page(found, "study.html") == page
    assert stored_vessel(folder, "simulate") is None


@pytest.mark.parametrize("damage", ["{", '{"format": "other"}', '{"format": 3}', "[]"])
def test_damaged_data_are_refused(vessel, tmp_path, damage):
    folder = _written(tmp_path / "study", vessel.data, "study")
    (folder / "study-vessel.json").write_text(damage, encoding="utf-8")
    with pytest.raises(CaseError, match="data of the interactive page are damaged"):
        stored_vessel(folder, "study")


def test_results_with_another_wall_stand_beside_one(vessel, tmp_path):
    own = vessel.data
    rigid = [dataclasses.replace(view, wall="rigid", moved_mm=None) for view in own.views]
    other = _written(tmp_path / "rigid", dataclasses.replace(own, views=rigid), "simulate")
    both = vessel_beside(own, tmp_path, [other])
    assert both is not None
    assert [(v.condition, v.wall) for v in both.views] == [
        *((v.condition, "rigid") for v in own.views),
        *((v.condition, v.wall) for v in own.views),
    ]
    assert len(both.shapes) == 1
    assert joined([own, own]) == own


def test_a_result_beside_of_another_patient_or_without_data_is_refused(vessel, tmp_path):
    stranger = dataclasses.replace(vessel.data, patient="somebody else")
    folder = _written(tmp_path / "other", stranger, "study")
    with pytest.raises(CaseError, match="a result of somebody else, not of tube"):
        vessel_beside(vessel.data, tmp_path, [folder])
    with pytest.raises(
        CaseError, match=r"there is no study-vessel\.json or simulation-vessel\.json"
    ):
        vessel_beside(vessel.data, tmp_path, [tmp_path])
