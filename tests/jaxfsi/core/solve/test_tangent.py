"""Products of a step against the derivative of its equations; the transposed preconditioner."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.core.laws.fluid import Blood, fluid_residual, lagged_coefficients
from jaxfsi.core.laws.materials import LinearElastic, NeoHookean
from jaxfsi.core.laws.mesh_motion import mesh_motion
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.laws.viscosity import CarreauYasuda, Newtonian
from jaxfsi.core.ports.block import BlockPort
from jaxfsi.core.ports.flow import FlowPort
from jaxfsi.core.ports.pressure import PressurePort
from jaxfsi.core.solve.blood_tangent import apply_blood, blood_diagonal, blood_tangent
from jaxfsi.core.solve.port_coupling import with_resistance
from jaxfsi.core.solve.preconditioner import (
    precondition,
    precondition_transposed,
    preconditioner,
    with_blood,
)
from jaxfsi.core.solve.tangent import (
    StepTangent,
    apply_elements,
    apply_elements_transposed,
    step_tangent,
)
from jaxfsi.core.step.equations import Unknowns, begin_step, midpoint, residual
from jaxfsi.core.step.generalized_alpha import generalized_alpha
from jaxfsi.core.step.model import build_model
from jaxfsi.core.step.state import initial_state
from jaxfsi.meshing import ring, tube
from lumped.blocks import RCR
from lumped.waveforms import Constant

DT = 1e-3
LONG_DT = 1e-2  # in which the flow crosses elements
METHOD = generalized_alpha(0.5)
BLOCK = BlockPort(RCR(R_proximal=200.0, C=1e-5, R_distal=2e3))
INLETS = {"pressure": PressurePort(Constant(1e4)), "flow": FlowPort(Constant(5.0))}


def _model(inlet, material, damping=0.0, wall_element="linear"):
    mesh = tube(
        radius=0.5, length=1.0, thickness=0.1, n_around=8, n_axial=4, n_layers=1,
        columns=wall_element == "bending",
    )  # fmt: skip
    # half of the wall: the other half has tetrahedra, as where columns fail
    mesh = dataclasses.replace(mesh, wedges=mesh.wedges[: len(mesh.wedges) // 2])
    wall = Wall(material, rho_s=1.1, damping=damping, support_stiffness=1e5, support_damping=30.0)
    blood = Blood(viscosity=CarreauYasuda())
    ports = {"inlet": inlet, "outlet": BLOCK}
    return build_model(mesh, ports, blood=blood, wall=wall, wall_element=wall_element)


def _random_state(model, *, d_wall: float):
    rng = np.random.default_rng(0)

    def field(size):
        return jnp.where(
            model.prescribed, 0.0, size * jnp.asarray(rng.standard_normal(model.x.shape))
        )

    # The wall moves by a small part of an element in a step.
    share = jnp.where(model.in_solid, 0.1, 1.0)
    state = initial_state(model, p=1e3)
    n = model.n_nodes
    return state._replace(
        u=share * field(20.0),
        u_before=share * field(20.0),
        a=field(1e3),
        d=jnp.where(model.in_solid, field(d_wall), 0.0),
        p=jnp.where(model.in_fluid, 1e4 * jnp.asarray(rng.standard_normal(n)), 0.0),
        Q_port=jnp.asarray([-3.0, 4.0]),
        P_port=jnp.asarray([1e4, 2e3]),
    )


@eqx.filter_jit
def _products(model, state, v, motion):
    """Change of the equations along v: by their derivative and by elements."""
    step = begin_step(jnp.asarray(DT), model, state, METHOD, motion)
    y = Unknowns(state.u, state.p)
    _, exact = jax.jvp(lambda y: residual(y, model, step, METHOD), (y,), (v,))
    lagged = _lagged(step_tangent(y, model, step, METHOD))
    return exact, apply_elements(lagged, v, model, step, METHOD)


def _lagged(tangent):
    """The tangent with the coefficients of the blood's equations held."""
    blood = tangent.blood
    none = jax.tree.map(jnp.zeros_like, (blood.reaction, blood.coefficients))
    blood = blood._replace(reaction=none[0], coefficients=none[1])
    return tangent._replace(blood=blood)


def _relative_difference(model, state, seed: int) -> float:
    rng = np.random.default_rng(seed)
    v = Unknowns(
        jnp.asarray(rng.standard_normal(model.x.shape)),
        100.0 * jnp.asarray(rng.standard_normal(model.n_nodes)),
    )
    exact, found = _products(model, state, v, mesh_motion(model))
    return max(
        float(jnp.linalg.norm(f - e) / jnp.linalg.norm(e))
        for f, e in zip(found, exact, strict=True)
    )


