"""The equations of a step stand in four places: on the page, as kernels, tangent and matrices.

The derivative of the kernels is compared with the tangent in `solve/test_tangent.py`.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi import core
from jaxfsi.core.elements.assembly import host_geometry
from jaxfsi.core.elements.linear import geometry
from jaxfsi.core.laws.fluid import fluid_residual, lagged_coefficients
from jaxfsi.core.laws.mesh_motion import mesh_motion
from jaxfsi.core.laws.solid import solid_residual
from jaxfsi.core.solve.blood_tangent import blood_diagonal
from jaxfsi.core.solve.step_blocks import step_blocks
from jaxfsi.core.solve.tangent import apply_elements, step_tangent
from jaxfsi.core.step.equations import Unknowns, begin_step
from jaxfsi.meshing import tube
from jaxfsi.verification import MATERIALS
from jaxfsi.verification.reference_residual import (
    reference_blood_residual,
    reference_wall_residual,
)
from lumped import Constant

DT, METHOD = 1e-3, core.generalized_alpha(0.5)
RNG = np.random.default_rng(0)


def _model(transient_continuity):
    mesh = tube(radius=0.5, length=0.8, thickness=0.1, n_around=8, n_axial=4, n_layers=1)
    ports = {name: core.PressurePort(Constant(0.0)) for name in mesh.openings}
    wall = core.Wall(core.NeoHookean(3e6, 0.45), damping=50.0)
    blood = core.Blood(viscosity=core.Newtonian(0.05), transient_continuity=transient_continuity)
    return core.build_model(mesh, ports, blood=blood, wall=wall)


@pytest.fixture(scope="module", params=[False, True], ids=["default", "transient continuity"])
def model(request):
    return _model(request.param)


def _field(size, *shape):
    return size * jnp.asarray(RNG.standard_normal(shape))


def _close(found, wanted, tolerance=1e-12):
    """To the round-off of sums over the elements of a node."""
    scale = float(jnp.max(jnp.abs(wanted)))
    assert scale > 0.0
    np.testing.assert_allclose(found, wanted, rtol=0, atol=tolerance * scale)


def test_kernel_of_the_blood_is_the_weak_form(model):
    n, tets = model.n_nodes, model.fluid_tets
    x = model.x + _field(1e-3, 3, n)
    u, a, p, u_mesh = _field(20.0, 3, n), _field(1e4, 3, n), _field(1e4, n), _field(5.0, 3, n)

    @jax.jit
    def both(u, a, p, u_mesh, x):
        shape = geometry(x, tets)
        k = lagged_coefficients(jnp.asarray(DT), u, a, p, u_mesh, model.blood, tets, shape)
        other = u + 3.0 * u_mesh  # other than the state of the coefficients
        kernel = fluid_residual(other, a, p, model.blood, k, tets, shape)
        return kernel, reference_blood_residual(other, a, p, model.blood, k, tets, x)

    (r_u, r_p), (page_u, page_p) = both(u, a, p, u_mesh, x)
    _close(r_u, page_u)
    _close(r_p, page_p)


@pytest.mark.parametrize("material", MATERIALS.values(), ids=MATERIALS)
def test_kernel_of_the_wall_is_the_weak_form(material):
    model = _model(False)
    n, tets = model.n_nodes, model.solid_tets
    wall = core.Wall(material, rho_s=1.1, damping=40.0)
    shape = geometry(model.x, tets)
    u, a, d = _field(5.0, 3, n), _field(1e3, 3, n), _field(2e-3, 3, n)
    S = _field(1e4, 3, 3, tets.shape[1])
    S = S + jnp.swapaxes(S, 0, 1)
    kernel = solid_residual(u, a, d, wall, model.element, shape, S[:, :, None])
    _close(kernel, reference_wall_residual(u, a, d, wall, tets, model.x, S), 1e-11)


def test_matrices_of_the_preconditioner_are_the_tangent_at_rest(model):
    state = core.initial_state(model)
    step = begin_step(jnp.asarray(DT), model, state, METHOD, mesh_motion(model))
    tangent = step_tangent(Unknowns(state.u, state.p), model, step, METHOD)
    shape = host_geometry(np.asarray(model.x).T, np.asarray(model.fluid_tets).T)
    blocks = step_blocks(DT, model, METHOD, shape)
    v, p = _field(1.0, 3, model.n_nodes), _field(1.0, model.n_nodes)
    zero = Unknowns(jnp.zeros_like(v), jnp.zeros_like(p))
    by_pressure = apply_elements(tangent, zero._replace(p=p), model, step, METHOD)
    by_velocity = apply_elements(tangent, zero._replace(u=v), model, step, METHOD)
    wet, free = np.asarray(model.in_fluid), ~np.asarray(model.prescribed)
    G = np.stack([block @ np.asarray(p) for block in blocks.G])
    _close(np.asarray(by_pressure.u)[:, free], G[:, free])
    _close(np.asarray(by_pressure.p)[wet], (blocks.C @ np.asarray(p))[wet])
    D = sum(block @ np.asarray(u) for block, u in zip(blocks.D, v, strict=True))
    _close(np.asarray(by_velocity.p)[wet], D[wet])
    blood = wet & ~np.asarray(model.in_solid)
    diagonal = np.stack(blood_diagonal(tangent.blood, model, step.fluid_shape), axis=1)
    _close(diagonal[blood], blocks.diagonal[blood])
