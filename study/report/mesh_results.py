"""The document of the command `mesh`, and the files that hold its meshes."""

import pathlib
from collections.abc import Mapping, Sequence

from jaxfsi import Mesh
from jaxfsi.mesh_files import Unit, write_mesh, write_mesh_complete
from study.case.model import Case
from study.report.documents.mesh import MeshDocument
from study.report.pictures import embedded_pictures, write_mesh_pictures
from study.run.mesh import mesh_part
from study.store.layouts import FORMAT
from study.store.mesh_parts import MeshNote
from study.store.meshes import StateMesh
from study.store.provenance import Provenance

FOLDER_SUFFIX = "-mesh-complete"


def mesh_document(
    case: Case, states: Mapping[str, StateMesh], formats: Sequence[str], provenance: Provenance
) -> MeshDocument:
    """The document of the command."""
    part = mesh_part(case, states)
    return MeshDocument(
        format=FORMAT,
        kind="mesh",
        patient=case.id,
        preset=part.preset,
        unit=part.unit,
        notes=[*part.notes, *split_notes({n: m.mesh for n, m in states.items()}, formats)],
        states=part.states,
        mesh_files={name: mesh_names(name, made.mesh, formats) for name, made in states.items()},
        provenance=provenance,
    )


def split_notes(meshes: Mapping[str, Mesh], formats: Sequence[str]) -> list[MeshNote]:
    """That some of the formats asked for hold no wedges, where a mesh has them."""
    split = [name for name in ("folder", "msh") if name in formats]
    with_wedges = [name for name, mesh in meshes.items() if len(mesh.wedges)]
    if not split or not with_wedges:
        return []
    held = " and ".join({"folder": "mesh-complete folders", "msh": "msh files"}[n] for n in split)
    return [
        MeshNote(
            "info",
            f"{', '.join(with_wedges)}: {held} hold three tetrahedra in place of each wedge of the"
            " wall. Other programs see tetrahedra alone; jaxfsi reads the wedges again.",
        )
    ]


def mesh_names(state: str, mesh: Mesh, formats: Sequence[str]) -> list[str]:
    """Names of what is written for a state, relative to the output folder."""
    names = [f"{state}.{kind}" for kind in formats if kind != "folder"]
    return names + ([f"{state}{FOLDER_SUFFIX}"] if "folder" in formats else [])


def write_meshes(
    folder: pathlib.Path,
    states: Mapping[str, StateMesh],
    formats: Sequence[str],
    unit: Unit,
    beside: Mapping[str, Mapping[str, str]] | None = None,
) -> None:
    """Write the meshes of all states, and their pictures, into a folder that is being filled.

    Args:
        folder: it.
        states: the meshes.
        formats: kinds of mesh files.
        unit: of their coordinates.
        beside: texts by name to lie in the mesh-complete folder of a state; None: none.
    """
    for state, made in states.items():
        for name in mesh_names(state, made.mesh, formats):
            if name.endswith(FOLDER_SUFFIX):
                _write_complete(folder / name, made.mesh, unit)
                for file, text in (beside or {}).get(state, {}).items():
                    (folder / name / file).write_text(text, encoding="utf-8")
            else:
                write_mesh(folder / name, made.mesh, unit=unit)
        write_mesh_pictures(folder, state, made.pictures)


def _write_complete(folder: pathlib.Path, mesh: Mesh, unit: Unit) -> None:
    folder.mkdir()
    held = {int(region) for region in set(mesh.region.tolist())}
    fluid = folder / "fluid" if 0 in held else None
    solid = folder / "solid" if 1 in held else None
    write_mesh_complete(fluid, solid, mesh, unit=unit)


def embedded(states: Mapping[str, StateMesh]) -> dict[str, dict[str, str]]:
    """Pictures of each state as texts that stand inside HTML."""
    return {state: embedded_pictures(made.pictures) for state, made in states.items()}
