import numpy as np
import pytest

from jaxfsi.anatomy import Opening
from jaxfsi.faces import region_faces
from jaxfsi.mesh import Mesh, Region
from jaxfsi.mesh_checks import check_mesh
from jaxfsi.meshing import bent, find_openings, label_faces, tube
from jaxfsi.meshing.labels import complete_labels, outward

UP = np.array([0.0, 0.0, 1.0])
INLET = Opening("inlet", 0.0 * UP, -UP, 0.7)
OUTLET = Opening("outlet", 2.0 * UP, UP, 0.7)


@pytest.fixture(scope="module")
def walled() -> Mesh:
    return tube(radius=0.5, length=2.0, thickness=0.1, n_around=12, n_axial=6, n_layers=2)


@pytest.fixture(scope="module")
def bare() -> Mesh:
    return tube(radius=0.5, length=2.0, thickness=0.1, n_around=12, n_axial=6, n_layers=0)


def relabelled(mesh: Mesh, *openings: Opening) -> Mesh:
    return label_faces(mesh.points, mesh.tets, mesh.region, openings)


def test_every_boundary_face_gets_the_label_of_its_place(walled):
    mesh = relabelled(walled, INLET, OUTLET)
    check_mesh(mesh)
    assert mesh.label_names == (
        "inlet",
        "outlet",
        "interface",
        "outer_wall",
        "inlet_ring",
        "outlet_ring",
    )
    radius = np.linalg.norm(mesh.points[:, :2], axis=1)
    # Nodes are placed on the radii to round-off.
    np.testing.assert_allclose(radius[mesh.labelled("interface")], 0.5, rtol=1e-12)
    np.testing.assert_allclose(radius[mesh.labelled("outer_wall")], 0.6, rtol=1e-12)
    assert np.all(mesh.points[mesh.labelled("inlet_ring")][:, :, 2] == 0.0)
    assert np.all(radius[mesh.labelled("outlet_ring")] >= 0.5 - 1e-12)


def test_blood_alone_has_its_wall_as_interface(bare):
    mesh = relabelled(bare, INLET, OUTLET)
    check_mesh(mesh)
    assert mesh.label_names == ("inlet", "outlet", "interface")


@pytest.mark.parametrize(
    ("openings", "message"),
    [
        ((INLET,), "lie neither in an opening nor on the wall"),
        ((INLET, OUTLET._replace(centre=1.9 * UP)), "no blood face lies in the plane"),
        ((INLET, OUTLET._replace(normal=-UP)), "no blood face lies in the plane"),
        ((INLET, OUTLET._replace(radius=0.52)), "no cut wall round it"),
        ((INLET, OUTLET._replace(radius=0.57)), "ball of the opening 'outlet'"),
        ((INLET, OUTLET._replace(radius=0.3)), "ball of the opening 'outlet'"),
        ((INLET, INLET), "its own name"),
        ((INLET, OUTLET._replace(name="interface")), "its own name"),
        ((INLET, OUTLET._replace(name="out_ring")), "its own name"),
    ],
)
def test_openings_that_do_not_fit_are_refused(walled, openings, message):
    with pytest.raises(ValueError, match=message):
        relabelled(walled, *openings)


def test_openings_are_found_where_a_wall_surrounds_the_blood():
    mesh = tube(
        radius=0.3,
        length=1.5,
        thickness=0.1,
        n_around=12,
        n_axial=9,
        mapping=bent(bend_radius=1.0),
    )
    openings = find_openings(mesh.points, mesh.tets, mesh.region)
    assert [opening.name for opening in openings] == ["opening_1", "opening_2"]
    found = relabelled(mesh, *openings)
    check_mesh(found)
    counts = sorted(len(found.labelled(f"{o.name}_ring")) for o in openings)
    assert counts == sorted(len(mesh.labelled(f"{name}_ring")) for name in mesh.openings)
    (end,) = (o for o in openings if abs(o.centre[2]) > 0.1)
    # The cut plane at the end of the bend is turned by length / radius.
    np.testing.assert_allclose(end.normal, [np.sin(1.5), 0.0, np.cos(1.5)], atol=1e-12)


def test_openings_of_blood_alone_must_be_given(bare):
    with pytest.raises(ValueError, match="Give the openings instead"):
        find_openings(bare.points, bare.tets, bare.region)


def test_walls_without_a_name_are_completed(walled, bare):
    caps = {name: walled.labelled(name)[:, ::-1] for name in ("inlet", "outlet")}
    mesh = complete_labels(walled.points, walled.tets, walled.region, caps)
    check_mesh(mesh)
    for name in walled.label_names:
        assert len(mesh.labelled(name)) == len(walled.labelled(name))
    caps = {name: bare.labelled(name) for name in ("inlet", "outlet")}
    alone = complete_labels(bare.points, bare.tets, bare.region, caps)
    check_mesh(alone)
    assert len(alone.labelled("interface")) == len(bare.labelled("interface"))


def test_missing_caps_and_inner_triangles_are_refused(walled):
    with pytest.raises(ValueError, match="Name every opening"):
        complete_labels(
            walled.points, walled.tets, walled.region, {"inlet": walled.labelled("inlet")}
        )
    axis = np.array([[0, 1, 2]]) + len(walled.points) // 2
    with pytest.raises(ValueError, match="no faces of the boundary"):
        outward(axis, walled.tets, walled.region)


def test_interface_is_the_same_set_of_triangles_in_both_regions(walled):
    bounds = region_faces(walled.tets, walled.region)
    keys = {tuple(sorted(face)) for face in bounds.interface}
    for region in Region:
        alone = region_faces(
            walled.tets_of(region), np.zeros(np.sum(walled.region == region), dtype=int)
        )
        assert keys <= {tuple(sorted(face)) for face in alone.fluid}
