"""A stepper is made for one mesh, of concrete numbers; what it cannot serve is refused."""

import jax
import pytest

from jaxfsi import core
from jaxfsi.core.step.model import WallElement
from jaxfsi.meshing import tube
from lumped import RCR, Constant

WALLS: tuple[WallElement, ...] = ("linear", "quadratic")


def model_of(*, E=3e6, n_around=6, wall_element: WallElement = "linear"):
    """A short tube under no pressure."""
    mesh = tube(radius=0.5, length=0.5, thickness=0.1, n_around=n_around, n_axial=2, n_layers=1)
    ports = {name: core.PressurePort(Constant(0.0)) for name in mesh.openings}
    wall = core.Wall(core.LinearElastic(E, 0.3))
    return core.build_model(mesh, ports, wall=wall, wall_element=wall_element)


def test_traced_numbers_are_refused_and_told_where_to_prepare():
    with pytest.raises(ValueError, match="Call prepare outside the function"):
        jax.grad(lambda E: core.prepare(1e-3, model_of(E=E)).dt)(3e6)


@pytest.mark.parametrize("wall_element", WALLS)
def test_stepper_of_another_mesh_is_refused(wall_element):
    model = model_of(wall_element=wall_element)
    stepper = core.prepare(1e-3, model)
    assert stepper.preconditioner.velocity_scale.shape == model.x.shape
    other = model_of(n_around=8, wall_element=wall_element)
    with pytest.raises(ValueError, match=r"prepared for \d+ nodes, and the model has"):
        core.march(other, core.initial_state(other), stepper, 1)


def test_block_in_place_of_a_port_is_told_how_to_become_one():
    mesh = tube(radius=0.5, length=0.5, thickness=0.1, n_around=6, n_axial=2, n_layers=1)
    ports = {"inlet": core.PressurePort(Constant(0.0)), "outlet": RCR(1.0, 1.0, 1.0)}
    with pytest.raises(ValueError, match=r"'outlet' is of type RCR, a block: write BlockPort"):
        core.build_model(mesh, ports, wall=core.Wall(core.LinearElastic(3e6, 0.3)))
