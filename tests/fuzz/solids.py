"""A small good mesh of blood and wall in many formats, and geometric damage to it."""

import copy
import functools
import pathlib
import random
import tempfile
from collections.abc import Callable

import meshio
import numpy as np

from jaxfsi.mesh_files import write_mesh, write_mesh_complete
from jaxfsi.meshing import tube
from tests.fuzz.gmsh4 import gmsh4
from tests.fuzz.trial import Expected, Files

FORMATS = (
    "vtu zlib", "vtu ascii", "vtu appended", "vtu lzma", "msh2 ascii", "msh2 binary", "msh4 ascii",
    "msh4 binary", "xdmf", "folder",
)  # fmt: skip


def good_mesh():
    """A tube of blood and wall whose outlet is half aorta, half anomalous artery."""
    import dataclasses

    mesh = tube(radius=1.0, length=3.0, thickness=0.2, n_around=12, n_axial=5, n_layers=1)
    names = ["aorta_inlet", "aorta_outlet", "anomalous_outlet", "interface", "outer_wall"]
    names += [f"{name}_ring" for name in names[:3]]
    new = {"inlet": "aorta_inlet", "outlet": "aorta_outlet"}
    label = np.zeros(len(mesh.faces), np.int64)
    side = mesh.points[mesh.faces].mean(axis=1)[:, 0] < 0.0
    for k, old in enumerate(mesh.label_names):
        stem = old.removesuffix("_ring")
        name = new.get(stem, stem) + old[len(stem) :]
        label[mesh.face_label == k] = names.index(name)
        if stem == "outlet":
            other = name.replace("aorta", "anomalous")
            label[(mesh.face_label == k) & side] = names.index(other)
    return dataclasses.replace(mesh, face_label=label, label_names=tuple(names))


@functools.cache
def good_files(suffix: str) -> dict[str, bytes]:
    """Files of the good mesh as jaxfsi writes them: `.vtu`, `.msh`, `.xdmf` or a folder."""
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        if suffix == "folder":
            (folder / "mesh").mkdir()
            write_mesh_complete(
                folder / "mesh/fluid", folder / "mesh/solid", good_mesh(), unit="cm"
            )
        else:
            write_mesh(folder / f"mesh{suffix}", good_mesh(), unit="cm")
        paths = [path for path in folder.rglob("*") if path.is_file()]
        return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


@functools.cache
def _loaded(suffix: str) -> meshio.Mesh:
    with tempfile.TemporaryDirectory() as name:
        for file, data in good_files(suffix).items():
            pathlib.Path(name, file).write_bytes(data)
        return meshio.read(pathlib.Path(name, f"mesh{suffix}"))


def suffix_of(form: str) -> str:
    return {"vtu": ".vtu", "msh2": ".msh", "msh4": ".msh", "xdmf": ".xdmf"}.get(
        form.split()[0], "folder"
    )


def written(form: str, arrays: meshio.Mesh) -> Files:
    """Files of a mesh in a format; what stands beside it is that of the good mesh."""
    suffix = suffix_of(form)
    beside: Files = {
        name: data for name, data in good_files(suffix).items() if name.endswith(".json")
    }
    with tempfile.TemporaryDirectory() as name:
        path = pathlib.Path(name, f"mesh{suffix}")
        if form == "vtu zlib":
            meshio.vtu.write(path, arrays)
        elif form == "vtu lzma":
            meshio.vtu.write(path, arrays, compression="lzma")
        elif form == "vtu ascii":
            meshio.vtu.write(path, arrays, binary=False)
        elif form == "vtu appended":
            meshio.vtu.write(path, arrays)
            _appended(path)
        elif form.startswith("msh2"):
            meshio.gmsh.write(path, arrays, "2.2", binary=form.endswith("binary"))
        elif form.startswith("msh4"):
            path.write_bytes(gmsh4(arrays, binary=form.endswith("binary")))
        else:
            meshio.xdmf.write(path, arrays)
        made: Files = {file.name: file.read_bytes() for file in pathlib.Path(name).iterdir()}
    return {**beside, **made}


def _appended(path: pathlib.Path) -> None:
    import vtk

    reader, writer = vtk.vtkXMLUnstructuredGridReader(), vtk.vtkXMLUnstructuredGridWriter()
    reader.SetFileName(str(path))
    reader.Update()
    writer.SetInputData(reader.GetOutput())
    writer.SetDataModeToAppended()
    writer.SetFileName(str(path))
    writer.Write()


Damage = Callable[[random.Random, meshio.Mesh], Expected]
"""Changes a mesh in place; says what must become of it."""


def _tets(mesh: meshio.Mesh) -> np.ndarray:
    return next(block.data for block in mesh.cells if block.type == "tetra")


def _pick(rng: random.Random, mesh: meshio.Mesh) -> tuple[np.ndarray, int]:
    tets = _tets(mesh)
    return tets, rng.randrange(len(tets))