WALLS = {
    "Hooke": {"material": LinearElastic(3e6, 0.45)},
    "neo-Hookean": {"material": NeoHookean(3e6, 0.45), "damping": 50.0},
    "quadratic, Hooke": {"material": LinearElastic(3e6, 0.45), "wall_element": "quadratic"},
    "quadratic": {
        "material": NeoHookean(3e6, 0.45),
        "damping": 50.0,
        "wall_element": "quadratic",
    },
}


@pytest.mark.parametrize(
    ("inlet", "wall", "d_wall", "tolerance"),
    [
        # Round-off; λ goes through E and ν, which loses 1/(1 − 2ν) of it.
        pytest.param("flow", "Hooke", 5e-4, 1e-11, marks=pytest.mark.slow),
        ("pressure", "neo-Hookean", 5e-4, 1e-11),
        # Hooke's law has one tangent, so that elements that bend are exact too.
        pytest.param("pressure", "quadratic, Hooke", 5e-4, 1e-11, marks=pytest.mark.slow),
        # Others are linearised about the mean deformation of an element: 2 % at strains of 1e-2.
        pytest.param("pressure", "quadratic", 1e-4, 0.05, marks=pytest.mark.slow),
    ],
)
def test_products_are_the_derivative_of_the_equations(inlet, wall, d_wall, tolerance):
    model = _model(INLETS[inlet], **WALLS[wall])
    state = _random_state(model, d_wall=d_wall)
    assert _relative_difference(model, state, 1) < tolerance


@eqx.filter_jit
def _blood_products(model, state, v, u_mesh):
    """Change of the blood's equations and of their coefficients along v, in three ways.

    By their derivative, by elements, and by elements with the coefficients held.
    """
    step = begin_step(jnp.asarray(LONG_DT), model, state, METHOD, None)
    y, tets, shape = Unknowns(state.u, state.p), model.fluid_tets, step.fluid_shape

    def coefficients(y):
        u, a, _, p = midpoint(y, step, METHOD)
        return lagged_coefficients(step.dt, u, a, p, u_mesh(u), model.blood, tets, shape)

    def equations(y):
        u, a, _, p = midpoint(y, step, METHOD)
        return Unknowns(*fluid_residual(u, a, p, model.blood, coefficients(y), tets, shape))

    _, exact = jax.jvp(equations, (y,), (v,))
    u, a, _, _ = midpoint(y, step, METHOD)
    tangent = blood_tangent(u, a, model, step._replace(coefficients=coefficients(y)), METHOD)
    held = _lagged(StepTangent(tangent, None, None)).blood
    return exact, *(apply_blood(t, v, model, shape) for t in (tangent, held))


@pytest.mark.parametrize(
    ("u_mesh", "tolerance"),
    [
        # Relative to the mesh the blood moves as one; what changes, changes everywhere.
        ("the blood's but for 80 cm/s", 1e-11),
        # τ changes with the mean velocity of an element, and its change meets the mean residual:
        # that leaves out a part where the velocity varies as much as between random corners.
        ("none", 0.06),
    ],
)
def test_tangent_knows_the_change_of_the_coefficients(u_mesh, tolerance):
    model = eqx.tree_at(lambda m: m.blood.viscosity, _part("rigid"), Newtonian())
    state = _random_state(model, d_wall=0.0)
    rng = np.random.default_rng(2)
    v = Unknowns(
        jnp.asarray(rng.standard_normal(model.x.shape)),
        100.0 * jnp.asarray(rng.standard_normal(model.n_nodes)),
    )
    apart = jnp.asarray([[50.0], [-60.0], [20.0]])

    def moving(u):
        return jax.lax.stop_gradient(u) - apart if u_mesh != "none" else jnp.zeros_like(u)

    exact, found, held = _blood_products(model, state, v, moving)
    for e, f, h in zip(exact, found, held, strict=True):
        added = float(jnp.linalg.norm(e - h))
        assert added > 0.05 * float(jnp.linalg.norm(e))
        assert float(jnp.linalg.norm(e - f)) < tolerance * added


def test_tangent_of_blood_without_viscosity_at_rest_is_finite():
    model = eqx.tree_at(lambda m: m.blood.viscosity, _part("rigid"), Newtonian(0.0))
    state = initial_state(model)
    step = begin_step(jnp.asarray(DT), model, state, METHOD, None)
    tangent = step_tangent(Unknowns(state.u, state.p), model, step, METHOD)
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(tangent))


def _part(kind: str):
    """The coupled model, its blood alone or its wall alone."""
    material = NeoHookean(3e6, 0.45)
    if kind in ("linear", "quadratic", "bending"):
        return _model(INLETS["pressure"], material, damping=50.0, wall_element=kind)
    sizes = {"radius": 0.5, "length": 1.0, "thickness": 0.1, "n_around": 8, "n_axial": 4}
    if kind == "dry":
        wall = Wall(material, rho_s=1.1)
        return build_model(ring(n_layers=1, **sizes), {}, wall=wall, wall_element="linear")
    return build_model(tube(n_layers=0, **sizes), {"inlet": INLETS["pressure"], "outlet": BLOCK})


