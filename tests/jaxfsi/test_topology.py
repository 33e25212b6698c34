import dataclasses
import json

import numpy as np
import pytest

from jaxfsi.mesh import Mesh, Region
from jaxfsi.mesh_files import read_vtu
from jaxfsi.mesh_parts import submesh
from jaxfsi.meshing import bent, check_topology, mapped, ring, strip, surface_topology, tube
from jaxfsi.meshing.check.topology import count_components, nodes_inside
from jaxfsi.meshing.labels import labelled_mesh


@pytest.fixture(scope="module")
def walled() -> Mesh:
    return tube(radius=0.5, length=2.0, thickness=0.1, n_around=12, n_axial=6, n_layers=2)


def torus_faces(n: int = 8, m: int = 6) -> tuple[np.ndarray, np.ndarray]:
    u, v = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    a, b = 2.0 * np.pi * u / n, 2.0 * np.pi * v / m
    rho = 2.0 + 0.5 * np.cos(b)
    points = np.stack([rho * np.cos(a), rho * np.sin(a), 0.5 * np.sin(b)], axis=2).reshape(-1, 3)

    def node(i: np.ndarray, j: np.ndarray) -> np.ndarray:
        return (i % n * m + j % m).reshape(-1)

    corners = node(u, v), node(u + 1, v), node(u + 1, v + 1), node(u, v + 1)
    first, second = [0, 1, 2], [0, 2, 3]
    faces = [np.stack([corners[i] for i in half], axis=1) for half in (first, second)]
    return points, np.concatenate(faces)


def test_a_torus_has_euler_characteristic_zero():
    points, faces = torus_faces()
    surface = surface_topology(points, faces)
    assert surface.euler == 0
    assert surface.n_components == 1
    assert surface.is_closed_manifold
    assert surface.volume > 0.0


def test_faults_of_surfaces_are_counted():
    points, faces = torus_faces()
    hole = surface_topology(points, faces[1:])
    assert (hole.open_edges, hole.euler) == (3, -1)
    turned = faces.copy()
    turned[0] = turned[0][::-1]
    assert surface_topology(points, turned).unmatched_edges == 3
    doubled = surface_topology(points, np.concatenate([faces, faces[:1]]))
    assert doubled.crowded_edges == 3
    for surface in (hole, doubled):
        assert not surface.is_closed_manifold
        assert surface.fault_at is not None


def test_two_tetrahedra_at_one_node_pinch_their_boundary():
    tetrahedron = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
    points = np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    # Reflected through the origin, the second tetrahedron turns its faces.
    other = np.array([0, 4, 5, 6])[tetrahedron][:, ::-1]
    surface = surface_topology(points, np.concatenate([tetrahedron, other]))
    assert surface.pinched_nodes == 1
    assert surface.fault_at == (0.0, 0.0, 0.0)
    assert surface.n_components == 2
    # Two tetrahedra of volume 1/6, exact in round-off.
    assert surface.volume == pytest.approx(1.0 / 3.0, rel=1e-14)


def test_a_tube_in_its_wall_has_the_right_topology(walled):
    report = check_topology(walled)
    assert report.faults == ()
    assert report.euler == {"lumen": 2, "wall": 0, "outer": 2}
    assert report.n_components == {"fluid": 1, "solid": 1}
    report.raise_faults()
    # Area of the inscribed polygon times the length; round-off of the sum.
    polygon = 0.5 * 12 * np.sin(2.0 * np.pi / 12)
    assert report.volume["fluid"] == pytest.approx(2.0 * polygon * 0.25, rel=1e-12)
    assert report.volume["solid"] == pytest.approx(2.0 * polygon * 0.11, rel=1e-12)
    for name, volume in report.volume.items():
        assert report.volume_from_faces[name] == pytest.approx(volume, rel=1e-12)
    json.dumps(report.to_dict())


def test_other_shapes_have_no_faults():
    wall = ring(radius=0.5, length=0.2, thickness=0.1, n_around=12, n_axial=2)
    assert check_topology(wall).euler == {"wall": 0}
    box = strip(length=1.0, width=0.4, thickness=0.1, n_length=4, n_width=2, n_layers=2)
    assert check_topology(box).euler == {"wall": 2}
    blood = tube(radius=0.5, length=2.0, thickness=0.1, n_around=12, n_axial=6, n_layers=0)
    assert check_topology(blood).euler == {"lumen": 2}
    for mesh in (wall, box, blood):
        assert check_topology(mesh).faults == ()


def without_tets(mesh: Mesh, removed: np.ndarray) -> Mesh:
    """The mesh less some tetrahedra, all its outer faces under one label each."""
    kept = ~removed
    tets, region = mesh.tets[kept], mesh.region[kept]
    from_faces = {name: mesh.labelled(name) for name in ("inlet", "outlet", "interface")}
    return labelled_mesh(mesh.points, tets, region, from_faces)


def words(mesh: Mesh) -> str:
    with pytest.raises(ValueError, match="wrong topology") as refused:
        check_topology(mesh).raise_faults()
    return str(refused.value)


