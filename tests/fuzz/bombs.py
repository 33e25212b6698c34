# ruff: noqa: E501  tables of damage read best in long rows
"""Small files that say they are large: declared sizes, compressed zeros, endless headers."""

import base64
import random
import struct
import zlib
from collections.abc import Callable

from tests.fuzz.toml_text import Tables
from tests.fuzz.trial import Files

Made = tuple[Files, Tables, str]


def _vtu(arrays: str, points: int, cells: int, head: str = "") -> bytes:
    return (
        f'<?xml version="1.0"?><VTKFile type="UnstructuredGrid" version="1.0" '
        f'byte_order="LittleEndian" {head}><UnstructuredGrid>'
        f'<Piece NumberOfPoints="{points}" NumberOfCells="{cells}">{arrays}</Piece>'
        "</UnstructuredGrid></VTKFile>"
    ).encode()


_ZLIB = 'header_type="UInt64" compressor="vtkZLibDataCompressor"'


def _blocks(count: int, size: int, last: int, sizes: list[int], body: bytes) -> str:
    head = struct.pack(f"<{3 + len(sizes)}Q", count, size, last, *sizes)
    return base64.b64encode(head).decode() + base64.b64encode(body).decode()


def _points(text: str) -> str:
    return (
        '<Points><DataArray type="Float64" Name="Points" NumberOfComponents="3" format="binary">'
        f"{text}</DataArray></Points>"
        '<Cells><DataArray type="Int64" Name="connectivity" format="ascii">0 1 2 3</DataArray>'
        '<DataArray type="Int64" Name="offsets" format="ascii">4</DataArray>'
        '<DataArray type="UInt8" Name="types" format="ascii">10</DataArray></Cells>'
    )


def _as_mesh(data: bytes, suffix: str = ".vtu") -> Made:
    anatomy = {"kind": "mesh", "path": f"mesh{suffix}", "unit": "cm"}
    return {f"mesh{suffix}": data}, anatomy, f"mesh{suffix}"


def _as_surface(data: bytes, file: str) -> Made:
    return {file: data}, {"kind": "surface", "surface": file, "unit": "mm"}, file


