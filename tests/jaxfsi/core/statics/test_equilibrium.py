"""Equilibria of the wall: bending, Lamé's tube, derivatives, prestress, failure."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.core.laws.materials import LinearElastic, NeoHookean
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.laws.wall_balance import wall_geometry, wall_residual
from jaxfsi.core.statics.equilibrium import (
    RESULTS,
    equilibrium,
    small_equilibrium,
    static_factor,
)
from jaxfsi.core.statics.loads import Loads, load_forces, pressure_load
from jaxfsi.core.statics.prestress import prestressed
from jaxfsi.core.step.march import march
from jaxfsi.core.step.model import build_model
from jaxfsi.core.step.state import initial_state
from jaxfsi.core.step.stepper import prepare
from jaxfsi.mesh import INTERFACE
from jaxfsi.meshing import ring
from jaxfsi.verification import (
    STRIP_WORK,
    axial_strain,
    clamped_strip,
    lame_displacement,
    radial_displacement,
    thick_tube,
    work,
)


@pytest.mark.slow  # compiles the quadratic kernels and their derivatives
@pytest.mark.parametrize("nu", [0.3, 0.49])
def test_one_layer_of_quadratic_elements_bends(nu):
    problem = clamped_strip(nu, "quadratic")
    end = equilibrium(problem.model, problem.loads, static_factor(problem.model))
    # The aim for the meshes of vessels: one layer, elements as long as it is thick.
    assert work(problem, end.d) == pytest.approx(STRIP_WORK[nu], rel=0.05)


def test_linear_elements_hardly_bend():
    problem = clamped_strip(0.3, "linear")
    end = equilibrium(problem.model, problem.loads, static_factor(problem.model))
    assert work(problem, end.d) < 0.3 * STRIP_WORK[0.3]


@pytest.mark.slow
def test_tube_under_pressure_widens_as_lame_says():
    problem = thick_tube(0.49, "quadratic", n_axial=12)
    end = equilibrium(problem.model, problem.loads, static_factor(problem.model))
    strain = axial_strain(problem.mesh, end.d, 1.0, 0.4)
    for radius in (0.5, 0.55, 0.6):
        exact = lame_displacement(radius, 0.5, 0.6, 1e-4, 1.0, 0.49, strain)
        # A polygon of 32 sides has 0.6 % less area than its circle.
        assert radial_displacement(problem, end.d, radius, 1.0) == pytest.approx(exact, rel=0.01)


@pytest.fixture(scope="module")
def vessel():
    """A short vessel of linear elements under 100 mmHg, its loads and its factor."""
    mesh = ring(radius=0.2, length=0.4, thickness=0.04, n_around=12, n_axial=4, n_layers=1)
    wall = Wall(NeoHookean(3e6, 0.49), support_stiffness=1e5)
    model = build_model(mesh, {}, wall=wall)
    loads = Loads((pressure_load(mesh, INTERFACE, 1.333e5, model),))
    return model, loads, static_factor(model)


def test_equilibrium_of_a_large_deformation_is_found_and_differentiated(vessel):
    model, loads, factor = vessel

    def widened(E):
        softer = eqx.tree_at(lambda m: m.wall.material.E, model, E)
        end = equilibrium(softer, loads, factor, throw=False, tolerance=1e-11)
        return jnp.sum(end.d**2)

    both = jax.jit(jax.value_and_grad(widened))  # one program for all three
    E = jnp.asarray(3e6)
    value, slope = both(E)
    assert float(jnp.sqrt(value)) > 1e-2
    step = 1e3
    central = (both(E + step)[0] - both(E - step)[0]) / (2.0 * step)
    # Differences lose half the digits of an equilibrium found to 1e-11.
    assert float(slope) == pytest.approx(float(central), rel=1e-5)


def test_prestressed_wall_carries_its_pressure_undeformed(vessel):
    model, loads, factor = vessel
    found = prestressed(model, loads, factor)
    left = equilibrium(found.model, loads, factor, tolerance=1e-7).d
    assert float(jnp.max(jnp.abs(left))) < 1e-8 * 0.2
    assert found.model.prestress is not None
    hoop = float(jnp.mean(jnp.trace(found.model.prestress)))
    assert hoop > 1.333e5


@pytest.fixture(scope="module", params=[NeoHookean, LinearElastic])
def wedges(request):
    """A short vessel of wedges that carries its pressure undeformed, its loads and its factor."""
    mesh = ring(
        radius=0.2, length=0.4, thickness=0.04, n_around=12, n_axial=4, n_layers=1, columns=True
    )
    wall = Wall(request.param(3e6, 0.49), support_stiffness=1e5)
    model = build_model(mesh, {}, wall=wall, wall_element="bending")
    loads = Loads((pressure_load(mesh, INTERFACE, 1.333e5, model),))
    factor = static_factor(model)
    return prestressed(model, loads, factor).model, loads, factor


def test_prestressed_wedges_carry_their_pressure_undeformed(wedges):
    """Also what keeps their thickness even: it has a part on triangles that the pressure bends."""
    model, loads, _ = wedges

    @eqx.filter_jit
    def forces(model, loads):
        zero, shape = jnp.zeros_like(model.x), wall_geometry(model.x, model.element)
        r = wall_residual(zero, zero, zero, model.wall, model.element, shape, model.prestress)
        load = load_forces(loads, zero, model)
        free = model.in_solid & ~model.prescribed
        return jnp.where(free, r - load, 0.0), jnp.where(free, load, 0.0)

    left, load = forces(model, loads)
    # The prestress is found to 1e-7 of the loads.
    assert float(jnp.linalg.norm(left)) < 1.01e-7 * float(jnp.linalg.norm(load))
    assert float(jnp.max(jnp.abs(model.prestress.columns))) > 1e-2 * 1.333e5


@pytest.mark.slow  # the same claim by the search for an equilibrium, which takes long to compile
def test_prestressed_wedges_are_in_equilibrium_undeformed(wedges):
    model, loads, factor = wedges
    left = equilibrium(model, loads, factor, tolerance=1e-7).d
    # Both equilibria are found to 1e-7 of the loads.
    assert float(jnp.max(jnp.abs(left))) < 1e-7 * 0.2


def test_a_wall_alone_marches_without_ports(vessel):
    model, _, _ = vessel
    end = march(model, initial_state(model), prepare(1e-4, model), 2)
    assert end.history.P_port.shape == (2, 0)
    assert float(jnp.max(jnp.abs(end.state.d))) == 0.0


def test_failure_is_reported_with_a_cure(vessel):
    model, loads, factor = vessel
    options = {"max_systems": 1, "tolerance": 1e-11}
    end = equilibrium(model, loads, factor, throw=False, **options)
    assert end.result == RESULTS.not_converged
    with pytest.raises(RuntimeError, match="more steps"):
        equilibrium(model, loads, factor, **options)


@pytest.mark.slow
def test_derivatives_that_were_not_solved_for_are_no_numbers(vessel):
    model, loads, factor = vessel

    def widened(E, max_iterations):
        softer = eqx.tree_at(lambda m: m.wall.material.E, model, E)
        return jnp.sum(
            equilibrium(softer, loads, factor, max_iterations=max_iterations, max_systems=60).d
        )

    value, slope = jax.value_and_grad(widened)(jnp.asarray(3e6), 4)
    assert jnp.isfinite(value)
    assert jnp.isnan(slope)


def test_derivatives_of_one_linear_system_that_was_not_solved_are_no_numbers(vessel):
    model, loads, factor = vessel
    hooke = eqx.tree_at(lambda m: m.wall.material, model, LinearElastic(3e6, 0.49))
    force = load_forces(loads, jnp.zeros_like(model.x), model)

    def widened(scale, max_iterations):
        # the factor is that of the wall; the law is stiffer, and so is the tissue outside
        stiffer = eqx.tree_at(lambda m: m.wall.support_stiffness, hooke, 1e7 * scale)
        options = {"max_starts": 1, "max_iterations": max_iterations, "throw": False}
        return jnp.sum(small_equilibrium(stiffer, scale * force, factor, **options).d)

    value, slope = jax.value_and_grad(widened)(jnp.asarray(1.0), 2)
    assert jnp.isfinite(value)
    assert jnp.isnan(slope)
    value, slope = jax.value_and_grad(widened)(jnp.asarray(1.0), 100)
    step = 1e-3
    central = (widened(1.0 + step, 100) - widened(1.0 - step, 100)) / (2.0 * step)
    # differences of what is found to 1e-9, truncated at 1e-6
    assert float(slope) == pytest.approx(float(central), rel=1e-4)


@pytest.mark.parametrize("columns", [True, False])
def test_a_wall_that_nothing_holds_is_refused(columns):
    mesh = ring(
        radius=0.2, length=0.4, thickness=0.04, n_around=12, n_axial=4, n_layers=1, columns=columns
    )

    def model(stiffness=0.0, clamped=()):
        wall = Wall(NeoHookean(3e6, 0.49), support_stiffness=stiffness)
        return build_model(mesh, {}, wall=wall, clamped=clamped)

    with pytest.raises(ValueError, match=r"nothing holds 1 part.*Clamp a ring.*support_stiffness"):
        static_factor(model())
    assert static_factor(model(stiffness=1e3)).nodes.size == mesh.points.shape[0]
    assert static_factor(model(clamped=mesh.label_names[-1:])).nodes.size
    # a line of nodes leaves the turn about itself
    held = jnp.zeros(mesh.points.shape[0], bool).at[jnp.asarray(_in_line(mesh))].set(True)
    free = model()
    held = jnp.concatenate([held, free.prescribed[held.size :]])
    with pytest.raises(ValueError, match="nothing holds"):
        static_factor(eqx.tree_at(lambda m: m.prescribed, free, held))


def _in_line(mesh):
    """Nodes of the mesh on one line along its axis."""
    radius, angle = np.hypot(*mesh.points[:, :2].T), np.arctan2(*mesh.points[:, :2].T)
    return np.flatnonzero((np.abs(radius - 0.2) < 1e-9) & (np.abs(angle - angle[0]) < 1e-9))


def test_a_model_without_a_wall_is_refused(vessel):
    model, loads, factor = vessel
    blood = eqx.tree_at(lambda m: m.wall, model, None, is_leaf=lambda x: x is None)
    mesh = ring(radius=0.2, length=0.4, thickness=0.04, n_around=12, n_axial=4, n_layers=1)
    for call in (
        lambda: equilibrium(blood, loads, factor),
        lambda: pressure_load(mesh, INTERFACE, 1.0, blood),
        lambda: static_factor(blood),
    ):
        with pytest.raises(ValueError, match="no wall"):
            call()


def test_loads_that_are_not_on_the_wall_are_refused(vessel):
    model, _, _ = vessel
    other = ring(radius=0.3, length=0.4, thickness=0.04, n_around=10, n_axial=4, n_layers=1)
    with pytest.raises(ValueError, match="not all faces of the wall"):
        pressure_load(other, INTERFACE, 1.0, model)
