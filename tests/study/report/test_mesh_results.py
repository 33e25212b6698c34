"""What the command `mesh` says of its files."""

import pytest

from jaxfsi.meshing import tube
from study.report.mesh_results import split_notes


def vessel(*, columns: bool):
    return tube(
        radius=0.5, length=1.0, thickness=0.1, n_around=8, n_axial=2, n_layers=1, columns=columns
    )


@pytest.mark.parametrize(
    ("formats", "held"),
    [(["folder"], "mesh-complete folders hold"), (["vtu", "msh"], "msh files hold")],
)
def test_wedges_cut_into_tetrahedra_are_told(formats, held):
    meshes = {"rest": vessel(columns=True), "stress": vessel(columns=False)}
    (note,) = split_notes(meshes, formats)
    assert note.level == "info"
    assert note.text.startswith(f"rest: {held} three tetrahedra in place of each wedge")


def test_files_that_hold_the_mesh_as_it_is_are_not_remarked_on():
    assert split_notes({"rest": vessel(columns=True)}, ["vtu", "xdmf"]) == []
    assert split_notes({"rest": vessel(columns=False)}, ["folder", "msh"]) == []
