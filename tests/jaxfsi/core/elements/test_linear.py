"""Linear tetrahedra: exact for linear fields, closed surfaces close."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.core.elements.assembly import assembled, host_geometry, isotropic_stiffness, stiffness
from jaxfsi.core.elements.linear import area_vectors, face_load, flux, geometry, gradient, scatter
from jaxfsi.mesh import Mesh
from jaxfsi.meshing import tube


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    """A crooked tube, so that no element has a right angle."""

    def bend(points):
        x, y, z = points.T
        return np.stack([x + 0.2 * z**2, y + 0.1 * np.sin(2.0 * z), z + 0.15 * x * y], axis=1)

    return tube(
        radius=0.5, length=1.0, thickness=0.1, n_around=8, n_axial=4, n_layers=0, mapping=bend
    )


@pytest.fixture(scope="module")
def x(mesh):
    return jnp.asarray(mesh.points.T)


@pytest.fixture(scope="module")
def tets(mesh):
    return jnp.asarray(mesh.tets.T)


def test_gradient_of_a_linear_field_is_exact(x, tets):
    slope = np.asarray([1.3, -0.7, 2.1])
    f = jnp.asarray(slope) @ x + 4.0
    for found, expected in zip(gradient(tuple(f[tets]), geometry(x, tets)), slope, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-11)


def test_gradients_of_the_shape_functions_are_dual_to_the_edges(x, tets):
    shape = geometry(x, tets)
    corner = x[:, tets]
    product = jnp.einsum("jat,jbt->abt", jnp.asarray(shape.grad), corner)
    identity = product - product[:, :1]
    expected = np.eye(4)[:, :, None] - np.eye(4)[:, :1, None]
    np.testing.assert_allclose(identity, np.broadcast_to(expected, identity.shape), atol=1e-12)


def test_host_and_device_geometry_agree(mesh, x, tets):
    host, device = host_geometry(mesh.points, mesh.tets), geometry(x, tets)
    np.testing.assert_allclose(host.volume, device.volume, rtol=1e-12)
    np.testing.assert_allclose(
        np.moveaxis(host.grad, 0, 2), np.swapaxes(np.asarray(device.grad), 0, 1), 1e-9, 1e-12
    )


def test_divergence_theorem_holds_for_linear_fields(mesh, x, tets):
    matrix = jnp.asarray([[1.0, 2.0, 0.5], [0.3, -0.4, 1.1], [0.2, 0.6, 0.9]])
    u = matrix @ x
    volume = float(jnp.sum(geometry(x, tets).volume))
    through = float(flux(u, x, jnp.asarray(mesh.faces.T)))
    # The labelled faces of a mesh without wall are its whole boundary.
    assert through == pytest.approx(float(jnp.trace(matrix)) * volume, rel=1e-12)


def test_area_vectors_of_a_closed_surface_sum_to_zero(mesh, x):
    total = jnp.sum(area_vectors(x, jnp.asarray(mesh.faces.T)), axis=1)
    np.testing.assert_allclose(total, 0.0, atol=1e-14)


def test_face_load_keeps_force_and_moment_of_a_uniform_pressure(mesh, x):
    faces = jnp.asarray(mesh.faces.T)
    area = area_vectors(x, faces)
    load = face_load(area, faces, x.shape[1])
    np.testing.assert_allclose(jnp.sum(load, axis=1), 0.0, atol=1e-14)
    # Forces act at the centres of flat faces, so that the moments about any point agree.
    centre = jnp.mean(x[:, faces], axis=1)
    np.testing.assert_allclose(
        jnp.sum(jnp.cross(x, load, axis=0), axis=1),
        jnp.sum(jnp.cross(centre, area, axis=0), axis=1),
        atol=1e-13,
    )


def test_scatter_sums_each_corner_once(tets, x):
    ones = jnp.ones(tets.shape)
    count = np.bincount(np.asarray(tets).ravel(), minlength=x.shape[1])
    np.testing.assert_array_equal(scatter(tuple(ones), tets, x.shape[1]), count)


def test_stiffness_of_linear_fields_is_their_energy(mesh):
    shape = host_geometry(mesh.points, mesh.tets)
    slope = np.asarray([0.4, -1.2, 0.8])
    matrix = assembled(mesh.tets, stiffness(shape, np.full(len(mesh.tets), 2.0)), len(mesh.points))
    f = mesh.points @ slope
    assert f @ (matrix @ f) == pytest.approx(2.0 * slope @ slope * np.sum(shape.volume), rel=1e-12)


def test_elastic_stiffness_of_rigid_motions_vanishes(mesh):
    shape = host_geometry(mesh.points, mesh.tets)
    n = len(mesh.tets)
    element = isotropic_stiffness(shape, np.full(n, 3.0), np.full(n, 2.0))
    turn = np.cross([0.3, -0.5, 0.7], mesh.points)[mesh.tets]
    force = np.einsum("eaibj,ebj->eai", element, turn)
    np.testing.assert_allclose(force, 0.0, atol=1e-12 * np.max(np.abs(element)))
