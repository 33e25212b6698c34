"""
Mesh from contours
==================

From the ultrasound contours of the bundled patient to a labelled mesh of blood and wall, on disk.
"""

# %% Contours and centre lines are named by the case file
import pathlib
import tempfile

import study
from jaxfsi.anatomy import ivus_anatomy
from jaxfsi.mesh_files import write_mesh
from jaxfsi.meshing import build_mesh

ivus = study.read_case(study.demo_case_path()).anatomy
state = ivus.states["rest_systole"]
anatomy = ivus_anatomy(
    state.contours,
    ivus.centerline,
    frame_table=state.frame_table,
    reference=state.reference_point,
    aorta_centerline=ivus.aorta_centerline,
    normal_centerline=ivus.normal_centerline,
)

# %% Coarse: about 30 000 tetrahedra
mesh, report = build_mesh(anatomy, preset="coarse")
print(f"{len(mesh.tets)} tetrahedra, openings:", ", ".join(mesh.openings))
print(f"smallest dihedral angle {report.quality.min_dihedral_deg:.0f} degrees")

# %% For ParaView and other solvers
path = pathlib.Path(tempfile.mkdtemp()) / "patient.vtu"
write_mesh(path, mesh, unit="mm")
print(f"{path.name}: {path.stat().st_size / 1e6:.1f} MB")
