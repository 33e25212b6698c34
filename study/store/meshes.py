"""Meshes kept between calls, by a hash of all that they follow from.

An entry holds the mesh, what is known of it, its pictures, and when and by which code it was made.
It is found again only by the same input files and options, under the same numerics
(`study.store.numerics`).
"""

import dataclasses
import os
import pathlib
import shutil
from typing import Any, NamedTuple

from jaxfsi import Mesh
from lumped.whole_files import staging
from study.case.anatomy import IvusAnatomy, MeshAnatomy, SurfaceAnatomy
from study.case.model import Case
from study.store.cache_folder import cache_folder
from study.store.case_inputs import files_of
from study.store.json_form import as_json, from_json
from study.store.mesh_parts import StateReport
from study.store.numerics import library
from study.store.provenance import sha256
from study.store.stages import Stages, stage_key

MOST_ENTRIES = 24
"""Entries beyond this number are dropped, those longest unused first."""

_BACKENDS = {"gmsh": "gmsh", "tetgen": "tetgen"}
"""Libraries of the meshers of volumes that only some installations have."""

_MESH, _ABOUT = "mesh", "about"
_ARRAYS = ("points", "tets", "region", "faces", "face_label")


class StateMesh(NamedTuple):
    """The mesh of one state with what is known of it.

    Attributes:
        mesh: the mesh.
        report: its part of the document of the command.
        pictures: PNG files by name.
        made: when and by which code, see `study.store.provenance.made_now`.
    """

    mesh: Mesh
    report: StateReport
    pictures: dict[str, bytes]
    made: dict[str, Any]


def entry_key(case: Case, state: str) -> str:
    """Hash of everything that the mesh of a state, its document and pictures follow from."""
    return stage_key("mesh report", mesh_key(case, state))


def mesh_key(case: Case, state: str) -> str:
    """Hash of everything that the mesh of a state follows from."""
    anatomy = case.anatomy
    options = dataclasses.replace(case.mesh, unit="cm")
    files: list[pathlib.Path] = []
    given: Any = anatomy
    match anatomy:
        case IvusAnatomy():
            files = [*anatomy.states[state].files]
            files += anatomy.lines
            given = dataclasses.replace(  # files, by content
                anatomy,
                states={},
                centerline=None,
                aorta_centerline=None,
                normal_centerline=None,
            )
            named = anatomy.states[state]
            absent = [file is None for file in (named.contours, named.frame_table)]
            absent += [named.reference_point is None]
            # a later key, which changes nothing where it is absent
            given = (given, absent + ([False] if named.external_contours is not None else []))
        case SurfaceAnatomy():
            files = anatomy.files
            given = (anatomy.surface.name, anatomy.unit, anatomy.smoothing_steps)
            given = (*given, sorted(anatomy.openings.items()), sorted(anatomy.cuts))
            given = (*given, [anatomy.cuts[name] for name in sorted(anatomy.cuts)])
            given = given if anatomy.axes is None else (*given, anatomy.axes)
        case MeshAnatomy():
            files = [file for place in anatomy.places for file in files_of(place)]
            given = (
                anatomy.unit,
                sorted(anatomy.labels.items()),
                [place.name for place in anatomy.places],
            )
        case _:
            pass
    hashes = [sha256(file) for file in files]
    wall = (case.wall.thickness_per_radius, case.wall.thickness_min, case.wall.thickness_max)
    backend = _BACKENDS.get(options.backend)
    mesher = None if backend is None else library(backend)
    key = stage_key("mesh", state, given, wall, options, hashes, mesher)
    operation = case.operation
    return key if operation is None else stage_key("mesh", key, operation)


def has_mesh(key: str) -> bool:
    """Whether there is an entry under a key."""
    folder = _folder()
    return folder is not None and (folder / key).is_dir()


def load_mesh(key: str) -> StateMesh | None:
    """The entry under a key; None where there is none, or it is damaged."""
    folder = _folder()
    if folder is None or not (folder / key).is_dir():
        return None
    entry, stages = folder / key, Stages(folder / key)
    try:
        about, stored = stages.known(_ABOUT, key), stages.known_arrays(_MESH, key)
        if about is None or stored is None:
            raise ValueError("damaged")
        mesh = Mesh(
            **{name: stored.value[name] for name in _ARRAYS},
            label_names=tuple(about.value["label_names"]),
            node_ids=stored.value.get("node_ids"),
            meta=about.value["meta"],
            **{name: stored.value[name] for name in ("wedges",) if name in stored.value},
        )
        report = from_json(StateReport, about.value["document"])
        pictures = {path.stem: path.read_bytes() for path in sorted(entry.glob("*.png"))}
        os.utime(entry)
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        shutil.rmtree(entry, ignore_errors=True)
        return None
    return StateMesh(mesh, report, pictures, about.made)


def store_mesh(key: str, made: StateMesh) -> None:
    """Keep an entry; a cache that cannot be written costs time, no result."""
    folder = _folder()
    if folder is None:
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with staging(folder) as part:
            _fill(Stages(part), key, made)
            if not (folder / key).exists():
                os.replace(part, folder / key)
        _prune(folder)
    except (OSError, TypeError, ValueError):
        return


def _fill(stages: Stages, key: str, made: StateMesh) -> None:
    mesh = made.mesh
    arrays = {name: getattr(mesh, name) for name in _ARRAYS}
    if mesh.node_ids is not None:
        arrays["node_ids"] = mesh.node_ids
    if len(mesh.wedges):
        arrays["wedges"] = mesh.wedges
    stages.keep_arrays(_MESH, key, arrays, made.made)
    about = {"label_names": mesh.label_names, "meta": mesh.meta, "document": as_json(made.report)}
    stages.keep(_ABOUT, key, about, made.made)
    for name, content in made.pictures.items():
        (stages.folder / f"{name}.png").write_bytes(content)


def _folder() -> pathlib.Path | None:
    folder = cache_folder()
    return None if folder is None else folder / "meshes"


def _prune(folder: pathlib.Path) -> None:
    entries = [path for path in folder.iterdir() if not path.name.startswith(".")]
    entries.sort(key=lambda path: path.stat().st_mtime)
    for path in entries[:-MOST_ENTRIES]:
        shutil.rmtree(path, ignore_errors=True)
