"""Bad input of `jaxfsi mesh`: one clear error each, exit status 2, nothing written."""

import dataclasses
import pathlib
from collections.abc import Callable
from typing import NamedTuple

import meshio
import numpy as np
import pytest
import trimesh

from jaxfsi.mesh_files import write_mesh
from jaxfsi.meshing import ring
from jaxfsi.meshing import tube as structured
from study import demo_case_path
from tests.study import tube_case

BUNDLED = demo_case_path().parent

SURFACE = """\
[anatomy]
kind = "surface"
surface = "lumen.stl"
unit = "cm"
"""
IVUS = """\
[anatomy]
kind = "ivus"
contours = "contours.csv"
centerline = "centerline.csv"
aorta_radius_mm = 14.0
septum_mm = 0.8
"""
WALL = "[wall]\nthickness_per_radius = {{ factor = {}, min_mm = {}, max_mm = {} }}\n"


class Lumen(NamedTuple):
    """Corners and triangles of a surface."""

    points: np.ndarray
    faces: np.ndarray


def tube(radius: float = 1.0, length: float = 4.0, n: int = 64, layers: int = 40) -> Lumen:
    """An open tube along z."""
    theta = 2.0 * np.pi * np.arange(n) / n
    z = np.linspace(0.0, length, layers + 1)
    t, h = (x.ravel() for x in np.meshgrid(theta, z))
    points = np.stack([radius * np.cos(t), radius * np.sin(t), h], axis=1)
    i = np.arange(n)
    low = (n * np.arange(layers)[:, None] + i).ravel()
    right = (n * np.arange(layers)[:, None] + (i + 1) % n).ravel()
    faces = [np.stack([low, right, right + n], 1), np.stack([low, right + n, low + n], 1)]
    return Lumen(points, np.concatenate(faces))


def save(folder: pathlib.Path, lumen: Lumen, name: str = "lumen.stl") -> bytes:
    trimesh.Trimesh(*lumen, process=False).export(folder / name)
    return (folder / name).read_bytes()


def with_hole(folder: pathlib.Path) -> str:
    pipe = tube()
    middle = pipe.points[pipe.faces].mean(axis=1)
    save(
        folder,
        Lumen(pipe.points, pipe.faces[np.linalg.norm(middle - [1.0, 0.0, 2.0], axis=1) > 0.5]),
    )
    return SURFACE


def with_dent(folder: pathlib.Path) -> str:
    points, faces = tube()
    dent = np.exp(-((points[:, 2] - 2.0) ** 2 + points[:, 1] ** 2) / 0.05) * (points[:, 0] > 0.0)
    save(folder, Lumen(points - 2.4 * dent[:, None] * [1.0, 0.0, 0.0], faces))
    return SURFACE


def apart(folder: pathlib.Path) -> str:
    aorta, coronary = tube(), tube(0.2, 2.0)
    moved = coronary.points + np.array([1.5, 0.0, 1.0])
    faces = np.concatenate([aorta.faces, coronary.faces + len(aorta.points)])
    save(folder, Lumen(np.concatenate([aorta.points, moved]), faces))
    return SURFACE


def thick(folder: pathlib.Path) -> str:
    save(folder, tube(0.4, 3.0))
    return SURFACE + WALL.format(0.9, 4.5, 5.0)


def ball(folder: pathlib.Path) -> str:
    sphere = trimesh.creation.icosphere(subdivisions=3)
    save(folder, Lumen(sphere.vertices, sphere.faces))
    return SURFACE


def in_mm(folder: pathlib.Path) -> str:
    save(folder, Lumen(10.0 * tube().points, tube().faces))
    return SURFACE


def scaled_mesh(folder: pathlib.Path, factor: float, name: str = "aorta_inlet") -> str:
    mesh = tube_case.three_openings()
    labels = {"aorta_inlet": name, "aorta_inlet_ring": f"{name}_ring"}
    if name != "aorta_inlet":
        labels |= {f"aorta_outlet{end}": f"outflow{end}" for end in ("", "_ring")}
    names = tuple(labels.get(label, label) for label in mesh.label_names)
    mesh = dataclasses.replace(mesh, points=factor * mesh.points, label_names=names)
    write_mesh(folder / "mesh.vtu", mesh, unit="cm", any_size=True)
    return '[anatomy]\nkind = "mesh"\npath = "mesh.vtu"\nunit = "cm"\n'


def empty(folder: pathlib.Path) -> str:
    (folder / "lumen.stl").write_bytes(b"")
    return SURFACE


