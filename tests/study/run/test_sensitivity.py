"""What moves the ratio of a 3D run, on a tube: by derivatives, and by runs that are changed."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.adjoint.chain_rules import recalibrated
from jaxfsi.adjoint.lumen_shape import lumen_spread, lumen_surface, thickness_field
from jaxfsi.adjoint.ratio_gradient import advance_part
from study import read_case
from study.case.parameters import SurrogateParameters
from study.run.progress import Progress
from study.run.results import PlannedRun, RunId
from study.run.run_3d import setup_of
from study.run.run_context import RunContext
from study.run.sensitivity import (
    boundary_of,
    by_parameters,
    gradient_stepper,
    reading_of,
    swept_gradient,
    under,
)
from study.run.study_choice import RunChoice

NAME = PlannedRun(RunId("loop", "exercise", "printed"), 0.12)
STEPS = 12


@pytest.fixture(autouse=True, scope="module")
def promotion():
    with jax.numpy_rank_promotion("allow"):
        yield


@pytest.fixture(scope="module")
def context(tube, tmp_path_factory):
    folder = tmp_path_factory.mktemp("tube")
    case = read_case(tube.write_case(folder))
    solver = dataclasses.replace(case.solver, dt=0.45 / 200, tolerance=1e-5)
    curve = SurrogateParameters(R0=500.0, K=1200.0, law="quadratic")
    case = dataclasses.replace(case, surrogate=curve, solver=solver)
    return RunContext(case, tube.three_openings(), "tube", folder, RunChoice(), Progress())


def _setup(context, name=NAME):
    setup = setup_of(context, name)
    plan = dataclasses.replace(setup.schedule, n_steps=STEPS, per_cycle=STEPS, per_frame=3)
    return dataclasses.replace(setup, schedule=plan)


def _ratio(context, field=None, name=NAME):
    """The ratio of a whole new run, prestress included."""
    if field is not None:
        mesh = dataclasses.replace(context.mesh, points=context.mesh.points + field)
        context = dataclasses.replace(context, mesh=mesh, mesh_key=f"moved {field.sum()}")
    setup = _setup(context, name)
    state, sums = setup.state, np.zeros(2)
    for _ in range(STEPS // 6):
        stepper = gradient_stepper(context.case, setup)
        part = advance_part(setup.model, state, stepper, reading_of(setup, context.site), 6)
        state, sums = part.state, sums + np.asarray(part.sums)
    return float(sums[1] / sums[0])


@pytest.mark.slow
def test_boundary_is_differentiated_through_its_periodic_state(context):
    """Ports and start by alpha, a factor and a pressure, against central differences."""
    case, setup = context.case, _setup(context)
    boundary = jax.tree.map(lambda v: jnp.asarray(v, float), boundary_of(case, NAME))

    @eqx.filter_jit
    def numbers(b):
        found = eqx.filter(under(b, case, "exercise", setup.model, setup.mesh), eqx.is_array)
        return jnp.concatenate([jnp.ravel(leaf) for leaf in jax.tree.leaves(found)])

    same = jnp.concatenate(
        [
            jnp.ravel(leaf)
            for leaf in jax.tree.leaves(eqx.filter((setup.model.ports, setup.state), eqx.is_array))
        ]
    )
    np.testing.assert_allclose(numbers(boundary), same, rtol=1e-12, atol=1e-9)
    for place in (lambda b: b.alpha, lambda b: b.rule.R_2, lambda b: b.P_systolic):
        value = place(boundary)
        zero = jax.tree.map(jnp.zeros_like, boundary)
        slope = jax.jvp(numbers, (boundary,), (eqx.tree_at(place, zero, value),))[1]
        up, down = (numbers(eqx.tree_at(place, boundary, value * (1.0 + h))) for h in (1e-5, -1e-5))
        size = np.abs(np.asarray(slope)).max()
        np.testing.assert_allclose(slope, (up - down) / 2e-5, atol=1e-6 * size)


@pytest.mark.slow  # compiles a chunk in reverse mode, then eight runs: six minutes
def test_wall_and_lumen_move_the_ratio_as_runs_say(context):
    setup = _setup(context)
    swept = swept_gradient(context.case, setup, None)
    relative, nodes = by_parameters(swept, context.case, NAME, setup)
    surface = lumen_surface(context.mesh)
    bulge = np.exp(-(((surface.points[:, 2] - 1.5) / 0.6) ** 2))[:, None] * surface.normal
    field = 0.002 * lumen_spread(context.mesh, surface)(bulge)
    thicker = 0.01 * thickness_field(context.mesh, surface)
    for move, slope in ((field, np.sum(nodes * field)), (thicker, np.sum(nodes * thicker))):
        found = (_ratio(context, move) - _ratio(context, -move)) / 2.0
        # steps are solved to 1e-5, and the mesh motion's factor is that of the moved mesh
        assert slope == pytest.approx(found, rel=0.02)
    assert relative["thickness"] * swept.ratio == pytest.approx(100.0 * slope, rel=1e-9)
    wall = context.case.wall
    stiffer = [
        _ratio(
            dataclasses.replace(
                context,
                case=dataclasses.replace(
                    context.case, wall=dataclasses.replace(wall, E=wall.E * (1.0 + h))
                ),
            )
        )
        for h in (0.01, -0.01)
    ]
    assert relative["E"] == pytest.approx(np.log(stiffer[0] / stiffer[1]) / 0.02, rel=0.02)
    more = [
        _ratio(context, name=dataclasses.replace(NAME, alpha=NAME.alpha * (1.0 + h)))
        for h in (0.01, -0.01)
    ]
    assert relative["alpha"] == pytest.approx(np.log(more[0] / more[1]) / 0.02, rel=0.02)


def test_tuning_alpha_again_takes_out_what_rest_absorbs():
    stress, rest = {"alpha": 0.1, "E": 0.05, "mu": -0.02}, {"alpha": 0.2, "E": 0.1, "mu": 0.0}
    again = recalibrated(stress, rest)
    assert again == pytest.approx({"E": 0.0, "mu": -0.02})
    kept = recalibrated(stress, rest, lambda name: name != "E")
    assert kept["E"] == 0.05
