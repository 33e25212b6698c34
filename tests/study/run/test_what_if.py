"""What an operation changes: the loss, the ratios, and not the bed."""

import dataclasses
import json
import re
import types

import pytest

from calibration import PressureFlowLaw
from lumped import Surrogate
from study import CaseError, read_case
from study.case.operation import Operation
from study.report.what_if_results import what_if_document
from study.run import what_if_3d as in_3d
from study.run.run_3d import LumenCollapsed
from study.run.study_choice import RunChoice, StudyChoice
from study.run.what_if import both_sides, operated_case, scaled_losses, what_if_0d
from study.store.meshes import mesh_key

CASE = """\
[patient]
id = "drawn"
[anatomy]
kind = "synthetic"
[condition.rest]
P_systolic_mmHg = 110.0
P_diastolic_mmHg = 65.0
period_s = 0.80
cardiac_output_l_per_min = 5.0
ffr = 0.91
[condition.dobutamine]
P_systolic_mmHg = 130.0
P_diastolic_mmHg = 70.0
period_s = 0.45
[solver]
n_steps = 64
"""
UNROOF = Operation("unroof")


@pytest.fixture(scope="module")
def case_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("what_if") / "drawn.toml"
    path.write_text(CASE)
    return path


@pytest.fixture(scope="module")
def case(case_file):
    return read_case(case_file)


@pytest.fixture(scope="module")
def sides(case):
    return both_sides(case, UNROOF)


@pytest.fixture(scope="module")
def found(case, sides):
    return what_if_0d(case, UNROOF, sides)


def test_every_ratio_rises_and_the_bed_stays(found):
    what, result = found
    assert what.alpha == result.calibrations["quadratic"].alpha
    assert [r.rule for r in what.ratios] == [None, "printed", "all"]
    assert what.ratios[0].before == pytest.approx(0.91, abs=1e-6)
    for ratio in what.ratios:
        assert ratio.before < ratio.after < 1.0
        assert ratio.flow_before_ml_per_min < ratio.flow_after_ml_per_min


def test_drawn_case_has_the_law_of_its_lumen(found):
    what, result = found
    assert what.before.R0 == result.patient.case.surrogate.R0
    assert what.after.R0 < what.before.R0
    assert what.after.K < what.before.K
    assert min(what.after.area_mm2) > 1.8 * min(what.before.area_mm2)
    assert what.after.length_mm < what.before.length_mm


def test_losses_of_the_case_are_scaled_by_those_of_the_lumen():
    before, after = PressureFlowLaw(R0=100.0, K=50.0), PressureFlowLaw(R0=20.0, K=25.0)
    changed = scaled_losses(Surrogate(R0=300.0, K=80.0), before, after)
    assert (float(changed.R0), float(changed.K)) == pytest.approx((60.0, 40.0))
    linear = scaled_losses(Surrogate(R0=300.0), before, before)
    assert float(linear.R0) == pytest.approx(300.0)


def test_operated_anatomy_has_a_mesh_of_its_own(case):
    keys = {
        mesh_key(changed, "synthetic")
        for changed in (
            case,
            operated_case(case, UNROOF),
            operated_case(case, Operation("stent")),
            operated_case(case, Operation("stent", 0.3)),
        )
    }
    assert len(keys) == 4


def test_surface_cannot_be_operated_on(case):
    without = dataclasses.replace(case, anatomy=None)
    with pytest.raises(CaseError, match="nothing to mesh"):
        both_sides(without, UNROOF)


def _run(condition, rule, ratio, flow=50.0):
    distal = types.SimpleNamespace(mean_Q_ml_per_min=flow)
    return types.SimpleNamespace(condition=condition, rule=rule, ratio=ratio, distal=distal)


@pytest.mark.parametrize("continued", [False, True])
def test_runs_after_take_the_alpha_of_before(case, sides, tmp_path, monkeypatch, continued):
    asked, starts = [], []

    def run(context, planned, before=None):
        asked.append((planned.id.name, planned.alpha))
        starts.append(before and before.id.name)
        if planned.id.condition == "dobutamine":
            raise LumenCollapsed("The lumen collapsed.")
        return _run("rest", None, 0.98, 60.0)

    opened = []
    monkeypatch.setattr(
        in_3d, "open_context", lambda case, *_: (opened.append(case), (None, None))[1]
    )
    law = types.SimpleNamespace(R0=100.0, K=40.0)
    fit = types.SimpleNamespace(fit=types.SimpleNamespace(law=law))
    monkeypatch.setattr(in_3d, "ramp_record", lambda *_: None)
    monkeypatch.setattr(in_3d, "fitted", lambda *_: fit)
    monkeypatch.setattr(in_3d, "with_curve", lambda context, R0, K: context)
    monkeypatch.setattr(in_3d, "fsi_run", run)
    runs = [_run("rest", None, 0.91), _run("dobutamine", "printed", 0.85)]
    choice = StudyChoice(run=RunChoice(continued=continued))
    before = in_3d.StudyBefore(case, choice, (500.0, 300.0), 0.07, runs, "before")
    progress = types.SimpleNamespace(step=lambda _: None)
    what = in_3d.what_if_3d(before, UNROOF, sides, tmp_path, progress)
    assert asked == [("loop-rest", 0.07), ("loop-dobutamine-printed", 0.07)]
    assert starts == [None, "loop-rest" if continued else None]
    assert opened[0].operation == UNROOF
    assert [r.after for r in what.ratios] == [0.98, None]
    assert "collapsed" in what.remarks[0]
    origin = types.SimpleNamespace()
    assert "after it the lumen collapses" in what_if_document(what, case, origin).verdict


@pytest.fixture(scope="module")
def page(case_file, command, tmp_path_factory):
    out = tmp_path_factory.mktemp("page") / "out"
    outcome = command("what-if", case_file, "--stent", "3.5", folder=out)
    assert outcome.status == 0, outcome.stderr
    return outcome


def test_page_has_both_sides_and_says_that_alpha_is_kept(page):
    text = (page.folder / "what-if.html").read_text()
    assert text.count("<svg") == 2
    assert "The coronary bed is that before the operation" in text
    heads = re.findall(r"<thead><tr>(.*?)</tr></thead>", text)
    # on a narrow screen the columns beyond these are reached by a swipe
    assert heads[0].startswith("<th>quantity</th><th>before</th><th>after</th>")
    assert heads[1].startswith("<th>ratio</th><th>before</th><th>after</th><th>change</th>")
    assert "to 3.5 mm" in text
    for name in ("before/lumen.csv", "after/lumen.csv", "before/report.html"):
        assert (page.folder / name).is_file()
    assert "alpha = " in page.stdout


def test_stored_result_is_shown_again(page, command):
    document = json.loads((page.folder / "what-if.json").read_text())
    assert document["diameter_mm"] == 3.5
    for place in (page.folder / "what-if.json", page.folder):
        shown = command("show", place)
        assert shown.status == 0
        assert document["verdict"] in shown.stdout


@pytest.mark.parametrize(
    "options",
    [
        ("--unroof", "--quick"),
        ("--unroof", "--from", "somewhere"),
        ("--unroof", "--mode", "3d", "--from", "nowhere"),
        ("--unroof", "--mode", "3d", "--from", "nowhere", "--quick"),
        ("--unroof", "--stent"),
        ("--stent", "30"),
        ("--stent", "8"),
        (),
    ],
)
def test_options_that_make_no_sense_are_refused(case_file, command, options, tmp_path):
    out = tmp_path / "out"
    refused = command("what-if", case_file, *options, folder=out)
    assert refused.status == 2
    assert not out.exists()
