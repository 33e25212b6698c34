"""What nodes, moduli and the pressure in the image do through the prestress."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

from jaxfsi.adjoint.chain_rules import through_prestress
from jaxfsi.core.laws.materials import NeoHookean
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.statics import prestress
from jaxfsi.core.statics.equilibrium import small_equilibrium, static_factor
from jaxfsi.core.statics.loads import Loads, pressure_load
from jaxfsi.core.step.model import build_model
from jaxfsi.mesh import OUTER_WALL
from jaxfsi.meshing import ring

P_IMAGE = 1e5


@pytest.fixture(autouse=True, scope="module")
def promotion():
    with jax.numpy_rank_promotion("allow"):
        yield


@pytest.fixture(scope="module")
def imaged():
    """A short vessel, and its model that carries the pressure in the image undeformed."""
    mesh = ring(radius=0.2, length=0.4, thickness=0.04, n_around=8, n_axial=3, n_layers=1)
    model = build_model(mesh, {}, wall=Wall(NeoHookean(3e6, 0.45)), P_ambient=P_IMAGE)
    pull = pressure_load(mesh, OUTER_WALL, -P_IMAGE, model)
    return mesh, prestress.prestressed(model, Loads((pull,)), static_factor(model)).model


def weighed(model):
    """A number of the prestress, and its derivative by it."""
    by = jnp.cos(jnp.arange(model.prestress.size)).reshape(model.prestress.shape)
    return eqx.tree_at(lambda m: m.prestress, model, by)


def test_derivatives_through_the_prestress_match_central_differences(imaged):
    mesh, model = imaged
    by = weighed(model)
    found = through_prestress(by, model, mesh, P_IMAGE)

    def number(nu, P):
        changed = eqx.tree_at(
            lambda m: (m.wall.material.nu, m.P_ambient, m.prestress),
            model,
            (jnp.asarray(nu), jnp.asarray(P), None),
            is_leaf=lambda leaf: leaf is None,
        )
        pull = pressure_load(mesh, OUTER_WALL, -P, changed)
        loads, factor = Loads((pull,)), static_factor(model)
        S = prestress.prestressed(changed, loads, factor, tolerance=1e-10).model.prestress
        return float(jnp.sum(S * by.prestress))

    h = 1e-4
    by_nu = (number(0.45 + h, P_IMAGE) - number(0.45 - h, P_IMAGE)) / (2.0 * h)
    by_P = (number(0.45, P_IMAGE + 10.0) - number(0.45, P_IMAGE - 10.0)) / 20.0
    # a prestress to 1e-7 of the loads; truncation is 1e-6
    assert float(found.nu) == pytest.approx(by_nu, rel=1e-4)
    assert float(found.P_image) == pytest.approx(by_P, rel=1e-4)


def test_a_prestress_that_is_not_found_is_not_differentiated(imaged, monkeypatch):
    mesh, model = imaged
    weak = partial(small_equilibrium, max_starts=1, max_iterations=1)
    monkeypatch.setattr(prestress, "small_equilibrium", weak)
    with pytest.raises(RuntimeError, match=r"cannot be differentiated\. The wall was not brought"):
        through_prestress(weighed(model), model, mesh, P_IMAGE)


def test_a_derivative_that_is_not_finite_is_refused(imaged):
    mesh, model = imaged
    by = jnp.full(model.prestress.shape, jnp.nan)
    with pytest.raises(RuntimeError, match="not finite"):
        through_prestress(eqx.tree_at(lambda m: m.prestress, model, by), model, mesh, P_IMAGE)
