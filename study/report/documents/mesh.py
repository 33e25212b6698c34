"""The document of the command `mesh`, `mesh.json`."""

import dataclasses

from study.store.mesh_parts import MeshNote, StateReport
from study.store.provenance import Provenance


@dataclasses.dataclass(frozen=True)
class MeshDocument:
    """Meshes of the states of a case.

    Attributes:
        format: name and version of the layout.
        kind: `mesh`.
        patient: id of the patient.
        preset: size that was asked for.
        unit: unit of the lengths in the mesh files.
        notes: what looks wrong or needs care, warnings first.
        states: the mesh of each state.
        mesh_files: names of the files that hold each.
        provenance: inputs, options, versions.
    """

    format: str
    kind: str
    patient: str
    preset: str
    unit: str
    notes: list[MeshNote]
    states: dict[str, StateReport]
    mesh_files: dict[str, list[str]]
    provenance: Provenance
