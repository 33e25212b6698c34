"""Data arrays of VTK's XML files: ascii, base64 or appended, compressed or not.

An array is stored as text, as base64 in its element, or as a block of the appended section at a
byte offset. Uncompressed blocks are ``[n bytes][data]``; compressed ones are ``[blocks][block
size][last block size][compressed sizes...][blocks...]``, all numbers of the file's header type.
Source: "VTK file formats", VTK user's guide, section on XML formats.
"""

import base64
import lzma
import pathlib
import re
import xml.etree.ElementTree as ET
import xml.parsers.expat
import zlib
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jaxfsi.mesh_files.refusal import MeshFileError
from jaxfsi.text_files import Malformed, regular_bytes

_BLOCK_SIZE = 1 << 20
_DEEPEST = 50  # elements within each other
_TYPES = {
    "Int8": "i1",
    "UInt8": "u1",
    "Int16": "i2",
    "UInt16": "u2",
    "Int32": "i4",
    "UInt32": "u4",
    "Int64": "i8",
    "UInt64": "u8",
    "Float32": "f4",
    "Float64": "f8",
}
_NAMES = {np.dtype(code): name for name, code in _TYPES.items()}
LARGEST_ARRAY = 1 << 28
"""Bytes that the arrays of a file may hold together: a mesh of four million tetrahedra."""

_LONGEST_NUMBER = 60  # digits of a number in text

Decompress = Callable[[bytes, int], bytes]


def _unzipped(block: bytes, size: int) -> bytes:
    """Content of a zlib block, of which no more is made than its size."""
    return zlib.decompressobj().decompress(block, size + 1)


def _unpacked(block: bytes, size: int) -> bytes:
    """The same of an lzma block."""
    return lzma.LZMADecompressor().decompress(block, size + 1)


_DECOMPRESS: dict[str, Decompress] = {
    "vtkZLibDataCompressor": _unzipped,
    "vtkLZMADataCompressor": _unpacked,
}


class VtkXml(NamedTuple):
    """A VTK XML file taken apart.

    Attributes:
        root: its elements, without the appended data.
        byte_order: ``<`` or ``>``.
        header: type of the numbers before each block.
        decompress: undoes the compression of a block up to a size; None without compression.
        appended: the appended section after its underscore, still encoded.
        base64: whether the appended section is base64 text.
        offsets: where arrays start in the appended section, rising.
    """

    root: ET.Element
    byte_order: str
    header: np.dtype
    decompress: Decompress | None
    appended: bytes
    base64: bool
    offsets: tuple[int, ...]


def open_vtk_xml(path: pathlib.Path, kind: str) -> VtkXml:
    """Take a file apart.

    Args:
        path: the file.
        kind: ``PolyData``, ``UnstructuredGrid``, ...

    Raises:
        MeshFileError: the file is of another kind, or compressed in a way not known here.
    """
    text, appended, is_base64 = _split_appended(regular_bytes(path), path)
    check_xml(text, path)
    root = ET.fromstring(text)
    if root.tag != "VTKFile" or root.get("type") != kind:
        raise MeshFileError(
            f"{path} holds {root.get('type') or root.tag}, not VTK {kind}. Give such a file."
        )
    compressor = root.get("compressor")
    if compressor and compressor not in _DECOMPRESS:
        raise MeshFileError(
            f"{path} is compressed by {compressor}, which needs VTK. Save it with ZLib or none."
        )
    order = ">" if root.get("byte_order") == "BigEndian" else "<"
    offsets = {int(array.get("offset", 0)) for array in root.iter("DataArray")}
    return VtkXml(
        root=root,
        byte_order=order,
        header=np.dtype(order + _TYPES[root.get("header_type", "UInt32")]),
        decompress=_DECOMPRESS[compressor] if compressor else None,
        appended=appended,
        base64=is_base64,
        offsets=tuple(sorted(offsets)),
    )


def check_xml(text: bytes, path: pathlib.Path) -> None:
    """Refuse XML that grows when it is read, or that is nested deeper than any mesh file.

    Raises:
        MeshFileError: it declares a document type, or is nested too deeply.
        xml.parsers.expat.ExpatError: it is no XML.
    """
    parser = xml.parsers.expat.ParserCreate()
    depth = 0

    def opened(*_: object) -> None:
        nonlocal depth
        depth += 1
        if depth > _DEEPEST:
            raise MeshFileError(
                f"{path} nests its elements more than {_DEEPEST} deep. No mesh file does; write it"
                " again."
            )

    def closed(*_: object) -> None:
        nonlocal depth
        depth -= 1

    def declared(*_: object) -> None:
        raise MeshFileError(
            f"{path} declares entities of its own, which no mesh file needs. Write it again"
            " without them."
        )

    parser.StartElementHandler = opened
    parser.EndElementHandler = closed
    parser.EntityDeclHandler = declared
    parser.Parse(text, True)


def check_vtk_xml(path: pathlib.Path, kind: str) -> None:
    """Take every array of a file apart once, within the bounds, before another reader does.

    Raises:
        MeshFileError: the file is of another kind, or an array is larger than allowed.
        ValueError: an array is not what its header says.
    """
    file = open_vtk_xml(path, kind)
    total = 0
    for element in file.root.iter("DataArray"):
        form, text = element.get("format", "ascii"), (element.text or "").encode()
        if form == "ascii":
            _numbers_in(text)
        else:
            total += len(_block(file, _stored(file, element, form, text)))
        if total > LARGEST_ARRAY:
            raise MeshFileError(
                f"the arrays of {path} hold more than {LARGEST_ARRAY} bytes together. Write a"
                " smaller mesh."
            )


