import base64
import xml.etree.ElementTree as ET
import zlib

import numpy as np
import pytest

from jaxfsi.mesh_files import read_vtp, write_vtp

POINTS = np.array([[0.0, 0.0, 0.1], [1.0 / 3.0, 0.0, 0.0], [0.0, np.pi, 0.0], [1.0, 1.0, 1e-17]])
TRIANGLES = np.array([[0, 1, 2], [1, 3, 2]])


def encoded(values: np.ndarray, compressor: str, header: str) -> bytes:
    data = values.tobytes()
    if not compressor:
        return np.array([len(data)], dtype=header).tobytes() + data
    half = max(8, len(data) // 2)
    blocks = [data[i : i + half] for i in range(0, len(data), half)]
    packed = [zlib.compress(block) for block in blocks]
    last = len(blocks[-1]) if blocks and len(blocks[-1]) != half else 0
    head = np.array([len(blocks), half, last, *map(len, packed)], dtype=header)
    return head.tobytes() + b"".join(packed)


def surface_bytes(
    form: str, *, compressor: str = "", header: str = "<u4", order: str = "<"
) -> bytes:
    """A vtp file written here in any of the layouts that VTK knows."""
    arrays = {
        "PointData": [("number", np.arange(4, dtype=order + "i4"))],
        "CellData": [("face", np.array([[7, 1], [8, 2], [9, 3]], dtype=order + "i8"))],
        "Points": [("Points", POINTS.astype(order + "f8"))],
        # One loose point in front: its row of the cell data belongs to no triangle.
        "Verts": [
            ("connectivity", np.array([3], dtype=order + "i8")),
            ("offsets", np.array([1], dtype=order + "i8")),
        ],
        "Polys": [
            ("connectivity", TRIANGLES.reshape(-1).astype(order + "i8")),
            ("offsets", np.array([3, 6], dtype=order + "i8")),
        ],
    }
    names = {"f8": "Float64", "i4": "Int32", "i8": "Int64"}
    appended = b""
    sections = ""
    for section, held in arrays.items():
        sections += f"<{section}>"
        for name, values in held:
            head = f'<DataArray Name="{name}" type="{names[values.dtype.str[1:]]}"'
            if values.ndim == 2:
                head += f' NumberOfComponents="{values.shape[1]}"'
            if form == "ascii":
                text = " ".join(repr(value) for value in values.reshape(-1).tolist())
                sections += f'{head} format="ascii">{text}</DataArray>'
                continue
            block = encoded(values, compressor, header)
            cut = (
                0
                if not compressor
                else np.dtype(header).itemsize * (3 + int(np.frombuffer(block, header, 1)[0]))
            )
            text = base64.b64encode(block[:cut]) + base64.b64encode(block[cut:])
            if form == "binary":
                sections += f'{head} format="binary">\n{text.decode()}\n</DataArray>'
            else:
                sections += f'{head} format="appended" offset="{len(appended)}"/>'
                appended += text if form == "base64" else block
        sections += f"</{section}>"
    file = (
        '<?xml version="1.0"?><VTKFile type="PolyData" version="1.0" byte_order="'
        + ("LittleEndian" if order == "<" else "BigEndian")
        + f'" header_type="{"UInt32" if header.endswith("u4") else "UInt64"}"'
        + (f' compressor="{compressor}"' if compressor else "")
        + '><PolyData><Piece NumberOfPoints="4" NumberOfVerts="1" NumberOfLines="0"'
        f' NumberOfStrips="0" NumberOfPolys="2">{sections}</Piece></PolyData>'
    ).encode()
    if appended:
        kind = "base64" if form == "base64" else "raw"
        file += f'<AppendedData encoding="{kind}">\n_'.encode() + appended + b"\n</AppendedData>"
    return file + b"</VTKFile>\n"


LAYOUTS = [
    {"form": "ascii"},
    *(
        {"form": form, "compressor": compressor, "header": header}
        for form in ("binary", "base64", "raw")
        for compressor in ("", "vtkZLibDataCompressor")
        for header in ("<u4", "<u8")
    ),
    {"form": "raw", "header": ">u4", "order": ">"},
]


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: "-".join(layout.values()))
def test_every_layout_is_read_to_the_last_bit(tmp_path, layout):
    path = tmp_path / "surface.vtp"
    path.write_bytes(surface_bytes(**layout))
    surface = read_vtp(path)
    assert np.array_equal(surface.points, POINTS)
    assert np.array_equal(surface.triangles, TRIANGLES)
    assert surface.point_data["number"].tolist() == [0, 1, 2, 3]
    assert surface.cell_data["face"].tolist() == [[8, 2], [9, 3]]


