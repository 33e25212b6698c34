"""Small good geometries: contours of a vessel with all their files, a surface, a mesh."""

import struct

import numpy as np

from tests.fuzz.trial import Files

FRAMES, AROUND = 14, 48


def contour_rows() -> np.ndarray:
    """Rows frame, x, y, z [mm]: a vessel with a slit, the ostium at the highest frame."""
    angle = 2.0 * np.pi * np.arange(AROUND) / AROUND
    rows = []
    for k in range(FRAMES):
        share = k / (FRAMES - 1)
        narrow = 1.0 - 0.45 * np.exp(-(((share - 0.6) / 0.2) ** 2))
        a, b = 2.2 * (1.0 + 0.2 * (1.0 - narrow)), 2.0 * narrow
        z = 18.0 * share
        rows += [[k + 1, 4.0 + a * np.cos(t), 4.0 + b * np.sin(t), z] for t in angle]
    return np.array(rows)


def contour_text(rows: np.ndarray, separator: str = "\t") -> str:
    return "".join(
        separator.join([str(int(row[0])), *(f"{x:.6f}" for x in row[1:])]) + "\n"
        if np.isfinite(row[0]) and row[0] == int(row[0])
        else separator.join(f"{x:.6g}" for x in row) + "\n"
        for row in rows
    )


def centre_line() -> np.ndarray:
    """Points x, y, z [mm] in the coordinates of the CT, from the ostium on."""
    s = np.linspace(0.0, 40.0, 60)
    return np.stack([100.0 + s, -50.0 + 0.004 * s**2, 900.0 - 0.2 * s], axis=1)


def frame_table() -> str:
    """Frame, position [mm] and measured tissue [mm]; the most distal frame is first."""
    rows = ["frame,position,measurement_1"]
    for k in range(FRAMES):
        tissue = f"{0.6 + 0.02 * k:.2f}" if 5 <= k <= 11 else ""
        rows.append(f"{k + 1},{18.0 * (1.0 - k / (FRAMES - 1)):.3f},{tissue}")
    return "\n".join(rows) + "\n"


def contour_files() -> Files:
    """All files of an anatomy from ultrasound."""
    line = "".join(",".join(f"{x:.5f}" for x in row) + "\n" for row in centre_line())
    return {
        "contours.csv": contour_text(contour_rows()).encode(),
        "frames.csv": frame_table().encode(),
        "reference.csv": f"{FRAMES}\t4.0\t12.0\t18.0\n".encode(),
        "centerline.csv": line.encode(),
    }


def lumen(n_around: int = 24, n_along: int = 16) -> tuple[np.ndarray, np.ndarray]:
    """A closed tube with flat ends along z, radius 5 mm, length 30 mm: points and triangles."""
    angle = 2.0 * np.pi * np.arange(n_around) / n_around
    ring = np.stack([5.0 * np.cos(angle), 5.0 * np.sin(angle)], axis=1)
    heights = np.linspace(-15.0, 15.0, n_along)
    points = [np.column_stack([ring, np.full(n_around, z)]) for z in heights]
    points += [np.array([[0.0, 0.0, -15.0], [0.0, 0.0, 15.0]])]
    triangles = []
    for k in range(n_along - 1):
        for i in range(n_around):
            a, b = k * n_around + i, k * n_around + (i + 1) % n_around
            c, d = a + n_around, b + n_around
            triangles += [[a, b, d], [a, d, c]]
    low, high = n_along * n_around, n_along * n_around + 1
    top = (n_along - 1) * n_around
    for i in range(n_around):
        j = (i + 1) % n_around
        triangles += [[low, j, i], [high, top + i, top + j]]
    return np.concatenate(points), np.array(triangles)


def stl_ascii(points: np.ndarray, triangles: np.ndarray) -> bytes:
    lines = ["solid lumen"]
    for a, b, c in points[triangles]:
        lines += ["facet normal 0 0 0", " outer loop"]
        lines += [f"  vertex {p[0]:.9g} {p[1]:.9g} {p[2]:.9g}" for p in (a, b, c)]
        lines += [" endloop", "endfacet"]
    return ("\n".join([*lines, "endsolid lumen"]) + "\n").encode()


def stl_binary(points: np.ndarray, triangles: np.ndarray) -> bytes:
    body = b"".join(
        struct.pack("<12fH", 0.0, 0.0, 0.0, *np.asarray(corners, np.float32).ravel().tolist(), 0)
        for corners in points[triangles]
    )
    return b"lumen".ljust(80, b"\0") + struct.pack("<I", len(triangles)) + body


def ply_ascii(points: np.ndarray, triangles: np.ndarray) -> bytes:
    head = ["ply", "format ascii 1.0", f"element vertex {len(points)}"]
    head += [f"property float {axis}" for axis in "xyz"]
    head += [
        f"element face {len(triangles)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    rows = [" ".join(f"{x:.9g}" for x in p) for p in points]
    rows += [" ".join(map(str, [3, *t])) for t in triangles.tolist()]
    return ("\n".join([*head, *rows]) + "\n").encode()


def vtp_ascii(points: np.ndarray, triangles: np.ndarray) -> bytes:
    def array(kind: str, name: str, values: np.ndarray, components: int = 1) -> str:
        text = " ".join(f"{x:.9g}" if kind == "Float64" else str(int(x)) for x in values.ravel())
        return (
            f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{components}" '
            f'format="ascii">{text}</DataArray>'
        )

    offsets = 3 * np.arange(1, len(triangles) + 1)
    return (
        '<?xml version="1.0"?><VTKFile type="PolyData" version="0.1" byte_order="LittleEndian">'
        f'<PolyData><Piece NumberOfPoints="{len(points)}" NumberOfVerts="0" NumberOfLines="0" '
        f'NumberOfStrips="0" NumberOfPolys="{len(triangles)}"><Points>'
        + array("Float64", "Points", points, 3)
        + "</Points><Polys>"
        + array("Int64", "connectivity", triangles)
        + array("Int64", "offsets", offsets)
        + "</Polys></Piece></PolyData></VTKFile>\n"
    ).encode()


def lumen_stl() -> bytes:
    """The good surface as a binary STL."""
    return stl_binary(*lumen())