def test_a_hole_through_the_wall_is_found(walled):
    middle = walled.points[walled.tets].mean(axis=1)
    hole = (
        (walled.region == Region.SOLID)
        & (middle[:, 0] > 0.35)
        & (np.abs(middle[:, 1]) < 0.25)
        & (np.abs(middle[:, 2] - 1.0) < 0.4)
    )
    mesh = without_tets(walled, hole)
    report = check_topology(mesh)
    assert report.euler["wall"] == -2
    assert "The septum or the wall has a hole" in words(mesh)


def test_lumens_joined_through_a_septum_are_found(walled):
    """A bridge of blood between two ends of a bent tube makes a handle."""
    middle = walled.points[walled.tets].mean(axis=1)
    half = np.abs(middle[:, 2] - 1.0) < 0.2
    core = np.linalg.norm(middle[:, :2], axis=1) < 0.2
    region = np.where(
        half & core & (walled.region == Region.FLUID), int(Region.SOLID), walled.region
    )
    report = check_topology(dataclasses.replace(walled, region=region))
    assert report.n_components["solid"] == 2
    said = " ".join(fault.what for fault in report.faults)
    assert "its Euler characteristic is" in said
    assert "it falls into 2 pieces" in said


def test_pieces_are_counted_through_faces():
    tets = np.array([[0, 1, 2, 3], [1, 2, 3, 4], [4, 5, 6, 7]])
    assert count_components(tets) == 2


def test_a_node_of_the_wall_inside_the_blood_is_found(walled):
    """A wall moved sideways into the blood, as two meshes made apart would do."""
    fluid, solid = submesh(walled, Region.FLUID).mesh, submesh(walled, Region.SOLID).mesh
    shift = len(fluid.points)
    mesh = Mesh(
        points=np.concatenate([fluid.points, solid.points + np.array([0.15, 0.0, 0.0])]),
        tets=np.concatenate([fluid.tets, solid.tets + shift]),
        region=np.concatenate([fluid.region, solid.region]),
        faces=np.concatenate([fluid.faces, solid.faces + shift]),
        face_label=np.concatenate([fluid.face_label, np.full(len(solid.faces), 3)]),
        label_names=(*fluid.label_names, "outer_wall"),
    )
    inside = nodes_inside(mesh, Region.SOLID, Region.FLUID)
    moved = mesh.points[inside]
    assert len(inside) > 0
    assert np.all(np.linalg.norm(moved[:, :2], axis=1) < 0.5)
    # The inner node at angle pi came to rest at radius 0.35, well inside the polygon.
    deep = (np.abs(mesh.points[:, 0] + 0.35) < 1e-9) & (np.abs(mesh.points[:, 1]) < 1e-9)
    assert set(np.flatnonzero(deep)[1:-1]) <= set(inside)
    assert "nodes of the solid that the fluid does not share lie in or on it" in words(mesh)


def test_folded_elements_are_found_although_all_volumes_are_positive(walled):
    points = walled.points.copy()
    inner = np.argmin(np.linalg.norm(points - np.array([0.0, 0.0, 1.0]), axis=1))
    points[inner] += np.array([0.3, 0.0, 0.0])
    folded = dataclasses.replace(walled, points=points)
    tets = folded.tets.copy()
    a, b, c, d = (points[tets[:, i]] for i in range(4))
    negative = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) < 0.0
    assert np.any(negative)
    tets[negative] = tets[negative][:, [1, 0, 2, 3]]
    said = words(dataclasses.replace(folded, tets=tets))
    assert "both their tetrahedra on the same side" in said
    assert "its tetrahedra fill" in said


def test_a_hidden_cap_changes_the_number_of_openings(walled):
    """A wall with two openings of which only one is declared has the wrong characteristic."""
    groups = {name: walled.labelled(name) for name in walled.label_names if "outlet" not in name}
    groups["interface"] = np.concatenate([groups["interface"], walled.labelled("outlet")])
    groups["outer_wall"] = np.concatenate([groups["outer_wall"], walled.labelled("outlet_ring")])
    said = words(labelled_mesh(walled.points, walled.tets, walled.region, groups))
    assert "Euler characteristic is 0, not 2" in said


def test_stored_tubes_have_the_stated_volumes(shared_data):
    for name in ("tube_c10k", "tube_f60k"):
        mesh = read_vtu(shared_data / "tube_wave" / f"{name}.vtu", unit="cm")
        stated = json.loads((shared_data / "tube_wave" / f"{name}.json").read_text())
        report = check_topology(mesh)
        assert report.faults == ()
        # Round-off of sums over 6e4 tetrahedra.
        assert report.volume["fluid"] == pytest.approx(stated["vol_fluid"], rel=1e-12)
        assert report.volume["solid"] == pytest.approx(stated["vol_solid"], rel=1e-12)
        assert len(mesh.labelled("interface")) == stated["faces_fluid"]["interface"]
        assert len(mesh.labelled("outer_wall")) == stated["faces_solid"]["outside"]


def test_a_bend_keeps_the_topology(walled):
    shape = mapped(walled, bent(bend_radius=1.5))
    report = check_topology(shape)
    assert report.faults == ()
    assert report.euler == {"lumen": 2, "wall": 0, "outer": 2}