def truncated(folder: pathlib.Path) -> str:
    data = save(folder, tube())
    (folder / "lumen.stl").write_bytes(data[: 2 * len(data) // 3])
    return SURFACE


def ivus(folder: pathlib.Path, *, contours: str | None = None, line: str | None = None) -> str:
    """The bundled patient with one of its files replaced."""
    own = (BUNDLED / "rest_diastole_contours.csv").read_text()
    (folder / "contours.csv").write_text(own if contours is None else contours)
    own = (BUNDLED / "centerline.csv").read_text()
    (folder / "centerline.csv").write_text(own if line is None else line)
    return IVUS


def measured(folder: pathlib.Path, aorta: str) -> str:
    """The bundled patient with another centre line of the aorta."""
    (folder / "aorta.csv").write_text(aorta)
    return ivus(folder).replace("aorta_radius_mm = 14.0", 'aorta_centerline = "aorta.csv"')


def moved_aorta(distance: float) -> str:
    """The bundled centre line of the aorta, moved along x [mm]."""
    rows = np.loadtxt(BUNDLED / "aorta_centerline.csv", delimiter=",")
    rows[:, 0] += distance
    return "\n".join(",".join(f"{x:.3f}" for x in row) for row in rows) + "\n"


def scaled_contours(factor: float, frames: slice) -> str:
    """The bundled contours with the lumen of some frames scaled about its middle."""
    rows = np.loadtxt(BUNDLED / "rest_diastole_contours.csv")
    for frame in np.unique(rows[:, 0])[frames]:
        own = rows[:, 0] == frame
        middle = rows[own, 1:3].mean(axis=0)
        rows[own, 1:3] = middle + factor * (rows[own, 1:3] - middle)
    return "\n".join("\t".join(f"{x:.9g}" for x in row) for row in rows) + "\n"


def centre_line_in_cm() -> str:
    text = (BUNDLED / "centerline.csv").read_text().splitlines()
    separator = "," if "," in text[-1] else None
    kept = [line for line in text if line and (line[0].isdigit() or line[0] == "-")]
    rows = np.array([[float(x) for x in line.split(separator)] for line in kept])
    return "\n".join(",".join(f"{0.1 * x:.9g}" for x in row) for row in rows) + "\n"


def finished(folder: pathlib.Path, *, share: float = 1.0, unit: str = "cm") -> str:
    """A finished mesh in cm, of which only a share of the bytes is kept."""
    mesh = structured(radius=0.5, length=2.0, thickness=0.1, n_around=12, n_axial=6, n_layers=2)
    write_mesh(folder / "mesh.vtu", mesh, unit="cm")
    data = (folder / "mesh.vtu").read_bytes()
    (folder / "mesh.vtu").write_bytes(data[: int(share * len(data))])
    return f'[anatomy]\nkind = "mesh"\npath = "mesh.vtu"\nunit = "{unit}"\n'


def damaged(folder: pathlib.Path, **changed: np.ndarray) -> str:
    """A finished mesh with other tetrahedra or regions."""
    mesh = structured(radius=0.5, length=2.0, thickness=0.1, n_around=12, n_axial=6, n_layers=2)
    write_mesh(folder / "mesh.msh", dataclasses.replace(mesh, **changed), unit="cm")
    return '[anatomy]\nkind = "mesh"\npath = "mesh.msh"\nunit = "cm"\n'


def with_inverted(folder: pathlib.Path) -> str:
    mesh = structured(radius=0.5, length=2.0, thickness=0.1, n_around=12, n_axial=6, n_layers=2)
    tets = mesh.tets.copy()
    tets[7] = tets[7][[1, 0, 2, 3]]
    return damaged(folder, tets=tets)


def hollow(folder: pathlib.Path) -> str:
    mesh = structured(radius=0.5, length=2.0, thickness=0.1, n_around=12, n_axial=6, n_layers=2)
    return damaged(folder, tets=mesh.tets[1:], region=mesh.region[1:])


def all_wall(folder: pathlib.Path) -> str:
    wall = ring(radius=0.5, length=0.5, thickness=0.1, n_around=12, n_axial=2)
    write_mesh(folder / "mesh.vtu", wall, unit="cm")
    return '[anatomy]\nkind = "mesh"\npath = "mesh.vtu"\nunit = "cm"\n'


def relabelled(folder: pathlib.Path) -> str:
    return finished(folder) + '[anatomy.labels]\nnope = "aorta_inlet"\n'


def without_numbers(folder: pathlib.Path) -> str:
    """A finished mesh with two coordinates that are not numbers."""
    text = finished(folder)
    file = meshio.vtu.read(folder / "mesh.vtu")
    file.points[0, :2] = np.nan
    file.write(folder / "mesh.vtu")
    return text


BAD: dict[str, tuple[Callable[[pathlib.Path], str], str]] = {
    "open surface": (with_hole, "hole in the wall"),
    "self-intersection": (with_dent, "intersects itself"),
    "lumen thinner than the element": (
        lambda folder: (
            ivus(folder, contours=scaled_contours(0.06, slice(8, 11)))
            + WALL.format(0.1, 0.02, 0.05)
        ),
        "thinner than two of the smallest elements",
    ),
    "aorta and coronary apart": (apart, "does not touch"),
    "thickness larger than the radius": (thick, "thicker than the vessel's radius"),
    "caps not found": (ball, "0 caps"),
    "surface ten times too large": (in_mm, "unit (cm) is probably wrong"),
    "centre line ten times too small": (
        lambda folder: ivus(folder, line=centre_line_in_cm()),
        "in mm",
    ),
    "aorta without radii": (
        lambda folder: measured(folder, (BUNDLED / "centerline.csv").read_text()),
        "aorta.csv: the centre line has no radii",
    ),
    "aorta of another patient": (
        lambda folder: measured(folder, moved_aorta(100.0)),
        "does not run beside this aorta",
    ),
    "contours ten times too small": (
        lambda folder: ivus(folder, contours=scaled_contours(0.1, slice(None))),
        "check that x, y and z are in mm",
    ),
    "empty surface": (empty, "empty"),
    "truncated surface": (truncated, "truncated"),
    "empty contours": (lambda folder: ivus(folder, contours=""), "empty"),
    "truncated contours": (
        lambda folder: ivus(
            folder, contours=(BUNDLED / "rest_diastole_contours.csv").read_text()[:200_003]
        ),
        "3 values instead of 4",
    ),
    "mesh ten times too large": (
        lambda folder: scaled_mesh(folder, 10.0),
        "the largest opening, aorta_inlet, has a radius of 9.67 cm, expected 0.3..4 cm: the unit"
        " (cm) is probably wrong",
    ),
    "mesh ten times too small": (
        lambda folder: scaled_mesh(folder, 0.12),
        "aorta_inlet, has a radius of 0.116 cm, expected 0.3..4 cm: the unit (cm)",
    ),
    "mesh of a coronary ten times too large": (
        lambda folder: scaled_mesh(folder, 12.0, "inflow"),
        "inflow, has a radius of 11.6 cm, expected 0.05..4 cm: the unit (cm) is probably wrong",
    ),
    "mesh in another unit": (lambda folder: finished(folder, unit="mm"), "lengths are in cm"),
    "truncated mesh": (lambda folder: finished(folder, share=0.6), "mesh.vtu"),
    "empty mesh": (lambda folder: finished(folder, share=0.0), "the file is empty"),
    "label that the mesh does not have": (
        relabelled,
        "no label 'nope'; there are inlet, outlet, interface",
    ),
    "inverted tetrahedron": (
        with_inverted,
        "1 tetrahedra are inverted or flat, the first, number 7",
    ),
    "hole in a mesh": (hollow, "faces of the boundary or the interface have no label, the first"),
    "folder without a mesh": (
        lambda _: '[anatomy]\nkind = "mesh"\npath = "/"\nunit = "cm"\n',
        "this folder holds no mesh",
    ),
    "mesh without blood": (all_wall, "tetrahedra of the mesh are wall; none is blood"),
    "coordinates that are not numbers": (
        without_numbers,
        "mesh.vtu: has coordinates that are not finite numbers, 2 of",
    ),
    "slit wider than high": (
        lambda _: '[anatomy]\nkind = "synthetic"\nostium_minor_mm = 4.0\nostium_major_mm = 2.0\n',
        "ostium_minor_mm",
    ),
}


@pytest.mark.parametrize("claim", list(BAD))
def test_bad_input_is_refused_once_and_leaves_nothing(claim, command, tmp_path):
    make, says = BAD[claim]
    case = tmp_path / "case.toml"
    case.write_text('[patient]\nid = "bad"\n' + make(tmp_path))
    before = sorted(tmp_path.iterdir())
    outcome = command("mesh", case, "--preset", "coarse")
    assert outcome.status == 2, outcome.stderr
    assert outcome.stdout == ""
    assert says in outcome.stderr
    assert outcome.stderr.count("try:") == 1
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize("given", [["simulate"], ["run", "--mesh"], ["study"]])
def test_every_command_refuses_a_damaged_mesh(given, command, tmp_path):
    case = tube_case.write_case(tmp_path)
    mesh = tube_case.three_openings()
    tets = mesh.tets.copy()
    tets[7] = tets[7][[1, 0, 2, 3]]
    write_mesh(tmp_path / "tube.vtu", dataclasses.replace(mesh, tets=tets), unit="cm")
    case.write_text(case.read_text() + "[surrogate]\nR0_dyn_s_per_cm5 = 1500.0\n")
    before = sorted(tmp_path.iterdir())
    outcome = command(*given, case, "--out", tmp_path / "out")
    assert outcome.status == 2, outcome.stderr
    assert "1 tetrahedra are inverted or flat" in outcome.stderr
    assert sorted(tmp_path.iterdir()) == before
