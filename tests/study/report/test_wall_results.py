"""The document, the page and the summary of a calibrated wall."""

import jax.numpy as jnp
import numpy as np
import pytest

from calibration import LumenProfile
from calibration.loaded_wall import WallStiffness
from jaxfsi import Lumen
from lumped import MMHG
from study.report.page import wall_report
from study.report.summary import summary
from study.report.wall_results import LEFT, wall_document
from study.run.measured_states import MeasuredState
from study.run.wall_calibration import StateMotion, WallFit
from study.store.json_form import as_json
from study.store.provenance import Provenance

S = np.array([0.0, 0.2, 0.4])
SD = np.full(3, 0.1)


def _profile(area, minor):
    return LumenProfile(np.log(np.full(3, area)), np.log(np.full(3, minor)), SD, SD)


def _fit(measured, predicted):
    """A state whose area [cm²] was measured, where the fitted wall predicts a ratio."""
    lumen = Lumen(jnp.zeros((3, 8, 2)), jnp.asarray(S))
    image = MeasuredState("rest_diastole", 75.0 * MMHG, 1.0, lumen)
    state = MeasuredState("dobutamine_systole", 140.0 * MMHG, 0.9, lumen)
    ratio = {name: (np.log(np.full(3, r)), np.zeros(3)) for name, r in predicted.items()}
    return WallFit(
        s=S,
        image=image,
        image_profile=_profile(0.06, 0.14),
        states=(StateMotion(state, True, _profile(measured, 0.14), ratio),),
        start=WallStiffness(1.5e7, 1.5e7, 1.5e7, 1e4),
        found=WallStiffness(1e7, 4e6, 2e7, 1e4),
        names=("aorta", "coronary"),
        interval=np.array([[5e6, 2e7], [2e6, 8e6]]),
        misfit=1.2,
        messages=("The data determine all 2 parameters.",),
        evaluations=7,
    )


def _document(case, origin, measured, fitted):
    predicted = {"linear": 1.0, "literature": 1.05, "fitted": fitted}
    return as_json(wall_document(case, _fit(measured, predicted), origin))


@pytest.fixture(scope="module")
def parts():
    from study import demo_case_path, read_case
    from study.store.case_inputs import provenance
    from study.store.options import WallOptions

    case = read_case(demo_case_path())
    origin = provenance(case, ("jaxfsi", "calibrate-wall"), WallOptions())
    assert isinstance(origin, Provenance)
    return case, origin


def test_prediction_is_the_image_times_the_ratio_of_the_model(parts):
    document = _document(*parts, measured=0.048, fitted=0.8)
    state = document["states"]["dobutamine_systole"]
    assert state["predicted"]["literature"]["area_mm2"] == pytest.approx([6.3] * 3)
    assert state["measured"]["area_mm2"] == pytest.approx([4.8] * 3)
    assert state["area_sd_mm2"] == pytest.approx([0.48] * 3)
    assert state["change"]["measured"] == pytest.approx(-0.2)
    assert state["change"]["fitted"] == pytest.approx(-0.2)
    assert state["deviation"]["fitted"] == pytest.approx(0.0, abs=1e-12)
    # ln(1.05/0.8) over the errors of both states, 0.1 √2, in half of the numbers
    off = np.log(1.05 / 0.8) / (0.1 * np.sqrt(2.0)) / np.sqrt(2.0)
    assert state["deviation"]["literature"] == pytest.approx(off)
    still = np.log(0.8) / (0.1 * np.sqrt(2.0)) / np.sqrt(2.0)
    assert state["deviation"]["rigid"] == pytest.approx(-still)
    assert state["P_distal_mmHg"] == pytest.approx(126.0)
    assert [note["level"] for note in document["notes"]] == ["info", "info"]
    assert "E_coronary_dyn_per_cm2 = " in document["notes"][1]["text"]


def test_what_no_moduli_explain_is_said(parts):
    document = _document(*parts, measured=0.036, fitted=1.02)
    levels = [note["level"] for note in document["notes"]]
    texts = [note["text"] for note in document["notes"]]
    assert levels == ["warning", "warning", "info"]
    assert "-40.0 % as measured" in texts[0]
    assert "+2.0 % in the fitted wall" in texts[0]
    assert texts[1] == LEFT


def test_page_and_summary_hold_the_numbers(parts):
    document = _document(*parts, measured=0.036, fitted=1.02)
    page = wall_report(document)
    assert page.count("<svg") == 1
    for text in ("dobutamine systole", "-40.0", "coronary", "dyn/cm2", "torsion"):
        assert text in page
    told = summary(document)
    assert "coronary" in told
    assert "2e+06" in told
    assert "-40.0 % as measured" in told
