"""The bed of the normal artery in 3D: in the size of the body, shared by its outlets."""

import dataclasses

import numpy as np
import pytest

from calibration import bed_flow
from jaxfsi.opening import opening_area
from lumped import ML_PER_MIN, MMHG, Coronary
from lumped.nominal import NOMINAL
from study import read_case
from study.report.body_words import BED_NOTICE, normal_bed_notes
from study.run.setup import outlets_of

BODY = "[body]\nheight_cm = 144\n[surrogate]\nR0_dyn_s_per_cm5 = 5.0e3\n"


def _mesh(tube):
    """A tube whose far end is a piece of aorta, of the anomalous and of two normal arteries."""
    mesh = tube.three_openings()
    names = [*mesh.label_names, "normal_outlet_1", "normal_outlet_2"]
    centre = mesh.points[mesh.faces].mean(axis=1)
    old = mesh.face_label == names.index("anomalous_outlet")
    label = np.array(mesh.face_label)
    label[old & (centre[:, 1] > 0.3)] = names.index("normal_outlet_1")
    label[old & (centre[:, 1] < -0.3)] = names.index("normal_outlet_2")
    return dataclasses.replace(mesh, face_label=label, label_names=tuple(names))


def _case(tube, folder, body):
    file = tube.write_case(folder)
    file.write_text(file.read_text() + body)
    return read_case(file)


def _flow(*beds):
    return sum(float(bed_flow(bed, 80.0 * MMHG)) for bed in beds) / ML_PER_MIN


def _beds(case, mesh):
    blocks = outlets_of(case, "rest", mesh, 0.9, None).blocks
    assert all(isinstance(blocks[n], Coronary) for n in blocks if n != "aorta_outlet")
    return blocks


def test_normal_outlets_share_the_bed_of_the_body(tube, tmp_path):
    case, mesh = _case(tube, tmp_path, BODY), _mesh(tube)
    blocks = _beds(case, mesh)
    parts = [blocks[f"normal_outlet_{k}"] for k in (1, 2)]
    # 0.551 of 0.9 mL/min/g · 1.28 · 93.3 g; only the anomalous bed has alpha
    usual = case.from_body.assumed["normal_artery.flow"].value / ML_PER_MIN
    mean = (110.0 + 2.0 * 65.0) / 3.0
    assert usual == pytest.approx(59.3, abs=0.1)
    assert _flow(*parts) == pytest.approx(usual * 80.0 / mean, rel=1e-9)
    areas = [opening_area(mesh, f"normal_outlet_{k}") for k in (1, 2)]
    assert _flow(parts[0]) / _flow(parts[1]) == pytest.approx((areas[0] / areas[1]) ** 1.3)
    own = case.from_body.assumed["coronary.flow"].value / ML_PER_MIN
    assert _flow(blocks["anomalous_outlet"]) == pytest.approx(own * 80.0 / mean / 0.9, rel=1e-9)
    assert not list(normal_bed_notes(case, mesh.openings, 0.9))


def test_without_a_body_the_published_bed_stays_and_the_result_says_so(tube, tmp_path):
    case, mesh = _case(tube, tmp_path, ""), _mesh(tube)
    blocks = _beds(case, mesh)
    for k in (1, 2):
        assert float(blocks[f"normal_outlet_{k}"].R_3) == NOMINAL["R_3"]
    ((level, text),) = normal_bed_notes(case, mesh.openings, 1.0 / 6.0)
    assert level == "info"
    assert text.startswith(BED_NOTICE)
    assert "18 mL/min, with 6 times the resistance" in text
    assert not list(
        normal_bed_notes(case, ("aorta_inlet", "aorta_outlet", "anomalous_outlet"), 1.0)
    )
