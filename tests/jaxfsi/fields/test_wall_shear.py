"""Wall shear from velocities: exact fields, tubes with even and uneven nodes, derivatives."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.core.laws.fluid import Blood
from jaxfsi.core.laws.viscosity import Newtonian
from jaxfsi.fields import wall_gradient, wall_normals, wall_patches, wall_shear
from jaxfsi.mesh import Region, tet_volumes
from jaxfsi.meshing import tube

BLOOD = Blood(viscosity=Newtonian(0.04))
RADIUS, LENGTH, PEAK = 0.5, 2.0, 20.0
EXACT = 2.0 * 0.04 * PEAK / RADIUS  # μ ∂u/∂r of u = PEAK (1 − r²/R²)


def _uneven(mesh, amount=0.25, seed=0):
    """Nodes moved at random by a share of an edge; those of the wall stay on it."""
    rng = np.random.default_rng(seed)
    x = mesh.points
    edge = np.median(np.linalg.norm(x[mesh.tets[:, 0]] - x[mesh.tets[:, 1]], axis=1))
    move = amount * edge * rng.uniform(-1.0, 1.0, x.shape)
    move[(x[:, 2] < 1e-9) | (x[:, 2] > LENGTH - 1e-9), 2] = 0.0
    r = np.hypot(x[:, 0], x[:, 1])
    on_wall = r > RADIUS * (1.0 - 1e-9)
    moved = x + move
    moved[on_wall, :2] *= (RADIUS / np.hypot(*moved[on_wall, :2].T))[:, None]
    low = 0.1 * tet_volumes(x, mesh.tets)
    for _ in range(20):
        bad = np.unique(mesh.tets[tet_volumes(moved, mesh.tets) < low])
        moved[bad] = x[bad]
    return dataclasses.replace(mesh, points=moved)


@pytest.fixture(scope="module", params=["even", "uneven"])
def pipe(request):
    mesh = tube(radius=RADIUS, length=LENGTH, thickness=0.0, n_around=20, n_axial=16, n_layers=0)
    return mesh if request.param == "even" else _uneven(mesh)


def _poiseuille(mesh):
    x = mesh.points
    u = PEAK * (1.0 - (x[:, 0] ** 2 + x[:, 1] ** 2) / RADIUS**2)
    return jnp.zeros((3, len(x))).at[2].set(u)


def test_gradient_of_a_quadratic_field_is_exact(pipe):
    x = jnp.asarray(pipe.points.T)
    patches = wall_patches(pipe)
    field = jnp.stack([x[0] * x[1] - 3.0 * x[2] ** 2, x[0] ** 2 + 2.0 * x[1], x[1] * x[2]])
    at = np.asarray(x[:, patches.nodes])
    zero = np.zeros(at.shape[1])
    expected = [
        [at[1], at[0], -6.0 * at[2]],
        [2.0 * at[0], zero + 2.0, zero],
        [zero, at[2], at[1]],
    ]
    # the ridge of 1e-9 on patches of condition 1e3
    np.testing.assert_allclose(wall_gradient(field, x, patches), expected, atol=1e-5)


def test_shear_of_poiseuille_flow(pipe):
    patches = wall_patches(pipe)
    x = jnp.asarray(pipe.points.T)
    tau = np.asarray(jax.jit(wall_shear)(_poiseuille(pipe), x, BLOOD, patches))
    size = np.linalg.norm(tau, axis=0)
    # exact nodal values: what is left is the tilt of the nodes' normals, about 0.1, squared
    np.testing.assert_allclose(size, EXACT, rtol=1.5e-2)
    np.testing.assert_allclose(tau[2], size, rtol=1.5e-2)  # along the flow


def test_normals_point_out_of_the_blood(pipe):
    patches = wall_patches(pipe)
    n = np.asarray(wall_normals(jnp.asarray(pipe.points.T), patches))
    radial = pipe.points[np.asarray(patches.nodes)].T * np.array([[1.0], [1.0], [0.0]]) / RADIUS
    # half the angle of a face, 2π/20
    assert np.min(np.sum(n * radial, axis=0)) > np.cos(0.3)


def test_shear_is_carried_by_a_rotation_and_ignores_rigid_motion(pipe):
    patches = wall_patches(pipe)
    x, u = jnp.asarray(pipe.points.T), _poiseuille(pipe)
    turn = jnp.asarray(np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0])
    turn = turn * jnp.sign(jnp.linalg.det(turn))
    spin = jnp.cross(jnp.asarray([3.0, -1.0, 2.0])[:, None], turn @ x, axis=0) + 5.0
    plain = wall_shear(u, x, BLOOD, patches)
    turned = wall_shear(turn @ u + spin, turn @ x, BLOOD, patches)
    # round-off through patches of condition 1e3, plus the ridge
    np.testing.assert_allclose(turned, turn @ plain, atol=1e-5 * EXACT)


def test_derivative_of_shear_agrees_with_central_differences(pipe):
    patches = wall_patches(pipe)
    x, u = jnp.asarray(pipe.points.T), _poiseuille(pipe)
    direction = jnp.asarray(np.random.default_rng(2).standard_normal(x.shape)) * 1e-2

    @jax.jit
    def total(s):
        return jnp.sum(wall_shear(u, x + s * direction, BLOOD, patches) ** 2)

    h = 1e-5
    expected = (total(h) - total(-h)) / (2.0 * h)
    # truncation h² and round-off/h
    np.testing.assert_allclose(jax.grad(total)(0.0), expected, rtol=1e-6)


def test_still_blood_has_no_shear_and_a_finite_derivative(pipe):
    patches = wall_patches(pipe)
    x = jnp.asarray(pipe.points.T)
    zero = jnp.zeros_like(x)
    assert np.all(np.asarray(wall_shear(zero, x, BLOOD, patches)) == 0.0)
    slope = jax.grad(lambda u: jnp.sum(wall_shear(u, x, BLOOD, patches)))(zero)
    assert np.all(np.isfinite(slope))


def test_mesh_without_blood_is_refused():
    mesh = tube(radius=0.5, length=1.0, thickness=0.1, n_around=6, n_axial=2, n_layers=1)
    dry = dataclasses.replace(mesh, region=np.full(len(mesh.tets), int(Region.SOLID)))
    with pytest.raises(ValueError, match="without blood"):
        wall_patches(dry)