def _without(mesh: meshio.Mesh, kind: str, gone: np.ndarray) -> None:
    """Take some cells of a kind out, with their data."""
    for k, block in enumerate(mesh.cells):
        if block.type == kind:
            kept = ~gone[: len(block.data)]
            gone = gone[len(block.data) :]
            block.data = block.data[kept]
            for values in mesh.cell_data.values():
                values[k] = values[k][kept]


def _more(mesh: meshio.Mesh, kind: str, rows: np.ndarray, like: np.ndarray) -> None:
    """Add cells of a kind to its first block, with the data of others."""
    for k, block in enumerate(mesh.cells):
        if block.type == kind:
            block.data = np.concatenate([block.data, rows])
            for values in mesh.cell_data.values():
                values[k] = np.concatenate([values[k], values[k][like]])
            return


def inverted(rng: random.Random, mesh: meshio.Mesh) -> Expected:
    tets, k = _pick(rng, mesh)
    tets[k, [0, 1]] = tets[k, [1, 0]]
    return "refused"


def all_inverted(_: random.Random, mesh: meshio.Mesh) -> Expected:
    """The other convention: every tetrahedron is mirrored."""
    for block in mesh.cells:
        if block.type == "tetra":
            block.data[:, [0, 1]] = block.data[:, [1, 0]]
    return "either"


def degenerate(rng: random.Random, mesh: meshio.Mesh) -> Expected:
    tets, k = _pick(rng, mesh)
    tets[k, 1] = tets[k, 0]
    return "refused"


def folded(rng: random.Random, mesh: meshio.Mesh) -> Expected:
    """One node far on the other side of its neighbours."""
    tets, k = _pick(rng, mesh)
    mesh.points[tets[k, 0]] = 2.0 * mesh.points[tets[k, 1:]].mean(axis=0) - mesh.points[tets[k, 0]]
    return "refused"


def flat(_: random.Random, mesh: meshio.Mesh) -> Expected:
    mesh.points[:, 2] = 0.0
    return "refused"


def a_point(_: random.Random, mesh: meshio.Mesh) -> Expected:
    mesh.points[:] = mesh.points[0]
    return "refused"


def hole(rng: random.Random, mesh: meshio.Mesh) -> Expected:
    """A tetrahedron is missing inside: none of its faces is a face of the boundary."""
    blocks = [block.data for block in mesh.cells if block.type == "tetra"]
    tets = np.concatenate(blocks)
    faces = np.sort(tets[:, [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]], axis=2).reshape(-1, 3)
    _, index, counts = np.unique(faces, axis=0, return_inverse=True, return_counts=True)
    inside = np.flatnonzero((counts[index.ravel()].reshape(-1, 4) == 2).all(axis=1))
    gone = np.zeros(len(tets), bool)
    gone[rng.choice(inside.tolist())] = True
    _without(mesh, "tetra", gone)
    return "refused"


def half_missing(_: random.Random, mesh: meshio.Mesh) -> Expected:
    tets = np.concatenate([block.data for block in mesh.cells if block.type == "tetra"])
    middle = mesh.points[tets].mean(axis=1)
    _without(mesh, "tetra", middle[:, 2] > np.median(middle[:, 2]))
    return "refused"


def doubled(rng: random.Random, mesh: meshio.Mesh) -> Expected:
    tets, k = _pick(rng, mesh)
    _more(mesh, "tetra", tets[[k]], np.array([k]))
    return "refused"


def two_parts(_: random.Random, mesh: meshio.Mesh) -> Expected:
    count = len(mesh.points)
    mesh.points = np.concatenate([mesh.points, mesh.points + np.array([10.0, 0.0, 0.0])])
    for name, values in mesh.point_data.items():
        mesh.point_data[name] = np.concatenate([values, values])
    for k, block in enumerate(mesh.cells):
        block.data = np.concatenate([block.data, block.data + count])
        for values in mesh.cell_data.values():
            values[k] = np.concatenate([values[k], values[k]])
    return "refused"


def _regions(mesh: meshio.Mesh, change: Callable[[np.ndarray], np.ndarray]) -> bool:
    """Change the region of the tetrahedra, under whatever name the format has."""
    changed = False
    for name in ("region", "gmsh:physical"):
        for k, block in enumerate(mesh.cells):
            if name in mesh.cell_data and block.type == "tetra":
                mesh.cell_data[name][k] = change(np.asarray(mesh.cell_data[name][k]))
                changed = True
    return changed


def all_solid(_: random.Random, mesh: meshio.Mesh) -> Expected:
    tags = mesh.field_data.get("solid")
    solid = 1 if tags is None else int(tags[0])
    _regions(mesh, lambda old: np.full_like(old, solid))
    return "refused"


