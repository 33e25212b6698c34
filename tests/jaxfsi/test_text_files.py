"""Files that cannot be read: named and described without any parser's words."""

import json
import os
import pathlib
import re
import shutil
import struct

import numpy as np
import pytest

from jaxfsi.anatomy import read_centerline, read_pullback
from jaxfsi.anatomy.surfaces.triangles import read_triangles
from jaxfsi.fields.npz import load_arrays
from jaxfsi.mesh_files import MeshFileError, read_mesh, read_vtp, write_mesh, write_mesh_complete
from jaxfsi.mesh_files.mesh_complete import read_mesh_complete
from jaxfsi.meshing import tube
from jaxfsi.text_files import read_table, regular_bytes
from study import demo_case_path

BUNDLED = demo_case_path().parent
FOREIGN = re.compile(
    r"codec|invalid literal|could not convert|reshape|out of bounds|well-formed|token|Expecting"
    r"|Error|Errno|unpack|\(char|KeyError|None|np\.|array\(|buffer|limit"
)


@pytest.fixture(scope="module")
def small():
    return tube(radius=0.5, length=2.0, thickness=0.1, n_around=8, n_axial=3, n_layers=1)


def refused(read, path: pathlib.Path, *says: str) -> None:
    with pytest.raises(ValueError, match=re.escape(path.name)) as caught:
        read()
    text = str(caught.value).replace(str(path.parent), "")
    for words in says:
        assert words in text, text
    assert FOREIGN.search(text) is None, text


@pytest.mark.parametrize("name", ["contours.csv", "frames.csv", "reference.csv"])
@pytest.mark.parametrize("damage", ["byte", "long cell"])
def test_the_damaged_file_of_a_pullback_is_named(tmp_path, name, damage):
    for to, source in (
        ("contours.csv", "rest_diastole_contours.csv"),
        ("frames.csv", "rest_frames.csv"),
        ("reference.csv", "rest_diastole_reference.csv"),
    ):
        shutil.copy(BUNDLED / source, tmp_path / to)
    file = tmp_path / name
    data = bytearray(file.read_bytes())
    data[-20:-20] = b"\xff" if damage == "byte" else b"1" * 200_000
    file.write_bytes(data)
    refused(
        lambda: read_pullback(
            tmp_path / "contours.csv",
            frame_table=tmp_path / "frames.csv",
            reference=tmp_path / "reference.csv",
        ),
        file,
        *(["is not a UTF-8 text", "is 0xff"] if damage == "byte" else []),
    )


def test_a_centre_line_that_is_no_text_is_named(tmp_path):
    file = tmp_path / "centerline.csv"
    file.write_bytes((BUNDLED / "centerline.csv").read_bytes()[:50] + b"\xe9\n")
    refused(lambda: read_centerline(file), file, "is not a UTF-8 text (byte 50 is 0xe9)")


def test_rows_of_a_table_are_read_with_their_lines(tmp_path):
    file = tmp_path / "table.csv"
    file.write_text('\ufeffa,b\n1,"2"\n\n3\n4,5,6\n')
    assert list(read_table(file)) == [
        (2, {"a": "1", "b": "2"}),
        (4, {"a": "3", "b": ""}),
        (5, {"a": "4", "b": "5"}),
    ]


def vtu(path: pathlib.Path) -> None:
    path.write_bytes(path.read_bytes().replace(b"<Points>", b"<Points", 1))


def vtu_points(path: pathlib.Path) -> None:
    text = path.read_text()
    count = re.search(r'NumberOfPoints="(\d+)"', text)
    assert count is not None
    path.write_text(text.replace(count[0], f'NumberOfPoints="{int(count[1]) + 1}"'))


def xdmf_tag(path: pathlib.Path) -> None:
    path.write_text(path.read_text().replace("<Geometry", "<<Geometry", 1))


def xdmf_counts(path: pathlib.Path) -> None:
    path.write_text(path.read_text().replace('Dimensions="', 'Dimensions="x ', 1))


def xdmf_place(path: pathlib.Path) -> None:
    path.write_text(path.read_text().replace(":/data0", ":/nowhere"))


def xdmf_store(path: pathlib.Path) -> None:
    path.with_suffix(".h5").write_bytes(b"no HDF5")


def msh_index(path: pathlib.Path) -> None:
    data = path.read_bytes()
    at = data.index(b"$Elements\n") + 10
    at = data.index(b"\n", at) + 1 + 4 * 6  # the first node of the first element
    path.write_bytes(data[:at] + struct.pack("<i", 2**31 - 1) + data[at + 4 :])


