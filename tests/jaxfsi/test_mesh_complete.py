import dataclasses
import shutil

import meshio
import numpy as np
import pytest

from jaxfsi.mesh import Mesh, Region
from jaxfsi.mesh_checks import check_mesh
from jaxfsi.mesh_files import (
    join_nodes,
    read_mesh_complete,
    read_vtp,
    write_mesh_complete,
    write_vtp,
)
from jaxfsi.mesh_files.complete_folder import id_array
from jaxfsi.mesh_parts import reordered, submesh
from jaxfsi.meshing import check_topology, tube


@pytest.fixture(scope="module")
def walled() -> Mesh:
    mesh = reordered(
        tube(radius=0.5, length=2.0, thickness=0.1, n_around=12, n_axial=6, n_layers=2)
    )
    return dataclasses.replace(mesh, meta={"state": "rest"})


@pytest.fixture
def folders(tmp_path, walled):
    pair = tmp_path / "lumen", tmp_path / "wall"
    write_mesh_complete(*pair, walled, unit="cm")
    return pair


def made_foreign(folders) -> None:
    """Take away what only this package writes."""
    for folder in folders:
        (folder / "mesh-complete.json").unlink()


def areas(mesh: Mesh) -> dict[str, float]:
    corners = {name: mesh.points[mesh.labelled(name)] for name in mesh.label_names}
    return {
        name: float(
            np.sum(np.linalg.norm(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), axis=1)) / 2.0
        )
        for name, c in corners.items()
    }


def test_ids_and_faces_follow_the_simvascular_layout(folders, walled):
    lumen, wall = folders
    assert {path.name for path in lumen.iterdir()} == {
        "mesh-complete.mesh.vtu",
        "mesh-complete.exterior.vtp",
        "mesh-complete.json",
        "mesh-surfaces",
        "walls_combined.vtp",
    }
    assert {path.stem for path in (wall / "mesh-surfaces").iterdir()} == {
        "interface",
        "outer_wall",
        "inlet_ring",
        "outlet_ring",
    }
    part = submesh(walled, Region.FLUID).mesh
    surface = read_vtp(lumen / "mesh-surfaces" / "inlet.vtp")
    nodes = surface.point_data["GlobalNodeID"] - 1
    assert np.array_equal(part.points[nodes], surface.points)
    # Every face belongs to the tetrahedron that its element id names.
    owners = part.tets[surface.cell_data["GlobalElementID"] - 1]
    corners = nodes[surface.triangles]
    assert np.all(np.any(owners[:, :, None] == corners[:, None, :], axis=1))
    assert set(surface.cell_data["ModelFaceID"]) == {1}


def test_ids_are_the_integers_that_svmultiphysics_takes(folders, walled):
    vtk = pytest.importorskip("vtk")
    for folder, region in zip(folders, Region, strict=True):
        volume = vtk.vtkXMLUnstructuredGridReader()
        volume.SetFileName(str(folder / "mesh-complete.mesh.vtu"))
        volume.Update()
        files = [volume.GetOutput()]
        surfaces = [*(folder / "mesh-surfaces").glob("*.vtp"), folder / "walls_combined.vtp"]
        for path in (*surfaces, folder / "mesh-complete.exterior.vtp"):
            surface = vtk.vtkXMLPolyDataReader()
            surface.SetFileName(str(path))
            surface.Update()
            files.append(surface.GetOutput())
        assert files[0].GetNumberOfCells() == len(walled.tets_of(region))
        for file in files:
            assert file.GetNumberOfCells() > 0
            ids = [file.GetPointData().GetArray("GlobalNodeID")]
            ids.append(file.GetCellData().GetArray("GlobalElementID"))
            if file is not files[0]:
                ids.append(file.GetCellData().GetArray("ModelFaceID"))
            assert all(isinstance(array, vtk.vtkIntArray) for array in ids)


def test_meshes_that_int32_cannot_count_are_refused():
    assert id_array(np.array([1, 2**31 - 1]), "GlobalNodeID").dtype == np.int32
    with pytest.raises(ValueError, match=r"GlobalNodeID would reach 2147483648.*counts to"):
        id_array(np.array([2**31]), "GlobalNodeID")


def test_folders_of_others_are_joined_at_the_interface(folders, walled):
    made_foreign(folders)
    mesh = read_mesh_complete(*folders, unit="cm")
    assert set(mesh.label_names) == set(walled.label_names)
    for name, area in areas(walled).items():
        assert areas(mesh)[name] == pytest.approx(area, rel=1e-12)
    assert len(mesh.points) == len(walled.points)
    assert check_topology(mesh).faults == ()