def odd_region(rng: random.Random, mesh: meshio.Mesh) -> Expected:
    odd = rng.choice([-1, 7, 2**31 - 1])

    def change(old: np.ndarray) -> np.ndarray:
        new = old.copy()
        new[rng.randrange(len(new))] = odd
        return new

    return "refused" if _regions(mesh, change) else "either"


def bad_index(rng: random.Random, mesh: meshio.Mesh) -> Expected:
    tets, k = _pick(rng, mesh)
    tets[k, rng.randrange(4)] = rng.choice([-1, -5, len(mesh.points), 10**6, 2**31 - 1])
    return "refused"


def bad_face_index(rng: random.Random, mesh: meshio.Mesh) -> Expected:
    for block in mesh.cells:
        if block.type == "triangle":
            block.data[rng.randrange(len(block.data)), 0] = rng.choice(
                [-1, len(mesh.points), 10**7]
            )
            return "refused"
    return "either"


def bad_coordinate(rng: random.Random, mesh: meshio.Mesh) -> Expected:
    node = int(rng.choice(_tets(mesh)[rng.randrange(10)].tolist()))
    mesh.points[node, rng.randrange(3)] = rng.choice([np.nan, np.inf, -np.inf, 1e300, 1e9, -1e5])
    return "refused"


def wrong_unit(rng: random.Random, mesh: meshio.Mesh) -> Expected:
    mesh.points *= rng.choice([10.0, 1000.0, 1e-2, 1e-3])
    return "refused"


def no_faces(_: random.Random, mesh: meshio.Mesh) -> Expected:
    """Labels are lost; they may be found anew."""
    count = sum(len(block.data) for block in mesh.cells if block.type == "triangle")
    _without(mesh, "triangle", np.ones(count, bool))
    return "either"


def inner_label(rng: random.Random, mesh: meshio.Mesh) -> Expected:
    """A labelled face that is no face of the mesh."""
    tets, k = _pick(rng, mesh)
    far = int(np.argmax(np.linalg.norm(mesh.points - mesh.points[tets[k, 0]], axis=1)))
    rows = np.array([[tets[k, 0], tets[k, 1], far]])
    _more(mesh, "triangle", rows, np.array([0]))
    return "refused"


def swapped_labels(rng: random.Random, mesh: meshio.Mesh) -> Expected:
    """The interface and an opening exchange their names."""
    for name in ("label", "gmsh:physical"):
        if name not in mesh.cell_data:
            continue
        values = [
            v for b, v in zip(mesh.cells, mesh.cell_data[name], strict=True) if b.type == "triangle"
        ]
        if not values:
            continue
        both = np.unique(np.concatenate([np.asarray(v) for v in values]))
        a, b = (0, 3) if name == "label" else (int(both[0]), int(both[min(3, len(both) - 1)]))
        for v in values:
            at_a, at_b = v == a, v == b
            v[at_a], v[at_b] = b, a
        return "refused" if name == "label" else "either"
    return "either"


def shuffled_cells(rng: random.Random, mesh: meshio.Mesh) -> Expected:
    """The same tetrahedra in another order."""
    for k, block in enumerate(mesh.cells):
        if block.type == "tetra":
            order = np.array(rng.sample(range(len(block.data)), len(block.data)))
            block.data = block.data[order]
            for values in mesh.cell_data.values():
                values[k] = np.asarray(values[k])[order]
    return "same"


def loose_node(_: random.Random, mesh: meshio.Mesh) -> Expected:
    """A node that no cell has."""
    mesh.points = np.concatenate([mesh.points, [[0.1, 0.1, 0.1]]])
    for name, values in mesh.point_data.items():
        mesh.point_data[name] = np.concatenate([values, values[-1:] + 1])
    return "either"


def nothing(_: random.Random, mesh: meshio.Mesh) -> Expected:
    """No damage: another writer of the same format."""
    return "either"


SOLID_DAMAGE: dict[str, Damage] = {
    damage.__name__.replace("_", " "): damage
    for damage in (
        nothing, inverted, all_inverted, degenerate, folded, flat, a_point, hole, half_missing,
        doubled, two_parts, all_solid, odd_region, bad_index, bad_face_index, bad_coordinate,
        wrong_unit, no_faces, inner_label, swapped_labels, shuffled_cells, loose_node,
    )
}  # fmt: skip


def damaged(rng: random.Random, form: str, name: str) -> tuple[Files, Expected] | None:
    """Files of a mesh with some damage; None where the writer does not take it."""
    mesh = copy.deepcopy(_loaded(suffix_of(form)))
    for k, block in enumerate(mesh.cells):
        block.data = np.array(block.data)
        for values in mesh.cell_data.values():
            values[k] = np.array(values[k])
    mesh.cell_sets = {}
    mesh.points = np.array(mesh.points)
    expected = SOLID_DAMAGE[name](rng, mesh)
    try:
        return written(form, mesh), expected
    except Exception:
        return None
