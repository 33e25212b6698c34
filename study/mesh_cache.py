"""Meshes kept between calls, by a hash of all that they follow from.

An entry holds the mesh, what is known of it, and its pictures. It is found again only by the same
input files, the same options, the same code and the same versions of the meshers.
"""

import dataclasses
import functools
import hashlib
import importlib.metadata
import json
import os
import pathlib
import shutil
import tempfile
from typing import Any, NamedTuple

import numpy as np

import jaxfsi
import study
from jaxfsi import Mesh
from study.cache import cache_folder
from study.case import Case
from study.case_anatomy import IvusAnatomy, MeshAnatomy, SurfaceAnatomy
from study.provenance import files_of, sha256

MOST_ENTRIES = 24
"""Entries beyond this number are dropped, those longest unused first."""

_LIBRARIES = ("numpy", "scipy", "mmgpy", "netgen-mesher", "meshio", "pyvista", "vtk", "matplotlib")
_ARRAYS = ("points", "tets", "region", "faces", "face_label")


class StateMesh(NamedTuple):
    """The mesh of one state with what is known of it.

    Attributes:
        mesh: the mesh.
        document: its part of the document of the command.
        pictures: PNG files by name.
    """

    mesh: Mesh
    document: dict[str, Any]
    pictures: dict[str, bytes]


def mesh_key(case: Case, state: str) -> str:
    """Hash of everything that the mesh of a state follows from."""
    anatomy = case.anatomy
    options = dataclasses.replace(case.mesh, unit="cm")
    files: list[pathlib.Path] = []
    given: Any = anatomy
    match anatomy:
        case IvusAnatomy():
            files = [*anatomy.states[state].files]
            files += [anatomy.centerline] if anatomy.centerline is not None else []
            given = dataclasses.replace(anatomy, states={}, centerline=None)
            given = (given, [file is None for file in dataclasses.astuple(anatomy.states[state])])
        case SurfaceAnatomy():
            files = [anatomy.surface]
            given = (anatomy.surface.name, anatomy.unit, anatomy.smoothing_steps)
            given = (*given, dict(anatomy.openings), dict(anatomy.cuts))
        case MeshAnatomy():
            files = [file for place in anatomy.places for file in files_of(place)]
            given = (anatomy.unit, dict(anatomy.labels), [place.name for place in anatomy.places])
        case _:
            pass
    hashes = [sha256(file) for file in files]
    wall = (case.wall.thickness_per_radius, case.wall.thickness_min, case.wall.thickness_max)
    text = repr((state, given, wall, options, hashes, _code(), _versions()))
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def load_mesh(key: str) -> StateMesh | None:
    """The entry under a key; None where there is none, or it is damaged."""
    folder = _folder()
    if folder is None or not (folder / key).is_dir():
        return None
    entry = folder / key
    try:
        names = json.loads((entry / "mesh.json").read_text(encoding="utf-8"))
        document = json.loads((entry / "document.json").read_text(encoding="utf-8"))
        with np.load(entry / "mesh.npz") as arrays:
            stored = {name: arrays[name] for name in arrays.files}
        mesh = Mesh(
            **{name: stored[name] for name in _ARRAYS},
            label_names=tuple(names["label_names"]),
            node_ids=stored.get("node_ids"),
            meta=names["meta"],
        )
        pictures = {path.stem: path.read_bytes() for path in sorted(entry.glob("*.png"))}
        os.utime(entry)
    except (OSError, ValueError, KeyError, TypeError):
        shutil.rmtree(entry, ignore_errors=True)
        return None
    return StateMesh(mesh, document, pictures)


def store_mesh(key: str, made: StateMesh) -> None:
    """Keep an entry; a cache that cannot be written costs time, no result."""
    folder = _folder()
    if folder is None:
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
        part = pathlib.Path(tempfile.mkdtemp(prefix=".writing-", dir=folder))
    except OSError:
        return
    try:
        mesh = made.mesh
        arrays = {name: getattr(mesh, name) for name in _ARRAYS}
        if mesh.node_ids is not None:
            arrays["node_ids"] = mesh.node_ids
        np.savez(part / "mesh.npz", **arrays)
        names = {"label_names": mesh.label_names, "meta": mesh.meta}
        (part / "mesh.json").write_text(json.dumps(names), encoding="utf-8")
        (part / "document.json").write_text(json.dumps(made.document), encoding="utf-8")
        for name, content in made.pictures.items():
            (part / f"{name}.png").write_bytes(content)
        if not (folder / key).exists():
            os.replace(part, folder / key)
        _prune(folder)
    except (OSError, TypeError):
        pass
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _folder() -> pathlib.Path | None:
    folder = cache_folder()
    return None if folder is None else folder / "meshes"


def _prune(folder: pathlib.Path) -> None:
    entries = [path for path in folder.iterdir() if not path.name.startswith(".")]
    entries.sort(key=lambda path: path.stat().st_mtime)
    for path in entries[:-MOST_ENTRIES]:
        shutil.rmtree(path, ignore_errors=True)


@functools.cache
def _code() -> str:
    """Hash of the source of `jaxfsi` and of what draws and describes meshes here."""
    digest = hashlib.sha256()
    core = pathlib.Path(jaxfsi.__file__).parent
    own = pathlib.Path(study.__file__).parent
    for path in [*sorted(core.rglob("*.py")), *sorted(own.glob("mesh*.py"))]:
        digest.update(path.read_bytes())
    digest.update((own / "anatomy_source.py").read_bytes())
    return digest.hexdigest()


@functools.cache
def _versions() -> tuple[str, ...]:
    found = []
    for name in _LIBRARIES:
        try:
            found.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            found.append(f"{name} absent")
    return tuple(found)