def test_diagonal_in_the_blood_is_that_of_the_tangent():
    """Against products with unit velocities, with nothing carried; the wall keeps its own."""
    model = _model(INLETS["pressure"], NeoHookean(3e6, 0.45))
    state = _random_state(model, d_wall=1e-4)
    step = begin_step(jnp.asarray(DT), model, state, METHOD, mesh_motion(model))
    tangent = _lagged(step_tangent(Unknowns(state.u, state.p), model, step, METHOD))
    known = preconditioner(DT, model, METHOD, dtype=np.float64)
    inverse = with_blood(
        known, blood_diagonal(tangent.blood, model, step.fluid_shape), tangent.blood.A, step.Z
    ).inverse_diagonal
    free = np.flatnonzero(np.asarray(~model.in_solid & ~model.prescribed))
    at_ports = np.unique(np.concatenate([np.asarray(faces) for faces in model.port_faces], axis=1))
    inside = np.setdiff1d(free, at_ports)  # the blocks behind the ports have their own share

    @jax.jit
    def entry(i, node):
        v = Unknowns(jnp.zeros_like(state.u).at[i, node].set(1.0), jnp.zeros_like(state.p))
        return apply_elements(tangent, v, model, step, METHOD).u[i, node]

    for node in inside[::5]:
        for i in range(3):
            assert float(inverse[i, node]) == pytest.approx(1.0 / float(entry(i, node)), rel=1e-11)
    others = np.setdiff1d(np.arange(model.n_nodes), free)
    assert jnp.array_equal(inverse[:, others], known.inverse_diagonal[:, others])


@pytest.mark.parametrize(
    "kind",
    # the quadratic wall's own part is quick in test_wall_factor.py
    ["linear", pytest.param("quadratic", marks=pytest.mark.slow), "rigid", "dry"],
)
def test_transposed_preconditioner_is_the_transpose(kind):
    """With resistance behind the outlet, and blood that flow carries across elements."""
    model = _part(kind)
    M = preconditioner(DT, model, METHOD, dtype=np.float64)
    rng = np.random.default_rng(3)
    if M.ports is not None:
        Z = jnp.asarray([1e5 if k in M.ports.port else 0.0 for k in range(len(model.ports))])
        N = rng.standard_normal(M.relaxation.N.shape) * 0.1 / np.max(M.inverse_diagonal)
        carried = dataclasses.replace(M.relaxation, N=jnp.asarray(N), crosses=jnp.asarray(True))
        ports = with_resistance(M.ports, Z, M.inverse_diagonal)
        M = dataclasses.replace(M, ports=ports, relaxation=carried)
    u, v = (jnp.asarray(rng.standard_normal(model.x.shape)) for _ in range(2))
    p, q = (jnp.asarray(rng.standard_normal(model.n_nodes)) for _ in range(2))
    assert (M.ports is None) == (kind == "dry")
    z_u, z_p = precondition(M, u, p)
    w_u, w_p = precondition_transposed(M, v, q)
    forward = float(jnp.sum(v * z_u) + jnp.sum(q * z_p))
    backward = float(jnp.sum(u * w_u) + jnp.sum(p * w_p))
    assert forward == pytest.approx(backward, rel=1e-9)


@eqx.filter_jit
def _there_and_back(model, state, v, w, motion):
    """⟨w, A v⟩ and ⟨Aᵀ w, v⟩ with the tangent A of a state."""
    step = begin_step(jnp.asarray(DT), model, state, METHOD, motion)
    tangent = step_tangent(Unknowns(state.u, state.p), model, step, METHOD)
    there = apply_elements(tangent, v, model, step, METHOD)
    back = apply_elements_transposed(tangent, w, model, step, METHOD)
    return (
        jnp.sum(w.u * there.u) + jnp.sum(w.p * there.p),
        jnp.sum(back.u * v.u) + jnp.sum(back.p * v.p),
    )


@pytest.mark.parametrize(
    "kind",
    ["linear", *(pytest.param(k, marks=pytest.mark.slow) for k in ("bending", "quadratic"))],
)
def test_transposed_product_is_the_transpose(kind):
    model = _part(kind)
    state = _random_state(model, d_wall=1e-4)
    rng = np.random.default_rng(5)

    def pair() -> Unknowns:
        u, p = rng.standard_normal(model.x.shape), rng.standard_normal(model.n_nodes)
        return Unknowns(jnp.asarray(u), 100.0 * jnp.asarray(p))

    motion = mesh_motion(model) if model.moves_mesh else None
    forward, backward = _there_and_back(model, state, pair(), pair(), motion)
    # entries of either sign cancel in the sums to about a thousandth
    assert float(forward) == pytest.approx(float(backward), rel=1e-10)


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
