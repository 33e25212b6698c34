"""Files that grow when they are read: refused in seconds and within a fixed memory."""

import base64
import pathlib
import subprocess
import sys
import zlib

import numpy as np
import pytest

from jaxfsi.anatomy.sources.surface import surface_anatomy
from jaxfsi.anatomy.surfaces.triangles import Triangles, _merged, cleaned
from jaxfsi.mesh_files import MeshFileError, read_mesh, read_msh, read_vtp
from jaxfsi.mesh_files.vtk_xml import check_xml

READER = """
import resource, sys, time
from jaxfsi.mesh_files import MeshFileError, read_mesh, read_vtp
start = time.perf_counter()
path = sys.argv[1]
try:
    read_vtp(path) if path.endswith("vtp") else read_mesh(path, unit="cm")
except MeshFileError as error:
    print(error)
try:  # ru_maxrss counts what the process that was forked held
    lines = open("/proc/self/status").read().splitlines()
    peak = next(float(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024
except (OSError, StopIteration):
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print(f"PEAK {peak:.0f} MB", f"TIME {time.perf_counter() - start:.1f}")
"""


def refusal(path: pathlib.Path) -> str:
    """What a process of its own says of a file; its memory and time are bounded."""
    done = subprocess.run(
        [sys.executable, "-c", READER, str(path)], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    assert float(done.stdout.split("PEAK ")[1].split()[0]) < 1500.0, done.stdout
    return done.stdout


def vtk_file(kind: str, array: str) -> str:
    body = {
        "UnstructuredGrid": f"<Points>{array}</Points><Cells/>",
        "PolyData": f"<Points>{array}</Points>",
    }[kind]
    return (
        f'<VTKFile type="{kind}" version="0.1" byte_order="LittleEndian" header_type="UInt32"'
        f' compressor="vtkZLibDataCompressor"><{kind}><Piece NumberOfPoints="2"'
        f' NumberOfCells="0">{body}</Piece></{kind}></VTKFile>'
    )


def packed(header: list[int], blocks: bytes) -> str:
    head = base64.b64encode(np.array(header, "<u4").tobytes())
    text = (head + base64.b64encode(blocks)).decode()
    return f'<DataArray type="Float64" NumberOfComponents="3" format="binary">{text}</DataArray>'


def bomb(n_bytes: int) -> bytes:
    """A zlib stream of zeros, put together from one flushed piece."""
    stream = zlib.compressobj(9)
    head = stream.compress(bytes(1 << 20)) + stream.flush(zlib.Z_FULL_FLUSH)
    piece = stream.compress(bytes(1 << 20)) + stream.flush(zlib.Z_FULL_FLUSH)
    return head + piece * (n_bytes >> 20) + stream.flush()


@pytest.mark.parametrize(("kind", "ending"), [("UnstructuredGrid", "vtu"), ("PolyData", "vtp")])
def test_a_block_that_unpacks_to_gigabytes_is_refused(tmp_path, kind, ending):
    squeezed = bomb(3 << 30)
    path = tmp_path / f"bomb.{ending}"
    path.write_text(vtk_file(kind, packed([1, 48, 0, len(squeezed)], squeezed)))
    assert "cannot be read" in refusal(path)


@pytest.mark.parametrize(("kind", "ending"), [("UnstructuredGrid", "vtu"), ("PolyData", "vtp")])
def test_sizes_that_are_only_announced_are_refused(tmp_path, kind, ending):
    path = tmp_path / f"large.{ending}"
    for header in ([1, 1 << 30, 0, 8], [2_000_000, 1 << 15, 0]):
        path.write_text(vtk_file(kind, packed(header, bytes(64))))
        with pytest.raises(MeshFileError, match=r"announces \d+ bytes|cannot be read"):
            read_vtp(path) if ending == "vtp" else read_mesh(path, unit="cm")


def test_numbers_of_many_digits_take_no_memory(tmp_path):
    path = tmp_path / "long.vtp"
    numbers = "1" * 1_000_000 + " 0" * 20_000
    path.write_text(
        vtk_file("PolyData", f'<DataArray type="Float64" format="ascii">{numbers}</DataArray>')
    )
    with pytest.raises(MeshFileError, match="a number has 1000000 digits; 60 are read"):
        read_vtp(path)


def test_xml_that_grows_or_is_nested_deeply_is_refused(tmp_path):
    path = tmp_path / "deep.xdmf"
    for text, says in (
        ("<Xdmf>" + "<a>" * 100_000 + "</a>" * 100_000 + "</Xdmf>", "more than 50 deep"),
        ('<!DOCTYPE x [<!ENTITY a "aaaa">]><Xdmf>&a;</Xdmf>', "declares entities"),
    ):
        path.write_text(text)
        with pytest.raises(MeshFileError, match=says):
            read_mesh(path, unit="cm")
        with pytest.raises(MeshFileError, match=says):
            check_xml(text.encode(), path)


@pytest.mark.parametrize("source", ["/etc/hosts:/data0", "../other.h5:/data0", "..:/data0"])
def test_xdmf_reads_nothing_outside_its_folder(tmp_path, source):
    path = tmp_path / "away.xdmf"
    item = f'<DataItem Dimensions="4 3" Format="HDF">{source}</DataItem>'
    path.write_text(f"<Xdmf><Domain>{item}</Domain></Xdmf>")
    with pytest.raises(MeshFileError, match="outside its own folder"):
        read_mesh(path, unit="cm")


def test_xdmf_arrays_are_as_large_as_announced_and_bounded(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "large.h5", "w") as file:
        file.create_dataset("data0", (1 << 31,), "f8", chunks=(1 << 16,), compression="gzip")
        file.create_group("group")
    path = tmp_path / "large.xdmf"
    for count, place, says in (
        (1 << 31, "/data0", "announces arrays of 17179869184 bytes"),
        (4, "/data0", "does not hold so many"),
        (4, "/group", "does not hold so many"),
        (4, "/", "does not hold so many"),
    ):
        item = f'<DataItem Dimensions="{count}" Format="HDF">large.h5:{place}</DataItem>'
        path.write_text(f"<Xdmf><Domain>{item}</Domain></Xdmf>")
        with pytest.raises(MeshFileError, match=says):
            read_mesh(path, unit="cm")


MSH = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{}\n{} 0 0 0\n$EndNodes\n$Elements\n{}\n"


@pytest.mark.parametrize("given", [(10**12, 1, 1), (1, 2_000_000_000, 1), (1, 1, 10**12)])
def test_counts_and_numbers_of_msh_files_are_bounded(tmp_path, given):
    path = tmp_path / "large.msh"
    path.write_text(MSH.format(*given) + "1 4 2 1 1 1 1 1 1\n$EndElements\n")
    with pytest.raises(MeshFileError, match="has the number"):
        read_msh(path, unit="cm")


def soup(n: int, far: float) -> Triangles:
    """Triangles with corners of their own and one corner far away."""
    rng = np.random.default_rng(1)
    points = rng.uniform(0.0, 1.0, (3 * n, 3))
    points[7, 1] = far
    return Triangles(points, np.arange(3 * n).reshape(-1, 3))


def test_one_bad_coordinate_is_named():
    with pytest.raises(ValueError, match=r"1 of 60000 corners .* outside any body, the farthest"):
        surface_anatomy(soup(20_000, 1e30), unit="cm")


def test_corners_that_all_coincide_are_merged_in_little_memory():
    surface = soup(30_000, 1e9)
    with pytest.raises(ValueError, match="shrinks to a point"):
        _merged(surface)
    with pytest.raises(ValueError, match="shrinks to a point, or is none: it spans 0"):
        cleaned(Triangles(np.ones((90_000, 3)), surface.faces))
