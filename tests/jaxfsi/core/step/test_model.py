"""What a model is made of must fit together."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.core import Wall, build_model
from jaxfsi.core.laws.fibres import HolzapfelGasserOgden
from jaxfsi.core.laws.materials import NeoHookean
from jaxfsi.meshing import ring


@pytest.fixture(scope="module", params=[True, False])
def mesh(request):
    return ring(
        radius=0.2, length=0.4, thickness=0.04, n_around=8, n_axial=2, n_layers=1,
        columns=request.param,
    )  # fmt: skip


def _fibres(n):
    frame = jnp.tile(jnp.asarray([[1.0], [0.0], [0.0]]), (1, n))
    across = jnp.tile(jnp.asarray([[0.0], [0.0], [1.0]]), (1, n))
    return HolzapfelGasserOgden(1e6, 0.45, 1e4, 1.0, 0.5, frame, across)


def test_numbers_of_the_wall_are_one_for_all_or_one_an_element(mesh):
    n = len(mesh.tets)
    for wall in (
        Wall(NeoHookean(jnp.full(n, 1e6), 0.45)),
        Wall(NeoHookean(1e6, 0.45), rho_s=jnp.full(n, 1.1)),
        Wall(_fibres(n)),
    ):
        assert build_model(mesh, {}, wall=wall).wall is not None


def test_numbers_of_another_mesh_are_refused(mesh):
    n = len(mesh.tets)
    for wall, words in (
        (Wall(NeoHookean(jnp.full(n - 3, 1e6), 0.45)), rf"wall\.material\.E has .*\({n - 3},\)"),
        (Wall(_fibres(2 * n)), rf"circumference has .*\(3, {2 * n}\).*axis has"),
        (Wall(NeoHookean(1e6, 0.45), damping=np.zeros(n + 1)), r"wall\.damping has"),
    ):
        with pytest.raises(ValueError, match=rf"{words}.*has {n} tetrahedra"):
            build_model(mesh, {}, wall=wall)
