"""The mesh of the blood follows its interface."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.core.elements.linear import geometry
from jaxfsi.core.laws.materials import SaintVenantKirchhoff
from jaxfsi.core.laws.mesh_motion import mesh_displacement, mesh_motion
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.ports.pressure import PressurePort
from jaxfsi.core.step.model import build_model
from jaxfsi.meshing import tube
from lumped.waveforms import Constant


@pytest.fixture(scope="module")
def model():
    mesh = tube(radius=0.5, length=2.0, thickness=0.1, n_around=12, n_axial=10, n_layers=1)
    port = PressurePort(Constant(0.0))
    return build_model(
        mesh, {"inlet": port, "outlet": port}, wall=Wall(SaintVenantKirchhoff(3e6, 0.3))
    )


@pytest.fixture(scope="module")
def motion(model):
    return mesh_motion(model)


def _on_wall(model, d):
    return jnp.where(model.in_solid, d, 0.0)


def _ratio(model, d):
    """Volumes of the fluid elements over those of the reference."""
    tets = model.fluid_tets
    return geometry(model.x + d, tets).volume / geometry(model.x, tets).volume


def test_translation_of_all_held_nodes_moves_the_mesh_rigidly(model, motion):
    shift = jnp.asarray([[0.1], [-0.3], [0.05]])
    given = jnp.where(model.mesh_prescribed, shift, 0.0)
    d = mesh_displacement(motion, given)
    # A harmonic extension keeps constants; the direct solve leaves round-off.
    np.testing.assert_allclose(
        d[:, model.in_fluid], np.broadcast_to(shift, d.shape)[:, model.in_fluid], atol=1e-12
    )


def test_held_nodes_get_what_they_are_given_and_openings_stay(model, motion):
    rng = np.random.default_rng(0)
    given = _on_wall(model, jnp.asarray(0.01 * rng.standard_normal(model.x.shape)))
    d = mesh_displacement(motion, given)
    np.testing.assert_array_equal(d[:, model.mesh_prescribed], given[:, model.mesh_prescribed])


def test_displacement_stays_between_its_extremes(model, motion):
    # Discrete maximum principle: holds here because the elements have few obtuse angles.
    bump = jnp.exp(-(((model.x[2] - 1.0) / 0.3) ** 2))
    d = mesh_displacement(motion, _on_wall(model, jnp.stack([0.1 * bump] * 3)))
    assert float(jnp.min(d)) >= -1e-3
    assert float(jnp.max(d)) <= 0.1 + 1e-9


@pytest.mark.parametrize("strain", [0.3, -0.5, -0.8], ids=["wide", "narrow", "nearly_shut"])
def test_uniform_change_of_radius_leaves_no_element_inverted(model, motion, strain):
    taper = jnp.sin(jnp.pi * model.x[2] / 2.0)
    d = _on_wall(model, jnp.stack([strain * model.x[0], strain * model.x[1], 0.0 * model.x[2]]))
    ratio = _ratio(model, mesh_displacement(motion, d * taper))
    assert float(jnp.min(ratio)) > 0.5 * (1.0 + min(strain, 0.0)) ** 2


def test_flattening_to_a_slit_leaves_no_element_inverted(model, motion):
    taper = jnp.sin(jnp.pi * model.x[2] / 2.0)
    d = _on_wall(model, jnp.stack([0.3 * model.x[0], -0.85 * model.x[1], 0.0 * model.x[2]]))
    assert float(jnp.min(_ratio(model, mesh_displacement(motion, d * taper)))) > 0.0


def test_motion_is_linear(model, motion):
    rng = np.random.default_rng(1)
    f, g = (_on_wall(model, jnp.asarray(rng.standard_normal(model.x.shape))) for _ in range(2))
    both = mesh_displacement(motion, 2.0 * f - g)
    separate = 2.0 * mesh_displacement(motion, f) - mesh_displacement(motion, g)
    np.testing.assert_allclose(both, separate, atol=1e-11)
