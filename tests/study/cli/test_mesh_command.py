"""The command `jaxfsi mesh` on a small finished mesh: files, page, pictures, numbers."""

import numpy as np
import pytest

from jaxfsi.mesh_files import read_mesh, read_mesh_complete, write_mesh
from jaxfsi.meshing import tube

CASE = """\
[patient]
id = "tube"
[anatomy]
kind = "mesh"
path = "tube.vtu"
unit = "cm"
"""


@pytest.fixture(scope="module")
def mesh():
    return tube(radius=0.5, length=2.0, thickness=0.1, n_around=12, n_axial=6, n_layers=2)


@pytest.fixture(scope="module")
def made(mesh, tmp_path_factory, command):
    folder = tmp_path_factory.mktemp("mesh-command")
    write_mesh(folder / "tube.vtu", mesh, unit="cm")
    (folder / "tube.toml").write_text(CASE)
    chosen = ("--format", "vtu,msh,xdmf,folder", "--unit", "mm", "--json")
    return command("mesh", folder / "tube.toml", *chosen, folder=folder / "out")


def test_document_holds_the_checks_of_the_mesh(made, mesh):
    assert made.status == 0, made.stderr
    (entry,) = made.json["states"].values()
    assert entry["topology"]["euler"] == {"lumen": 2, "wall": 0, "outer": 2}
    assert entry["topology"]["faults"] == []
    assert sum(entry["quality"]["n_tets"].values()) == len(mesh.tets)
    assert {name: label["faces"] for name, label in entry["labels"].items()} == {
        name: len(mesh.labelled(name)) for name in mesh.label_names
    }
    assert made.written("mesh.json")["unit"] == "mm"


def test_page_shows_the_pictures_that_lie_beside_it(made):
    page = (made.folder / "mesh.html").read_text()
    pictures = sorted((made.folder / "pictures").iterdir())
    assert {path.name for path in pictures} >= {"finished-outside.png", "finished-cut.png"}
    assert page.count("data:image/png;base64,") == len(pictures)
    for path in pictures:
        assert path.read_bytes().startswith(b"\x89PNG")


def test_every_format_holds_the_same_mesh_in_the_unit_declared(made, mesh):
    out = made.folder
    read = [read_mesh(out / f"finished.{kind}", unit="mm") for kind in ("vtu", "msh", "xdmf")]
    complete = out / "finished-mesh-complete"
    read.append(read_mesh_complete(complete / "fluid", complete / "solid", unit="mm"))
    for other in read:
        # One division and one multiplication by 0.1.
        np.testing.assert_allclose(other.points, mesh.points, rtol=4e-16, atol=0.0)
        np.testing.assert_array_equal(other.tets, mesh.tets)
        np.testing.assert_array_equal(other.region, mesh.region)
        for name in mesh.label_names:
            np.testing.assert_array_equal(other.labelled(name), mesh.labelled(name))
    for kind in ("vtu", "msh", "xdmf"):
        with pytest.raises(ValueError, match="lengths are in mm"):
            read_mesh(out / f"finished.{kind}", unit="cm")


def test_stored_result_is_shown_again(made, command):
    shown = command("show", made.folder / "mesh.json", "--json")
    assert shown.status == 0, shown.stderr
    assert shown.json["states"] == made.json["states"]


@pytest.mark.parametrize(
    "arguments",
    [
        ["--preset", "huge"],
        ["--elements-across", "1"],
        ["--wall-layers", "0"],
        ["--format", "docx"],
        ["--state", "stress_systole"],
        ["--unit", "inch"],
    ],
)
def test_senseless_requests_are_refused(made, command, arguments, tmp_path):
    case = made.folder.parent / "tube.toml"
    outcome = command("mesh", case, *arguments, folder=tmp_path / "out")
    assert outcome.status == 2
    assert not (tmp_path / "out").exists()
