"""The ramp and the runs after it call one compiled step."""

import dataclasses

import equinox as eqx
import jax
import pytest

from study import read_case
from study.case.parameters import SurrogateParameters
from study.run.progress import Progress
from study.run.ramp import prepare_ramp
from study.run.results import PlannedRun, RunId
from study.run.run_3d import setup_of
from study.run.run_context import RunContext
from study.run.shared_step import with_ramp_off
from study.run.study_choice import RampChoice, RunChoice


@pytest.fixture(autouse=True, scope="module")
def promotion():
    with jax.numpy_rank_promotion("allow"):
        yield


@pytest.fixture(scope="module")
def context(tube, tmp_path_factory):
    folder = tmp_path_factory.mktemp("tube")
    case = read_case(tube.write_case(folder))
    curve = SurrogateParameters(R0=500.0, K=1200.0, law="quadratic")
    case = dataclasses.replace(case, surrogate=curve)
    return RunContext(case, tube.three_openings(), "tube", folder, RunChoice(), Progress())


def _program(setup):
    """What decides whether a step is compiled anew: structure, shapes, types, static choices."""
    arrays, choices = eqx.partition((setup.model, setup.state), eqx.is_array)
    return jax.tree.map(jax.typeof, arrays), jax.tree.structure(arrays), choices


@pytest.mark.parametrize(("condition", "rule"), [("rest", None), ("exercise", "printed")])
def test_a_run_calls_the_step_of_the_ramp(context, condition, rule):
    run = setup_of(context, PlannedRun(RunId("loop", condition, rule), 0.12))
    types, structure, choices = _program(with_ramp_off(run))
    ramp_types, ramp_structure, ramp_choices = _program(prepare_ramp(context, RampChoice()))
    assert structure == ramp_structure
    assert types == ramp_types
    assert bool(eqx.tree_equal(choices, ramp_choices))
    assert _program(run)[1] != structure  # its own ports are another program
