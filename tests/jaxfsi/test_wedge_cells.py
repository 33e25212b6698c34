"""Wedges of the wall in mesh files: cells of their own, or their tetrahedra and a list beside."""

import dataclasses
import json

import meshio
import numpy as np
import pytest

from jaxfsi.mesh import Mesh, Region, tet_volumes
from jaxfsi.mesh_files import read_mesh, read_mesh_complete, write_mesh, write_mesh_complete
from jaxfsi.mesh_parts import reordered
from jaxfsi.meshing import tube


@pytest.fixture(scope="module")
def columns() -> Mesh:
    """A tube whose wall is wedges, but for some left out, in an order of its own."""
    mesh = tube(
        radius=0.5, length=2.0, thickness=0.1, n_around=12, n_axial=4, n_layers=1, columns=True
    )
    # Node numbers no longer tell how wedges are cut.
    return dataclasses.replace(reordered(mesh), wedges=reordered(mesh).wedges[5:][::-1])


def assert_same(mesh: Mesh, other: Mesh) -> None:
    for field in dataclasses.fields(Mesh):
        one, two = getattr(mesh, field.name), getattr(other, field.name)
        if isinstance(one, np.ndarray):
            np.testing.assert_array_equal(one, two, err_msg=field.name)
        else:
            assert one == two, field.name


@pytest.mark.parametrize("ending", ["vtu", "msh", "xdmf"])
def test_wedges_survive_the_round_trip(tmp_path, columns, ending):
    path = tmp_path / f"tube.{ending}"
    write_mesh(path, columns, unit="cm")
    assert_same(columns, read_mesh(path, unit="cm"))


def test_wedges_survive_as_folders_of_tetrahedra(tmp_path, columns):
    folders = tmp_path / "fluid", tmp_path / "solid"
    write_mesh_complete(*folders, columns, unit="cm")
    kinds = {block.type for block in meshio.read(folders[1] / "mesh-complete.mesh.vtu").cells}
    assert kinds == {"tetra"}
    assert_same(columns, read_mesh_complete(*folders, unit="cm"))


def test_viewers_see_each_part_of_the_wall_once(tmp_path, columns):
    path = tmp_path / "tube.vtu"
    write_mesh(path, columns, unit="cm")
    file = meshio.read(path)
    assert {block.type for block in file.cells} == {"tetra", "wedge", "triangle"}
    cells = {block.type: block.data for block in file.cells}
    assert len(cells["tetra"]) + 3 * len(cells["wedge"]) == len(columns.tets)
    x = file.points[cells["wedge"]]
    # VTK: the normal of the first triangle points away from the second.
    normal = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    assert np.all(np.einsum("wk,wk->w", normal, x[:, 3:].mean(axis=1) - x[:, 0]) < 0.0)
    regions = dict(zip([b.type for b in file.cells], file.cell_data["region"], strict=True))
    assert np.all(regions["wedge"] == int(Region.SOLID))


def test_file_without_its_side_entry_is_read_as_tetrahedra(tmp_path, columns):
    path = tmp_path / "tube.vtu"
    write_mesh(path, columns, unit="cm")
    path.with_suffix(".json").unlink()
    mesh = read_mesh(path, unit="cm")
    assert len(mesh.wedges) == 0
    volume = tet_volumes(columns.points, columns.tets).sum()
    assert tet_volumes(mesh.points, mesh.tets).sum() == pytest.approx(volume, rel=1e-12)


def test_wedges_of_another_program_are_cut_into_tetrahedra(tmp_path):
    mesh = tube(
        radius=0.5, length=2.0, thickness=0.1, n_around=12, n_axial=4, n_layers=1, columns=True
    )
    blood = mesh.tets_of(Region.FLUID)
    wedges = mesh.wedges[:, [0, 2, 1, 3, 5, 4]]
    regions = [np.zeros(len(blood), dtype=int), np.ones(len(wedges), dtype=int)]
    file = meshio.Mesh(
        mesh.points, [("tetra", blood), ("wedge", wedges)], cell_data={"region": regions}
    )
    meshio.vtu.write(str(tmp_path / "other.vtu"), file)
    found = read_mesh(tmp_path / "other.vtu", unit="cm")
    assert np.sum(found.region == Region.SOLID) == 3 * len(wedges)
    assert tet_volumes(found.points, found.tets).min() > 0.0


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("tets", 0, "place of its own. Write it again"),
        ("filling", 9876, "place of its own. Write it again"),
    ],
)
def test_damaged_places_of_tetrahedra_are_refused(tmp_path, columns, name, value, message):
    path = tmp_path / "tube.vtu"
    write_mesh(path, columns, unit="cm")
    file = meshio.read(path)
    file.cell_data[name][1][:] = value
    meshio.vtu.write(str(path), file)
    with pytest.raises(ValueError, match=message):
        read_mesh(path, unit="cm")


@pytest.mark.parametrize("wedges", [7, [[1, 2, 3]], [[0, 1, 2, 3, 4, -5]], [[0, 1, 2, 3, 4, 1.5]]])
def test_side_entry_with_wrong_wedges_is_refused(tmp_path, columns, wedges):
    folders = tmp_path / "fluid", tmp_path / "solid"
    write_mesh_complete(*folders, columns, unit="cm")
    for folder in folders:
        (entry,) = folder.glob("*.json")
        text = json.loads(entry.read_text())
        entry.write_text(json.dumps(text | {"wedges": wedges}))
    with pytest.raises(ValueError, match="six whole numbers"):
        read_mesh_complete(*folders, unit="cm")