def _split_appended(raw: bytes, path: pathlib.Path) -> tuple[bytes, bytes, bool]:
    """XML without the appended section, which need not be XML; the section; is it base64."""
    opening = re.search(rb"<AppendedData[^>]*>", raw)
    if opening is None:
        return raw, b"", False
    close = raw.rfind(b"</AppendedData>")
    start = raw.find(b"_", opening.end())
    if close < 0 or start < 0:
        raise MeshFileError(f"{path} is truncated in its appended data. Write it again.")
    appended = raw[start + 1 : close]
    is_base64 = b"base64" in opening.group()
    return (
        raw[: opening.end()] + raw[close:],
        appended.rstrip() if is_base64 else appended,
        is_base64,
    )


def _unbase64(text: bytes) -> bytes:
    """Decode base64 pieces written one after the other, each with its own padding."""
    packed = b"".join(text.split())
    return b"".join(base64.b64decode(piece) for piece in re.findall(rb"[^=]+={0,2}", packed))


def _block(file: VtkXml, data: bytes) -> bytes:
    """Content of a block with its header."""
    size = file.header.itemsize

    def numbers(start: int, count: int) -> list[int]:
        return np.frombuffer(data, file.header, count, start * size).tolist()

    if file.decompress is None:
        (n_bytes,) = numbers(0, 1)
        content = data[size : size + n_bytes]
    else:
        n_blocks, block_size, last_size = numbers(0, 3)
        n_bytes = (
            block_size * n_blocks if not last_size else block_size * (n_blocks - 1) + last_size
        )
        if n_bytes > LARGEST_ARRAY or n_blocks > len(data):
            raise MeshFileError(
                f"a data array announces {n_bytes} bytes in {n_blocks} blocks, more than"
                f" {LARGEST_ARRAY} bytes in {len(data)}. Write a smaller mesh."
            )
        lengths = np.array(numbers(3, n_blocks), dtype=np.int64)
        ends = size * (3 + n_blocks) + np.cumsum(lengths)
        starts = ends - lengths
        decompress = file.decompress
        content = b"".join(
            decompress(data[start:end], block_size)
            for start, end in zip(starts.tolist(), ends.tolist(), strict=True)
        )
    if len(content) != n_bytes:
        raise Malformed(f"a data array has {len(content)} of {n_bytes} bytes")
    return content


def read_array(file: VtkXml, element: ET.Element) -> np.ndarray:
    """Values of one ``DataArray``, with one row per tuple where it has several components."""
    name = element.get("Name", "")
    kind = element.get("type", "")
    if kind not in _TYPES:
        raise Malformed(f"the data array {name!r} has the type {kind!r}")
    dtype = np.dtype(file.byte_order + _TYPES[kind])
    form = element.get("format", "ascii")
    text = (element.text or "").encode()
    if form == "ascii":
        values = np.array(_numbers_in(text), dtype=np.bytes_).astype(dtype)
    else:
        values = np.frombuffer(_block(file, _stored(file, element, form, text)), dtype)
    values = values.astype(dtype.newbyteorder("="))
    n_components = int(element.get("NumberOfComponents", 1))
    return values.reshape(-1, n_components) if n_components > 1 else values


def _numbers_in(text: bytes) -> list[bytes]:
    """Numbers in text; one that is longer than any number is refused."""
    numbers = text.split()
    longest = max(map(len, numbers), default=0)
    if longest > _LONGEST_NUMBER:
        raise Malformed(f"a number has {longest} digits; {_LONGEST_NUMBER} are read")
    return numbers


def _stored(file: VtkXml, element: ET.Element, form: str, text: bytes) -> bytes:
    if form == "binary":
        return _unbase64(text)
    start = int(element.get("offset", 0))
    if not file.base64:
        return file.appended[start:]
    end = min((offset for offset in file.offsets if offset > start), default=len(file.appended))
    return _unbase64(file.appended[start:end])


def array_element(name: str, values: np.ndarray) -> ET.Element:
    """A ``DataArray`` element with its values as base64 of zlib blocks (UInt32 header)."""
    values = np.ascontiguousarray(values)
    kind = _NAMES.get(values.dtype)
    if kind is None:
        raise MeshFileError(
            f"the data array {name!r} is of {values.dtype}, which VTK files do not hold. Convert it"
            " to integers or floats."
        )
    element = ET.Element("DataArray", type=kind, Name=name, format="binary")
    if values.ndim == 2:
        element.set("NumberOfComponents", str(values.shape[1]))
    data = values.astype(values.dtype.newbyteorder("<")).tobytes()
    blocks = [
        zlib.compress(data[start : start + _BLOCK_SIZE])
        for start in range(0, len(data), _BLOCK_SIZE)
    ]
    header = [len(blocks), _BLOCK_SIZE, len(data) % _BLOCK_SIZE, *(len(block) for block in blocks)]
    packed = base64.b64encode(np.array(header, dtype="<u4").tobytes())
    element.text = (packed + base64.b64encode(b"".join(blocks))).decode()
    return element
