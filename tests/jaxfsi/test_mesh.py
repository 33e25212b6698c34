import dataclasses

import numpy as np
import pytest

from jaxfsi.faces import boundary_of, face_table, find_rows, region_faces, tet_edges, tet_neighbours
from jaxfsi.mesh import Mesh, Region, tet_volumes
from jaxfsi.mesh_checks import check_mesh
from jaxfsi.mesh_parts import reordered, scaled, submesh, used_nodes
from jaxfsi.meshing import strip, tube
from lumped.units import MM


@pytest.fixture(scope="module")
def small_tube() -> Mesh:
    return tube(radius=0.5, length=2.0, thickness=0.1, n_around=12, n_axial=6, n_layers=2)


def outline(mesh: Mesh) -> set[tuple[str, frozenset[tuple[float, ...]]]]:
    """Labelled faces as sets of coordinates, which no numbering enters."""
    return {
        (name, frozenset(map(tuple, mesh.points[face])))
        for name in mesh.label_names
        for face in mesh.labelled(name)
    }


def test_two_tetrahedra_share_one_face_and_have_nine_edges():
    tets = np.array([[0, 1, 2, 3], [1, 2, 3, 4]])
    table = face_table(tets)
    assert len(table.nodes) == 7
    assert np.sum(~table.on_boundary) == 1
    assert sorted(table.nodes[~table.on_boundary][0]) == [1, 2, 3]
    assert len(tet_edges(tets)) == 9
    assert sorted(tet_neighbours(tets).reshape(-1)) == [-1] * 6 + [0, 1]


def test_a_face_of_three_tetrahedra_is_refused():
    with pytest.raises(ValueError, match="three tetrahedra share"):
        face_table(np.array([[0, 1, 2, 3], [0, 1, 2, 4], [0, 1, 2, 5]]))


def test_rows_are_found_in_any_order():
    table = np.array([[4, 2, 9], [1, 7, 3]])
    found = find_rows(np.array([[9, 4, 2], [3, 1, 7], [1, 2, 3]]), table)
    assert found.tolist() == [1 - 1, 1, -1]
    assert find_rows(table, table[:0]).tolist() == [-1, -1]


