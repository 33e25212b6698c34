"""Tier 3 on a tube with a quick stand-in for the march: which runs are made, and what is sealed."""

import dataclasses

import jax
import numpy as np
import pytest

import study.run.run_3d as run_3d
from benchmarks.blind import in_3d
from benchmarks.blind.cases import unseal
from benchmarks.blind.score_3d import table
from diagnosis import CATALOGUE
from lumped import MMHG
from study import read_case
from study.case.parameters import WallParameters
from study.case.record import read_record
from study.run.finished_study import FinishedStudy, RampCurve
from study.run.progress import Progress
from study.run.study_choice import RunChoice
from study.run.study_context import open_context
from tests.study.quick_march import QuickMarch
from tests.study.tube_case import write_case

pytestmark = pytest.mark.slow

SOME = ("none", "wire_drift", "quadratic_loss", "stress_compliance")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Folder of the records and the runs that were made, in order."""
    place = tmp_path_factory.mktemp("tier-3")
    case = read_case(write_case(place))
    stress = dataclasses.replace(case.conditions["exercise"], name="dobutamine")
    case = dataclasses.replace(
        case,
        wall=WallParameters(prestress="none"),
        conditions={"rest": case.conditions["rest"], "dobutamine": stress},
    )
    context, _ = open_context(case, place / "results", RunChoice(), Progress())
    unit = MMHG
    ramp = RampCurve(0.4 * unit, 0.75 * unit, 0.03 * unit)
    march = QuickMarch(2.0 * unit, 1e-7)
    with jax.numpy_rank_promotion("allow"), pytest.MonkeyPatch.context() as patch:
        patch.setattr(run_3d, "run_simulation", march)
        in_3d.make(place / "t3", FinishedStudy(context, ramp, 0.2, []), SOME, 3, 0.5)
    return place / "t3", march.folders


def test_what_an_effect_leaves_as_it_is_is_run_once(made):
    _, folders = made
    names = ("rest", "dobutamine", "dobutamine_high")
    stressed = [f"stress_compliance-{name}" for name in names[1:]]
    assert folders == [f"plain-{name}" for name in names] + stressed


def test_the_curve_is_known_but_where_its_quadratic_part_is_withheld(made):
    folder, _ = made
    for k, label in enumerate(unseal(folder)):
        record, _ = read_record(folder / "noise-0.5" / f"case-{k:04d}")
        assert [c.held_out for c in record.conditions] == [False, False, True]
        assert record.L == pytest.approx(0.03 * MMHG)
        if label["kind"] == "pair":
            drop = record.R0**2 * np.exp(label["sizes"]["proximal_resistance"])
            assert record.K is None
            # R0 of the curve is the secant times what the label says
            assert drop / record.R0 == pytest.approx(0.4 * MMHG, rel=1e-5)
        else:
            assert (record.R0, record.K) == pytest.approx((0.4 * MMHG, 0.75 * MMHG), rel=1e-5)


def test_a_drifting_wire_moves_the_traces_of_the_same_run(made):
    folder, _ = made
    labels = unseal(folder)
    names = [next(iter(label["sizes"]), "none") for label in labels]
    truth = np.load(folder / "held_out_truth.npy")
    moved = truth[names.index("wire_drift")] - truth[names.index("none")]
    # two steps of drift, a little less in the truth than in the catalogue
    np.testing.assert_allclose(
        moved, 1.9 * labels[names.index("wire_drift")]["sizes"]["wire_drift"]
    )


def test_the_table_counts_right_causes_and_alarms():
    inclusion = {effect.id: 0.0 for effect in CATALOGUE} | {"wire_drift": 0.9}
    row = {"inclusion": inclusion, "held_out": {"before": 3.0, "after": 0.5}}
    right = {**row, "verdict": "named", "named": ["wire_drift"]}
    right["label"] = {"kind": "single", "sizes": {"wire_drift": 2.0}}
    alarm = {**row, "verdict": "unknown", "named": []}
    alarm["label"] = {"kind": "none", "sizes": {}}
    text = table([right, alarm], 0.6)
    assert "right place 1/1, right cause 1/1, named wrongly 0/2, alarms on the null 1" in text


def test_either_narrowing_is_right_where_stress_narrows_the_lumen():
    inclusion = {effect.id: 0.0 for effect in CATALOGUE} | {"dynamic_narrowing": 0.9}
    row = {"inclusion": inclusion, "held_out": {"before": 3.0, "after": 0.5}}
    row |= {"verdict": "named", "named": ["dynamic_narrowing"]}
    row["label"] = {"kind": "single", "sizes": {"stress_narrowing": 0.3}, "apart": 2.5}
    text = table([row], 0.6)
    assert "right cause 1/1, named wrongly 0/1" in text
    assert "| 3.00 to 0.50 | 2.50 |" in text
