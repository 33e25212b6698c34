"""
From ultrasound to a mesh
=========================

Lumen contours of a catheter pullback and the centre line of a CT become a mesh of blood and wall
that share their nodes. The pullback lies in ``study/data/ivus_aaoca`` (Stark et al. 2026, MIT).

On the command line: ``jaxfsi mesh case.toml --preset coarse --format vtu``.
"""

# %%
# Contours
# --------
# Each frame is a closed curve. Near the ostium the lumen is a slit; the ultrasound catheter is 1 mm
# thick, so that nothing narrower can be read.
import matplotlib.pyplot as plt
import numpy as np

import study
from jaxfsi import Region
from jaxfsi.anatomy import ivus_anatomy, read_pullback
from jaxfsi.meshing import build_mesh

ivus = study.read_case(study.demo_case_path()).anatomy
state = ivus.states["rest_diastole"]
files = {"frame_table": state.frame_table, "reference": state.reference_point}
pullback = read_pullback(state.contours, **files)

fig, axis = plt.subplots(figsize=(7.0, 2.6))
for k, section in enumerate(pullback.sections[::3]):
    axis.plot(0.6 * k + section[:, 0], section[:, 1], lw=1.0)
axis.set(xlabel="frames from the ostium, side by side [cm]", ylabel="[cm]", aspect="equal")
fig.tight_layout()

# %%
# Anatomy
# -------
# Contours are lofted along the path of the vessel, turned to the aortic wall, and joined with the
# aorta, which follows its own centre line and radii from CT, as does the stem of the left coronary.
# The result holds lumen and wall as implicit functions, with named openings.
lines = {
    "aorta_centerline": ivus.aorta_centerline,
    "normal_centerline": ivus.normal_centerline,
}
anatomy = ivus_anatomy(state.contours, ivus.centerline, **lines, **files)
print("openings:", ", ".join(opening.name for opening in anatomy.openings))

# %%
# Mesh
# ----
# One call gives tetrahedra of blood and wall, checked for topology, quality, and fidelity to the
# contours. A mesh with a fault is refused.
mesh, report = build_mesh(anatomy, preset="coarse")
print(f"{len(mesh.tets)} tetrahedra in {sum(report.wall_time_s.values()):.0f} s")
print("labels:", ", ".join(mesh.label_names))

# %%
# A cut across the aorta at the ostium: between the two lumens lies the septum, one solid.
fig, axis = plt.subplots(figsize=(4.6, 4.4))
for region, colour in ((Region.FLUID, "tab:red"), (Region.SOLID, "0.5")):
    middle = mesh.points[mesh.tets_of(region)].mean(axis=1)
    near = middle[np.abs(middle[:, 2]) < 0.06]
    axis.plot(near[:, 0], near[:, 1], ".", color=colour, markersize=3, label=region.name.lower())
axis.set(xlabel="x [cm]", ylabel="y [cm]", aspect="equal")
axis.legend()
fig.tight_layout()
