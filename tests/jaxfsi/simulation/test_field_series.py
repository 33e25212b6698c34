"""Fields of a run as its files name them."""

import jax.numpy as jnp
import numpy as np

from jaxfsi.core import PressurePort, Wall, build_model, initial_state
from jaxfsi.core.laws.materials import LinearElastic
from jaxfsi.mesh import Region
from jaxfsi.meshing import tube
from jaxfsi.simulation.field_series import frame_fields
from jaxfsi.verification.ethier_steinman import EthierSteinman, box_mesh, ethier_steinman_model
from lumped import Constant


def test_all_blood_has_a_pressure_where_it_counts_from_one_node():
    model = ethier_steinman_model(box_mesh(2), EthierSteinman())
    level = np.flatnonzero(~np.asarray(model.in_fluid))
    assert len(level) == 1
    points, _ = frame_fields(model, initial_state(model), None)
    assert np.all(np.isfinite(points["pressure_mmHg"]))
    assert points["pressure_mmHg"][level[0]] == 0.0


def test_the_inside_of_the_wall_has_no_pressure():
    mesh = tube(radius=0.5, length=1.0, thickness=0.1, n_around=8, n_axial=3, n_layers=1)
    ports = {name: PressurePort(Constant(0.0)) for name in mesh.openings}
    model = build_model(mesh, ports, wall=Wall(LinearElastic(1e6, 0.3)))
    points, _ = frame_fields(model, initial_state(model, p=jnp.asarray(100.0)), None)
    blood = np.zeros(len(mesh.points), bool)
    blood[mesh.tets_of(Region.FLUID)] = True
    np.testing.assert_array_equal(np.isfinite(points["pressure_mmHg"]), blood)