@pytest.mark.parametrize("order", [1, -1])
def test_faces_point_out_of_their_region(small_tube, order):
    tets, region = small_tube.tets[::order], small_tube.region[::order]
    bounds = region_faces(tets, region)
    for faces, owner, kind in (
        (bounds.interface, bounds.interface_tets, Region.FLUID),
        (bounds.fluid, bounds.fluid_tets, Region.FLUID),
        (bounds.solid, bounds.solid_tets, Region.SOLID),
    ):
        assert np.all(region[owner] == kind)
        corners = small_tube.points[faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        # Each face has the centre of its own tetrahedron behind it.
        inside = small_tube.points[tets[owner]].mean(axis=1)
        assert np.all(np.sum(normal * (corners.mean(axis=1) - inside), axis=1) > 0.0)
    assert len(bounds.interface) == len(small_tube.labelled("interface"))


def test_renumbering_keeps_the_mesh_and_narrows_its_band(small_tube):
    shuffle = np.random.default_rng(0).permutation(len(small_tube.points))
    rank = np.argsort(shuffle)
    mixed = dataclasses.replace(
        small_tube,
        points=small_tube.points[shuffle],
        tets=rank[small_tube.tets],
        faces=rank[small_tube.faces],
    )
    ordered = reordered(mixed)
    check_mesh(ordered)
    assert outline(ordered) == outline(small_tube)
    assert np.all(np.diff(ordered.tets.min(axis=1)) >= 0)

    def bandwidth(mesh: Mesh) -> int:
        return int(np.max(np.ptp(tet_edges(mesh.tets), axis=1)))

    assert bandwidth(ordered) < 0.5 * bandwidth(mixed)
    # Ids tell where a node stood before.
    assert np.array_equal(mixed.points[ordered.ids - 1], ordered.points)


def test_regions_come_apart_with_their_faces_outwards(small_tube):
    parts = {region: submesh(small_tube, region) for region in Region}
    for region, part in parts.items():
        check_mesh(part.mesh)
        assert np.array_equal(part.mesh.points, small_tube.points[part.nodes])
        assert np.array_equal(part.nodes[part.mesh.tets], small_tube.tets[part.tets])
        assert len(part.mesh.faces) == len(boundary_of(small_tube.tets_of(region)))
    assert parts[Region.FLUID].mesh.label_names == ("inlet", "outlet", "interface")
    assert parts[Region.SOLID].mesh.openings == ()
    assert small_tube.openings == ("inlet", "outlet")


def test_a_region_that_is_not_there_is_refused():
    box = strip(length=1.0, width=0.5, thickness=0.1, n_length=2, n_width=1, n_layers=1)
    with pytest.raises(ValueError, match="no fluid tetrahedra"):
        submesh(box, Region.FLUID)


def test_millimetres_become_centimetres(small_tube):
    ratio = tet_volumes(scaled(small_tube, MM).points, small_tube.tets) / tet_volumes(
        small_tube.points, small_tube.tets
    )
    # Round-off of one product.
    np.testing.assert_allclose(ratio, 1e-3, rtol=1e-12)
    with pytest.raises(ValueError, match="positive factor"):
        scaled(small_tube, 0.0)


def test_used_nodes_are_distinct_and_rising():
    assert used_nodes(np.array([[5, 2, 2, 9]])).tolist() == [2, 5, 9]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: {"tets": m.tets + len(m.points)}, "nodes of tetrahedra run from"),
        (lambda m: {"faces": m.faces - len(m.points)}, "nodes of faces run from"),
        (lambda m: {"face_label": m.face_label + 6}, "labels of faces run from"),
        (lambda m: {"region": m.region + 1}, "neither 0"),
        (lambda m: {"label_names": ("inlet",) * 6}, "appear twice"),
        (lambda m: {"node_ids": np.zeros(len(m.points), dtype=int)}, "different node ids"),
        (lambda m: {"points": np.where(m.points > 1.9, np.nan, m.points)}, "not finite"),
        (lambda m: {"tets": m.tets[:0], "region": m.region[:0]}, "no tetrahedra"),
    ],
)
def test_arrays_that_do_not_belong_together_are_refused(small_tube, change, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(small_tube, **change(small_tube))


def inverted(mesh: Mesh) -> Mesh:
    tets = mesh.tets.copy()
    tets[7] = tets[7][[1, 0, 2, 3]]
    return dataclasses.replace(mesh, tets=tets)


def turned_face(mesh: Mesh) -> Mesh:
    faces = mesh.faces.copy()
    faces[3] = faces[3][::-1]
    return dataclasses.replace(mesh, faces=faces)


def unlabelled(mesh: Mesh) -> Mesh:
    return dataclasses.replace(mesh, faces=mesh.faces[1:], face_label=mesh.face_label[1:])


def labelled_twice(mesh: Mesh) -> Mesh:
    return dataclasses.replace(
        mesh,
        faces=np.concatenate([mesh.faces, mesh.faces[:1]]),
        face_label=np.concatenate([mesh.face_label, [1]]),
    )


def label_inside(mesh: Mesh) -> Mesh:
    table = face_table(mesh.tets)
    same = mesh.region[table.first] == mesh.region[table.second]
    inner = table.nodes[~table.on_boundary & same][:1]
    return dataclasses.replace(
        mesh,
        faces=np.concatenate([mesh.faces, inner]),
        face_label=np.concatenate([mesh.face_label, [0]]),
    )


def loose_node(mesh: Mesh) -> Mesh:
    return dataclasses.replace(mesh, points=np.concatenate([mesh.points, np.zeros((1, 3))]))


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (inverted, "1 tetrahedra are inverted or flat, the first, number 7"),
        (inverted, "both their tetrahedra on the same side"),
        (turned_face, "1 labelled faces point into their region"),
        (unlabelled, "1 faces of the boundary or the interface have no label"),
        (labelled_twice, "1 faces carry more than one label"),
        (label_inside, "1 labelled faces bound no region"),
        (loose_node, "1 nodes belong to no tetrahedron"),
    ],
)
def test_unusable_meshes_are_refused(small_tube, spoil, message):
    check_mesh(small_tube)
    with pytest.raises(ValueError, match=message):
        check_mesh(spoil(small_tube))


def test_wedges_are_filled_by_their_tetrahedra():
    mesh = reordered(
        tube(
            radius=0.5, length=1.0, thickness=0.1, n_around=12, n_axial=4, n_layers=2, columns=True
        )
    )
    solid = tet_volumes(mesh.points, mesh.tets)[mesh.region == Region.SOLID]
    filled = tet_volumes(mesh.points, mesh.tets)[mesh.wedge_tets]
    assert filled.size == solid.size
    np.testing.assert_allclose(filled.sum(), solid.sum(), rtol=1e-12)
    assert np.all(filled > 0.0)


def test_wedges_that_their_tetrahedra_do_not_fill_are_refused():
    mesh = strip(length=1.0, width=0.3, thickness=0.1, n_length=3, n_width=1, n_layers=1)
    with pytest.raises(ValueError, match="wedges are not filled by three tetrahedra"):
        dataclasses.replace(mesh, wedges=np.roll(mesh.wedges, 1, axis=1)[:, [0, 1, 2, 3, 4, 4]])
    with pytest.raises(ValueError, match="share a tetrahedron"):
        dataclasses.replace(mesh, wedges=mesh.wedges[[0, 0]])
