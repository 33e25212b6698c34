"""A profile of a step speaks of its stages."""

import jax
import pytest

from jaxfsi import core
from jaxfsi.core.step.step import advance_step
from jaxfsi.meshing import tube
from lumped import Constant

STAGES = (
    "mesh_motion",
    "ports",
    "stabilisation",
    "blood",
    "wall",
    "interface",
    "tangent",
    "linear_solve",
    "pressure_solve",
    "velocity_solve",
    "update",
)


@pytest.fixture(scope="module")
def program():
    mesh = tube(radius=0.5, length=0.5, thickness=0.1, n_around=6, n_axial=2, n_layers=1)
    ports = {name: core.PressurePort(Constant(0.0)) for name in mesh.openings}
    wall = core.Wall(core.LinearElastic(3e6, 0.3))
    model = core.build_model(mesh, ports, wall=wall, wall_element="quadratic")
    stepper = core.prepare(1e-3, model)
    lowered = jax.jit(lambda state: advance_step(model, state, stepper)[0]).lower(
        core.initial_state(model)
    )
    return lowered.as_text(debug_info=True)


@pytest.mark.parametrize("stage", STAGES)
def test_stage_is_named_in_the_compiled_program(program, stage):
    assert f"/{stage}/" in program