def compressed_zeros(rng: random.Random) -> Made:
    """Megabytes that become gigabytes."""
    size = rng.choice([2**31, 3 * 2**30])
    packer = zlib.compressobj(9)
    step = bytes(2**24)
    body = b"".join(packer.compress(step) for _ in range(size // 2**24)) + packer.flush()
    text = _blocks(1, size, size, [len(body)], body)
    return _as_mesh(_vtu(_points(text), size // 24, 1, _ZLIB))


def many_blocks(_: random.Random) -> Made:
    """A header of two million blocks."""
    count = 2_000_000
    text = _blocks(count, 8, 8, [8] * count, b"")
    return _as_mesh(_vtu(_points(text), 10, 1, _ZLIB))


def declared_blocks(rng: random.Random) -> Made:
    """A number of blocks that is not there."""
    count = rng.choice([2**40, 2**62, 2**32, 2**63 - 1])
    text = _blocks(count, 2**30, 2**30, [10, 10], b"abc")
    return _as_mesh(_vtu(_points(text), 10, 1, _ZLIB))


def declared_points(rng: random.Random) -> Made:
    """A number of points that is not there."""
    count = rng.choice([2**31, 10**12, 2**62, -1])
    text = base64.b64encode(struct.pack("<Q", 240) + bytes(240)).decode()
    return _as_mesh(_vtu(_points(text), count, 1, 'header_type="UInt64"'))


def binary_stl(rng: random.Random) -> Made:
    """A binary STL that declares a great many triangles."""
    count = rng.choice([2**32 - 1, 2**31, 10**9])
    return _as_surface(b"x".ljust(80) + struct.pack("<I", count) + bytes(50 * 20), "lumen.stl")


def large_stl(rng: random.Random) -> Made:
    """A million triangles of no size."""
    count = 1_000_000
    one = struct.pack("<12fH", *([rng.choice([0.0, 1.0])] * 12), 0)
    return _as_surface(b"x".ljust(80) + struct.pack("<I", count) + one * count, "lumen.stl")


def ply_header(rng: random.Random) -> Made:
    """A PLY that declares a great many points."""
    count = rng.choice([10**12, 2**31, 10**9])
    text = (
        f"ply\nformat {rng.choice(['ascii', 'binary_little_endian'])} 1.0\n"
        f"element vertex {count}\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n3 0 1 2\n"
    )
    return _as_surface(text.encode(), "lumen.ply")


def ply_long_header(_: random.Random) -> Made:
    text = "ply\nformat ascii 1.0\n" + "comment x\n" * 2_000_000 + "end_header\n"
    return _as_surface(text.encode(), "lumen.ply")


def msh_counts(rng: random.Random) -> Made:
    """A gmsh file that declares a great many nodes."""
    count = rng.choice([10**12, 2**31, 2**62, -5])
    if rng.random() < 0.5:
        text = f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{count}\n1 0 0 0\n$EndNodes\n"
        text += f"$Elements\n{count}\n1 4 2 1 1 1 2 3 4\n$EndElements\n"
    else:
        text = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n0 0 0 1\n1 0 0 0 1 1 1 0 0\n"
        text += f"$EndEntities\n$Nodes\n1 {count} 1 {count}\n3 1 0 {count}\n1\n0 0 0\n$EndNodes\n"
        text += f"$Elements\n1 {count} 1 {count}\n3 1 4 {count}\n1 1 2 3 4\n$EndElements\n"
    return _as_mesh(text.encode(), ".msh")


def msh_binary_counts(rng: random.Random) -> Made:
    count = rng.choice([2**31 - 1, 2**30])
    data = b"$MeshFormat\n2.2 1 8\n" + struct.pack("<i", 1) + b"\n$EndMeshFormat\n$Nodes\n"
    data += str(count).encode() + b"\n" + bytes(280) + b"\n$EndNodes\n"
    return _as_mesh(data, ".msh")


def xdmf_sizes(rng: random.Random) -> Made:
    """An XDMF whose arrays are declared far larger than they are."""
    count = rng.choice([10**10, 2**40])
    where = rng.choice(["inline", "file", "device"])
    data = {"inline": "0 0 0", "file": "mesh.h5:/data0", "device": "/dev/zero:/data0"}[where]
    form = "XML" if where == "inline" else "HDF"
    text = (
        '<Xdmf Version="3.0"><Domain><Grid Name="Grid"><Geometry GeometryType="XYZ">'
        f'<DataItem DataType="Float" Dimensions="{count} 3" Format="{form}" Precision="8">{data}'
        '</DataItem></Geometry><Topology TopologyType="Tetrahedron" '
        f'NumberOfElements="{count}"><DataItem DataType="Int" Dimensions="{count} 4" Format="{form}" '
        f'Precision="8">{data}</DataItem></Topology></Grid></Domain></Xdmf>'
    )
    return _as_mesh(text.encode(), ".xdmf")


def h5_sparse(_: random.Random) -> Made:
    """An HDF5 file of a few kilobytes whose arrays are gigabytes of zeros."""
    import pathlib
    import tempfile

    import h5py

    with tempfile.TemporaryDirectory() as name:
        path = pathlib.Path(name, "mesh.h5")
        with h5py.File(path, "w") as file:
            file.create_dataset("data0", (2**28, 3), "f8", chunks=(2**16, 3), compression="gzip")
            file.create_dataset("data1", (2**28, 4), "i8", chunks=(2**16, 4), compression="gzip")
        data = path.read_bytes()
    text = (
        '<Xdmf Version="3.0"><Domain><Grid Name="Grid"><Geometry GeometryType="XYZ">'
        f'<DataItem DataType="Float" Dimensions="{2**28} 3" Format="HDF" Precision="8">mesh.h5:/data0'
        '</DataItem></Geometry><Topology TopologyType="Tetrahedron" '
        f'NumberOfElements="{2**28}"><DataItem DataType="Int" Dimensions="{2**28} 4" Format="HDF" '
        'Precision="8">mesh.h5:/data1</DataItem></Topology></Grid></Domain></Xdmf>'
    )
    files, anatomy, blame = _as_mesh(text.encode(), ".xdmf")
    return {**files, "mesh.h5": data}, anatomy, blame


def xml_entities(_: random.Random) -> Made:
    """A text of entities that grow tenfold each."""
    lines = ['<!ENTITY a0 "0 0 0 0 0 0 0 0 0 0 ">']
    lines += [f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 10)]
    text = '<?xml version="1.0"?><!DOCTYPE x [' + "".join(lines) + "]>"
    text += (
        '<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian">'
        '<UnstructuredGrid><Piece NumberOfPoints="4" NumberOfCells="1"><Points>'
        '<DataArray type="Float64" NumberOfComponents="3" format="ascii">&a9;</DataArray></Points>'
        "</Piece></UnstructuredGrid></VTKFile>"
    )
    return _as_mesh(text.encode())


def xml_file(_: random.Random) -> Made:
    """An entity that names another file of the machine."""
    text = (
        '<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>'
        '<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian">&a;</VTKFile>'
    )
    return _as_mesh(text.encode())


def deep_xml(_: random.Random) -> Made:
    return _as_mesh(('<?xml version="1.0"?>' + "<a>" * 200_000).encode())


def vtp_counts(rng: random.Random) -> Made:
    count = rng.choice([2**31, 10**12])
    text = (
        '<?xml version="1.0"?><VTKFile type="PolyData" version="0.1" byte_order="LittleEndian">'
        f'<PolyData><Piece NumberOfPoints="{count}" NumberOfPolys="{count}"><Points>'
        '<DataArray type="Float64" NumberOfComponents="3" format="ascii">0 0 0</DataArray></Points>'
        '<Polys><DataArray type="Int64" Name="connectivity" format="ascii">0 1 2</DataArray>'
        '<DataArray type="Int64" Name="offsets" format="ascii">3</DataArray></Polys>'
        "</Piece></PolyData></VTKFile>"
    )
    return _as_surface(text.encode(), "lumen.vtp")


def the_root(rng: random.Random) -> Made:
    """A mesh-complete folder that is the whole machine."""
    place = rng.choice(["/", "/usr", "..", "/proc", "/dev"])
    return {}, {"kind": "mesh", "path": place, "unit": "cm"}, ""


def far_apart(_: random.Random) -> Made:
    """Two pieces of a surface a kilometre apart: a grid over both would be endless."""
    import numpy as np

    from tests.fuzz.shapes import lumen, stl_binary

    points, faces = lumen()
    both = np.concatenate([points, points + 1e6])
    return _as_surface(stl_binary(both, np.concatenate([faces, faces + len(points)])), "lumen.stl")


BOMBS: dict[str, Callable[[random.Random], Made]] = {
    made.__name__.replace("_", " "): made
    for made in (
        compressed_zeros, many_blocks, declared_blocks, declared_points, binary_stl, large_stl,
        ply_header, ply_long_header, msh_counts, msh_binary_counts, xdmf_sizes, h5_sparse,
        xml_entities, xml_file, deep_xml, vtp_counts, the_root, far_apart,
    )
}  # fmt: skip


def bomb(rng: random.Random, name: str) -> Made:
    """Files, the table of the anatomy, and the file to blame."""
    return BOMBS[name](rng)
