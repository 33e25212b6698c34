"""Products of a step against the derivative of its equations; the transposed preconditioner."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.core.equations import Unknowns, begin_step, residual
from jaxfsi.core.fluid import Blood
from jaxfsi.core.generalized_alpha import generalized_alpha
from jaxfsi.core.materials import LinearElastic, NeoHookean
from jaxfsi.core.mesh_motion import mesh_motion
from jaxfsi.core.model import build_model
from jaxfsi.core.operator import (
    apply_elements,
    apply_step,
    assemble_step,
    fluid_pattern,
    wall_stencil,
)
from jaxfsi.core.ports import BlockPort, FlowPort, PressurePort
from jaxfsi.core.preconditioner import precondition, precondition_transposed, preconditioner
from jaxfsi.core.solid import Wall
from jaxfsi.core.state import initial_state
from jaxfsi.core.viscosity import CarreauYasuda
from jaxfsi.meshing import ring, tube
from lumped.blocks import RCR
from lumped.waveforms import Constant

DT = 1e-3
METHOD = generalized_alpha(0.5)
BLOCK = BlockPort(RCR(R_proximal=200.0, C=1e-5, R_distal=2e3))
INLETS = {"pressure": PressurePort(Constant(1e4)), "flow": FlowPort(Constant(5.0))}


def _model(inlet, material, damping=0.0):
    mesh = tube(radius=0.5, length=1.0, thickness=0.1, n_around=8, n_axial=4, n_layers=1)
    wall = Wall(material, damping=damping, support_stiffness=1e5, support_damping=30.0)
    blood = Blood(viscosity=CarreauYasuda())
    return build_model(mesh, {"inlet": inlet, "outlet": BLOCK}, blood=blood, wall=wall)


def _random_state(model, *, d_wall: float, wall_moves: bool):
    rng = np.random.default_rng(0)

    fixed = model.held if wall_moves else model.held | model.in_solid

    def field(size, fixed=fixed):
        return jnp.where(fixed, 0.0, size * jnp.asarray(rng.standard_normal(model.x.shape)))

    state = initial_state(model, p=1e3)
    n = model.n_nodes
    return state._replace(
        u=field(20.0),
        u_before=field(20.0),
        a=field(1e3),
        d=jnp.where(model.in_solid, field(d_wall, model.held), 0.0),
        p=jnp.where(model.in_fluid, 1e4 * jnp.asarray(rng.standard_normal(n)), 0.0),
        Q_port=jnp.asarray([-3.0, 4.0]),
        P_port=jnp.asarray([1e4, 2e3]),
    )


@eqx.filter_jit
def _products(model, state, v, motion, fluid, wall):
    """Change of the equations along v: by their derivative, by stencils and by elements."""
    step = begin_step(jnp.asarray(DT), model, state, METHOD, motion)
    y = Unknowns(state.u, state.p)
    _, exact = jax.jvp(lambda y: residual(y, model, step, METHOD), (y,), (v,))
    operator = assemble_step(model, step, METHOD, fluid, wall)
    by_stencils = apply_step(operator, v, model, step, METHOD)
    return exact, by_stencils, apply_elements(v, model, step, METHOD, wall)


def _relative_difference(model, state, seed: int) -> float:
    rng = np.random.default_rng(seed)
    v = Unknowns(
        jnp.asarray(rng.standard_normal(model.x.shape)),
        100.0 * jnp.asarray(rng.standard_normal(model.n_nodes)),
    )
    exact, *found = _products(
        model, state, v, mesh_motion(model), fluid_pattern(model), wall_stencil(DT, model, METHOD)
    )
    return max(
        float(jnp.linalg.norm(f - e) / jnp.linalg.norm(e))
        for product in found
        for f, e in zip(product, exact, strict=True)
    )


@pytest.mark.parametrize("inlet", INLETS.values(), ids=INLETS)
def test_stencils_and_elements_are_the_derivative_of_the_equations(inlet):
    # The equations are linear in the unknowns with Hooke's law: round-off remains.
    model = _model(inlet, LinearElastic(3e6, 0.45))
    state = _random_state(model, d_wall=0.01, wall_moves=True)
    assert _relative_difference(model, state, 1) < 1e-12


def test_products_of_a_damped_wall_are_exact_at_its_reference():
    model = _model(INLETS["pressure"], NeoHookean(3e6, 0.45), damping=50.0)
    state = _random_state(model, d_wall=0.0, wall_moves=False)
    assert _relative_difference(model, state, 2) < 1e-12


def test_products_lag_by_the_strain_where_the_wall_is_deformed():
    model = _model(INLETS["pressure"], NeoHookean(3e6, 0.45), damping=50.0)
    gaps = [
        _relative_difference(model, _random_state(model, d_wall=d, wall_moves=False), 3)
        for d in (1e-5, 1e-4)
    ]
    # The strain is the displacement over an element of 0.1 cm.
    assert gaps[0] < 3e-4
    assert gaps[1] / gaps[0] == pytest.approx(10.0, rel=0.05)


def _part(kind: str):
    """The coupled model, its blood alone or its wall alone."""
    material = NeoHookean(3e6, 0.45)
    if kind == "coupled":
        return _model(INLETS["pressure"], material)
    sizes = {"radius": 0.5, "length": 1.0, "thickness": 0.1, "n_around": 8, "n_axial": 4}
    if kind == "dry":
        return build_model(ring(n_layers=1, **sizes), {}, wall=Wall(material))
    return build_model(tube(n_layers=0, **sizes), {"inlet": INLETS["pressure"], "outlet": BLOCK})


@pytest.mark.parametrize("kind", ["coupled", "rigid", "dry"])
def test_transposed_preconditioner_is_the_transpose(kind):
    model = _part(kind)
    M = preconditioner(DT, model, METHOD, dtype=np.float64)
    rng = np.random.default_rng(3)
    u, v = (jnp.asarray(rng.standard_normal(model.x.shape)) for _ in range(2))
    p, q = (jnp.asarray(rng.standard_normal(model.n_nodes)) for _ in range(2))
    z_u, z_p = precondition(M, u, p)
    w_u, w_p = precondition_transposed(M, v, q)
    forward = float(jnp.sum(v * z_u) + jnp.sum(q * z_p))
    backward = float(jnp.sum(u * w_u) + jnp.sum(p * w_p))
    assert forward == pytest.approx(backward, rel=1e-9)


def test_single_precision_changes_the_preconditioner_by_its_round_off():
    model = _model(INLETS["pressure"], NeoHookean(3e6, 0.45))
    rng = np.random.default_rng(4)
    u = jnp.asarray(rng.standard_normal(model.x.shape))
    p = jnp.asarray(rng.standard_normal(model.n_nodes))
    exact, single = (
        precondition(preconditioner(DT, model, METHOD, dtype=dtype), u, p)
        for dtype in (np.float64, np.float32)
    )
    for e, s in zip(exact, single, strict=True):
        # Condition numbers of the blocks are about 1e3; 6e-8 of round-off grows to 1e-4.
        assert float(jnp.linalg.norm(e - s)) < 1e-4 * float(jnp.linalg.norm(e))
