"""Blocks of the preconditioner against the linearised step of a small tube at rest."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.core.laws.fluid import Blood
from jaxfsi.core.laws.materials import LinearElastic
from jaxfsi.core.laws.mesh_motion import mesh_motion
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.laws.viscosity import Newtonian
from jaxfsi.core.ports.pressure import PressurePort
from jaxfsi.core.solve.preconditioner import preconditioner
from jaxfsi.core.solve.tangent import apply_elements, step_tangent
from jaxfsi.core.solve.wall_factor import wall_free, wall_product
from jaxfsi.core.step.equations import Unknowns, begin_step
from jaxfsi.core.step.generalized_alpha import generalized_alpha
from jaxfsi.core.step.model import build_model
from jaxfsi.core.step.state import initial_state
from jaxfsi.meshing import tube
from lumped.waveforms import Constant

DT = 1e-3
METHOD = generalized_alpha(0.5)


@pytest.fixture(scope="module")
def linearised():
    """A model, its preconditioner, and the product with its linearised step."""
    mesh = tube(radius=0.5, length=0.5, thickness=0.1, n_around=6, n_axial=2, n_layers=1)
    ports = {name: PressurePort(Constant(0.0)) for name in mesh.openings}
    wall = Wall(LinearElastic(3e6, 0.45), rho_s=1.1)
    blood = Blood(viscosity=Newtonian())
    model = build_model(mesh, ports, blood=blood, wall=wall, wall_element="quadratic")
    M = preconditioner(DT, model, METHOD, dtype=np.float64)

    @eqx.filter_jit
    def products(changes):
        state = initial_state(model)
        step = begin_step(jnp.asarray(DT), model, state, METHOD, mesh_motion(model))
        about = step_tangent(Unknowns(state.u, state.p), model, step, METHOD)
        one = lambda u, p: apply_elements(about, Unknowns(u, p), model, step, METHOD)  # noqa: E731
        return jax.vmap(one)(*changes)

    return model, M, products


@pytest.mark.slow  # compiles the quadratic kernels
def test_matrix_of_the_wall_is_that_of_the_step_at_rest(linearised):
    """With the blood's share of the nodes of the interface."""
    model, M, products = linearised
    free = wall_free(M.wall)
    at_ports = np.unique(np.concatenate([np.asarray(f).ravel() for f in model.port_faces]))
    v = jnp.where(free, jnp.asarray(np.random.default_rng(0).standard_normal(model.x.shape)), 0.0)
    whole = products((v[None], jnp.zeros((1, model.n_nodes)))).u[0]
    rows = np.setdiff1d(np.flatnonzero(free), at_ports)
    found = wall_product(M.wall, v)
    size = float(jnp.max(jnp.abs(whole[:, rows])))
    assert np.allclose(found[:, rows], whole[:, rows], rtol=0.0, atol=1e-9 * size)


@pytest.mark.slow  # compiles the quadratic kernels
def test_pressure_acts_on_mid_edge_modes_as_in_the_step(linearised):
    model, M, products = linearised
    p = jnp.where(model.in_fluid, jnp.asarray(np.random.default_rng(1).random(model.n_nodes)), 0.0)
    whole = products((jnp.zeros((1, *model.x.shape)), p[None])).u[0]
    edges = np.flatnonzero(~np.asarray(model.prescribed)[model.n_vertices :]) + model.n_vertices
    assert np.any(whole[:, edges] != 0.0)
    assert np.allclose(M.mid_edge.load(p)[:, edges], whole[:, edges], rtol=1e-9, atol=1e-12)


def test_load_and_flux_of_mid_edge_modes_are_transposed(linearised):
    model, M, _ = linearised
    rng = np.random.default_rng(2)
    p, u = (jnp.asarray(rng.standard_normal(s)) for s in (model.n_nodes, model.x.shape))
    there, back = jnp.vdot(M.mid_edge.load(p), u), jnp.vdot(M.mid_edge.flux(u), p)
    assert float(there) == pytest.approx(float(back), rel=1e-12)