def test_one_folder_alone_is_read(folders, walled):
    lumen, wall = folders
    fluid = read_mesh_complete(lumen, None, unit="cm")
    assert set(fluid.label_names) == {"inlet", "outlet", "interface"}
    solid = read_mesh_complete(None, wall, unit="cm")
    assert set(solid.label_names) == {"interface", "outer_wall", "inlet_ring", "outlet_ring"}
    for mesh in (fluid, solid):
        check_mesh(mesh)
    with pytest.raises(ValueError, match="no folder was given"):
        read_mesh_complete(None, None, unit="cm")


def moved_nodes(folder, distance: float) -> None:
    """Move one node of a folder, in all its files, as another mesher's rounding would."""
    volume = folder / "mesh-complete.mesh.vtu"
    file = meshio.vtu.read(str(volume))
    # A node on the inner side of the wall, away from the ends.
    radius = np.linalg.norm(file.points[:, :2], axis=1)
    candidates = np.isclose(radius, 0.5) & (np.abs(file.points[:, 2] - 1.0) < 0.2)
    node = int(np.flatnonzero(candidates)[0])
    shift = np.array([0.0, 0.0, distance])
    file.points[node] += shift
    meshio.vtu.write(str(volume), file)
    for path in (folder / "mesh-surfaces").iterdir():
        surface = read_vtp(path)
        points = surface.points + shift * (surface.point_data["GlobalNodeID"] == node + 1)[:, None]
        write_vtp(
            path,
            points,
            surface.triangles,
            point_data=surface.point_data,
            cell_data=surface.cell_data,
        )


def test_near_misses_are_refused_unless_the_tolerance_covers_them(folders):
    made_foreign(folders)
    moved_nodes(folders[1], 1e-4)
    with pytest.raises(ValueError, match=r"1 nodes of the solid nearly coincide.*0.0001 cm apart"):
        read_mesh_complete(*folders, unit="cm")
    assert check_topology(read_mesh_complete(*folders, unit="cm", tolerance=2e-4)).faults == ()


def test_regions_that_part_company_are_refused(folders):
    made_foreign(folders)
    moved_nodes(folders[1], 0.1)
    with pytest.raises(ValueError, match="do not conform"):
        read_mesh_complete(*folders, unit="cm")