def msh_count(path: pathlib.Path) -> None:
    data = path.read_bytes()
    path.write_bytes(re.sub(rb"\$Nodes\n\d+", b"$Nodes\n-5", data))


def msh_nul(path: pathlib.Path) -> None:
    path.write_bytes(re.sub(rb"\$Elements\n", b"$Elements\n\0", path.read_bytes()))


def beside(path: pathlib.Path) -> None:
    path.with_suffix(".json").write_bytes(b'{"format": \xff')


def beside_lacks(path: pathlib.Path) -> None:
    table = {"format": "jaxfsi mesh", path.name: {"unit": "cm"}}
    path.with_suffix(".json").write_text(json.dumps(table))


def beside_deep(path: pathlib.Path) -> None:
    path.with_suffix(".json").write_text("[" * 100_000)


MESHES = {
    "vtu: no XML": (".vtu", vtu, ".vtu", "it is no valid XML at line"),
    "vtu: points": (".vtu", vtu_points, ".vtu", "do not fit together"),
    "xdmf: no XML": (".xdmf", xdmf_tag, ".xdmf", "it is no valid XML at line"),
    "xdmf: counts": (".xdmf", xdmf_counts, ".xdmf", "Dimensions"),
    "xdmf: no array": (".xdmf", xdmf_place, ".xdmf", "/nowhere"),
    "xdmf: no store": (".xdmf", xdmf_store, ".xdmf", "do not fit together"),
    "msh: index": (".msh", msh_index, ".msh", "do not fit together"),
    "msh: count": (".msh", msh_count, ".msh", "number -5"),
    "msh: zero byte": (".msh", msh_nul, ".msh", "do not fit together"),
    "beside: byte": (".vtu", beside, ".json", "it is no UTF-8 text (byte 11 is 0xff)"),
    "beside: lacks": (".vtu", beside_lacks, ".json", "lacks label_names, meta"),
    "beside: deep": (".xdmf", beside_deep, ".json", "nested too deeply"),
}


@pytest.mark.parametrize("claim", MESHES)
def test_a_damaged_mesh_file_is_described_in_own_words(tmp_path, small, claim):
    suffix, damage, blamed, says = MESHES[claim]
    path = tmp_path / f"mesh{suffix}"
    write_mesh(path, small, unit="cm")
    damage(path)
    refused(lambda: read_mesh(path, unit="cm"), path.with_suffix(blamed), says)


def test_a_damaged_entry_of_a_folder_is_described_in_own_words(tmp_path, small):
    fluid, solid = tmp_path / "fluid", tmp_path / "solid"
    write_mesh_complete(fluid, solid, small, unit="cm")
    file = fluid / "mesh-complete.json"
    file.write_text("{")
    refused(lambda: read_mesh_complete(fluid, solid, unit="cm"), file, "no valid JSON at line 1")


def test_meta_that_are_no_numbers_are_described_in_own_words(tmp_path, small):
    import dataclasses

    for value, says in ((np.nan, "not finite"), (object(), "no plain value")):
        mesh = dataclasses.replace(small, meta={"x": value})
        with pytest.raises(MeshFileError, match=says) as caught:
            write_mesh(tmp_path / "mesh.vtu", mesh, unit="cm")
        assert "compliant" not in str(caught.value)


def test_damaged_surfaces_are_described_in_own_words(tmp_path):
    stl = tmp_path / "a.stl"
    facet = "facet normal 0 0 1\nouter loop\n" + "vertex 0 0 x\n" * 3 + "endloop\nendfacet\n"
    stl.write_text(f"solid a\n{facet}endsolid a\n")
    refused(lambda: read_triangles(stl), stl, "cannot be read as stl")
    vtp = tmp_path / "a.vtp"
    vtp.write_text("<VTKFile type='PolyData'><PolyData><Piece NumberOf")
    refused(lambda: read_vtp(vtp), vtp, "it is no valid XML at line 1")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes with names")
def test_what_has_no_end_is_not_opened(tmp_path):
    (tmp_path / "device").symlink_to("/dev/urandom")
    os.mkfifo(tmp_path / "pipe")
    for name in ("device", "pipe"):
        for read in (regular_bytes, load_arrays):
            with pytest.raises(OSError, match="no regular file"):
                read(tmp_path / name)
    (tmp_path / "file").write_bytes(b"\x00\xff")
    assert regular_bytes(tmp_path / "file") == b"\x00\xff"