def test_what_is_written_comes_back(tmp_path):
    rng = np.random.default_rng(3)
    # More than one compressed block of a mebibyte.
    points = rng.normal(size=(60_000, 3))
    triangles = rng.integers(0, len(points), size=(1000, 3))
    data = {"id": np.arange(60_000), "normal": rng.normal(size=(60_000, 3)).astype(np.float32)}
    write_vtp(tmp_path / "a.vtp", points, triangles, point_data=data, cell_data={})
    surface = read_vtp(tmp_path / "a.vtp")
    assert np.array_equal(surface.points, points)
    assert np.array_equal(surface.triangles, triangles)
    for name, values in data.items():
        assert np.array_equal(surface.point_data[name], values)
        assert surface.point_data[name].dtype == values.dtype
    write_vtp(tmp_path / "a.vtp", points[:0], triangles[:0])
    assert read_vtp(tmp_path / "a.vtp").points.shape == (0, 3)
    assert [path.name for path in tmp_path.iterdir()] == ["a.vtp"]


def test_vtk_and_this_reader_agree(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    write_vtp(tmp_path / "ours.vtp", POINTS, TRIANGLES, cell_data={"face": np.array([4, 5])})
    seen = pyvista.read(tmp_path / "ours.vtp")
    assert np.array_equal(seen.points, POINTS)
    assert np.array_equal(seen.regular_faces, TRIANGLES)
    assert seen.cell_data["face"].tolist() == [4, 5]
    for binary in (True, False):
        ball = pyvista.Sphere(radius=1.0).triangulate()
        ball.save(tmp_path / "theirs.vtp", binary=binary)
        read = read_vtp(tmp_path / "theirs.vtp")
        # VTK's ascii keeps about 6 digits of its single precision.
        np.testing.assert_allclose(read.points, ball.points, atol=0.0 if binary else 1e-5)
        assert np.array_equal(read.triangles, ball.regular_faces)


def test_pieces_are_joined(tmp_path):
    root = ET.fromstring(surface_bytes("ascii"))
    (data,) = root.findall("PolyData")
    data.append(data[0])
    (tmp_path / "two.vtp").write_bytes(ET.tostring(root))
    surface = read_vtp(tmp_path / "two.vtp")
    assert len(surface.points) == 8
    assert np.array_equal(surface.triangles, np.concatenate([TRIANGLES, TRIANGLES + 4]))


@pytest.mark.parametrize("layout", LAYOUTS[::3], ids=lambda layout: "-".join(layout.values()))
def test_a_file_cut_off_anywhere_is_refused(tmp_path, layout):
    whole = surface_bytes(**layout)
    path = tmp_path / "cut.vtp"
    for size in range(0, len(whole) - len("</VTKFile>\n"), 37):
        path.write_bytes(whole[:size])
        with pytest.raises(ValueError, match=r"cut\.vtp"):
            read_vtp(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("PolyData", "ImageData"), "not VTK PolyData"),
        (
            lambda text: text.replace('header_type="UInt32"', 'compressor="vtkLZ4DataCompressor"'),
            "ZLib",
        ),
        (lambda text: text.replace(">3 6<", ">4 6<"), "not triangles"),
        (lambda text: text.replace(">0 1 2 1 3 2<", ">0 1 2 1 9 2<"), "points that are not there"),
        (lambda text: text.replace('NumberOfPoints="4"', 'NumberOfPoints="5"'), "4 of 5 points"),
        (lambda text: text.replace(">0 1 2 3<", ">0 1 2<"), "wrong length: number"),
        (lambda text: text.replace('NumberOfStrips="0"', 'NumberOfStrips="2"'), "triangle strips"),
        (lambda text: text.replace('type="Int32"', 'type="Complex"'), "type 'Complex'"),
        (lambda text: text.replace("Piece", "Peace"), "no piece"),
        (lambda text: "solid nonsense", "cannot be read"),
    ],
)
def test_malformed_files_are_refused_with_the_reason(tmp_path, change, message):
    path = tmp_path / "bad.vtp"
    path.write_text(change(surface_bytes("ascii").decode()), encoding="utf-8")
    with pytest.raises(ValueError, match=message):
        read_vtp(path)


def test_missing_files_and_folders_are_named(tmp_path):
    with pytest.raises(ValueError, match="there is no file"):
        read_vtp(tmp_path / "none.vtp")
    with pytest.raises(ValueError, match="there is no folder"):
        write_vtp(tmp_path / "none" / "a.vtp", POINTS, TRIANGLES)


def test_data_of_the_wrong_length_or_type_are_not_written(tmp_path):
    with pytest.raises(ValueError, match="one value for each"):
        write_vtp(tmp_path / "a.vtp", POINTS, TRIANGLES, point_data={"x": np.zeros(3)})
    with pytest.raises(ValueError, match="complex128"):
        write_vtp(tmp_path / "a.vtp", POINTS, TRIANGLES, cell_data={"x": np.zeros(2, complex)})
    assert not list(tmp_path.iterdir())