def test_regions_that_share_nothing_are_refused():
    near = tube(radius=0.5, length=2.0, thickness=0.1, n_around=8, n_axial=2, n_layers=0)
    far = near.points + np.array([5.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="share no node"):
        join_nodes(near.points, near.tets, far, near.tets)
    twice = np.concatenate([near.points, near.points])
    tets = np.concatenate([near.tets, near.tets + len(near.points)])
    with pytest.raises(ValueError, match="several nodes of the solid coincide"):
        join_nodes(near.points, near.tets, twice, tets)


def test_units_are_kept_and_checked(tmp_path, walled):
    pair = tmp_path / "lumen", tmp_path / "wall"
    write_mesh_complete(*pair, walled, unit="mm")
    mesh = read_mesh_complete(*pair, unit="mm")
    # One division and one multiplication by 0.1.
    np.testing.assert_allclose(mesh.points, walled.points, rtol=4e-16, atol=0.0)
    with pytest.raises(ValueError, match="lengths are in mm"):
        read_mesh_complete(*pair, unit="cm")


def test_folders_are_never_overwritten(folders, walled):
    with pytest.raises(ValueError, match="exists already"):
        write_mesh_complete(*folders, walled, unit="cm")
    other = folders[0].parent
    with pytest.raises(ValueError, match="one folder for each region"):
        write_mesh_complete(other / "a", None, walled, unit="cm")
    with pytest.raises(ValueError, match="there is no folder"):
        write_mesh_complete(other / "x" / "a", other / "x" / "b", walled, unit="cm")
    assert {path.name for path in other.iterdir()} == {"lumen", "wall"}


def test_folders_of_two_meshes_do_not_mix(folders, walled, tmp_path):
    moved = dataclasses.replace(walled, points=walled.points + 0.01)
    other = tmp_path / "lumen2", tmp_path / "wall2"
    write_mesh_complete(*other, moved, unit="cm")
    with pytest.raises(ValueError, match="folders of one mesh"):
        read_mesh_complete(folders[0], other[1], unit="cm")
    named = tmp_path / "lumen3", tmp_path / "wall3"
    write_mesh_complete(*named, dataclasses.replace(walled, meta={}), unit="cm")
    with pytest.raises(ValueError, match="do not belong together"):
        read_mesh_complete(folders[0], named[1], unit="cm")


def cut_volume(lumen) -> None:
    path = lumen / "mesh-complete.mesh.vtu"
    path.write_bytes(path.read_bytes()[:-300])


def drop_surface(lumen) -> None:
    (lumen / "mesh-surfaces" / "inlet.vtp").unlink()


def drop_surfaces(lumen) -> None:
    shutil.rmtree(lumen / "mesh-surfaces")


def rewrite_inlet(lumen, **change) -> None:
    path = lumen / "mesh-surfaces" / "inlet.vtp"
    surface = read_vtp(path)
    parts = {"point_data": surface.point_data, "cell_data": surface.cell_data, **change}
    points = parts.pop("points", surface.points)
    write_vtp(path, points, surface.triangles, **parts)


def drop_ids(lumen) -> None:
    rewrite_inlet(lumen, point_data={})


def wrong_ids(lumen) -> None:
    surface = read_vtp(lumen / "mesh-surfaces" / "inlet.vtp")
    rewrite_inlet(lumen, point_data={"GlobalNodeID": surface.point_data["GlobalNodeID"] + 10**6})


def wrong_places(lumen) -> None:
    surface = read_vtp(lumen / "mesh-surfaces" / "inlet.vtp")
    rewrite_inlet(lumen, points=surface.points + 0.1)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (cut_volume, "mesh-complete.mesh.vtu cannot be read"),
        (drop_surface, "surface files are missing|Name every opening"),
        (drop_surfaces, "holds no vtp files"),
        (drop_ids, "has no GlobalNodeID"),
        (wrong_ids, "which mesh-complete.mesh.vtu does not have"),
        (wrong_places, "from those of the same id"),
    ],
)
@pytest.mark.parametrize("foreign", [False, True])
def test_spoilt_folders_are_refused(folders, spoil, message, foreign):
    if foreign:
        made_foreign(folders)
    spoil(folders[0])
    with pytest.raises(ValueError, match=message):
        read_mesh_complete(*folders, unit="cm")


def test_surfaces_can_be_renamed(folders):
    made_foreign(folders)
    mesh = read_mesh_complete(*folders, unit="cm", labels={"inlet": "aorta"})
    assert {"aorta", "aorta_ring"} <= set(mesh.label_names)
    with pytest.raises(ValueError, match="there is no surface 'cap'"):
        read_mesh_complete(*folders, unit="cm", labels={"cap": "aorta"})


def test_labels_of_own_folders_can_be_renamed(folders):
    mesh = read_mesh_complete(*folders, unit="cm", labels={"inlet": "aorta"})
    assert {"aorta", "aorta_ring"} <= set(mesh.label_names)
    with pytest.raises(ValueError, match="there is no label 'cap'"):
        read_mesh_complete(*folders, unit="cm", labels={"cap": "aorta"})


def test_stored_pipe_of_blood_is_read(shared_data):
    folder = shared_data / "svfsi-tests" / "pipe3d_rcr" / "mesh-complete"
    mesh = read_mesh_complete(folder, None, unit="cm")
    report = check_topology(mesh)
    assert report.faults == ()
    assert mesh.label_names == ("lumen_inlet", "lumen_outlet", "interface")
    # Radius 2, length 30; its coarse polygons fall short by 1.5 %.
    assert report.volume["fluid"] == pytest.approx(120.0 * np.pi, rel=0.02)


def test_stored_pipe_in_its_wall_is_joined(shared_data):
    base = shared_data / "svfsi-tests" / "pipe_prestress"
    mesh = read_mesh_complete(base / "lumen_mesh-complete", base / "wall_mesh-complete", unit="cm")
    counts = {name: len(mesh.labelled(name)) for name in mesh.label_names}
    assert counts["interface"] == counts["outer_wall"] == 8227
    assert set(counts) == {
        "lumen_inlet",
        "lumen_outlet",
        "interface",
        "outer_wall",
        "lumen_inlet_ring",
        "lumen_outlet_ring",
    }
    # 8365 nodes of the wall, of which 4148 are the lumen's.
    assert len(mesh.points) == 30211 + 8365 - 4148
