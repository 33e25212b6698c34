"""
From a segmented surface
========================

VMTK, SimVascular and 3D Slicer write the lumen as a triangulated surface, in millimetres, with open
or capped ends. This tutorial draws such a surface, a bent artery with a stenosis, and then treats
it as any segmented one: STL file, anatomy, mesh.

In a case file the same is::

    [patient]
    id = "bent"
    [anatomy]
    kind = "surface"
    surface = "lumen.stl"
    unit = "mm"
    [anatomy.openings]              # a point near the middle of each end, in mm
    inlet = [40.0, 0.0, 0.0]
    anomalous_outlet = [29.3, 0.0, 27.3]
    [condition.rest]                # for simulate and solver.xml; jaxfsi mesh needs none
    P_systolic_mmHg = 110.0
    P_diastolic_mmHg = 65.0
    period_s = 0.8

and the way to a run, here and in svMultiPhysics::

    jaxfsi check case.toml          # unit, ends, what can be run
    jaxfsi mesh case.toml --preset coarse --format vtu,folder
    jaxfsi simulate case.toml --preset coarse --cycles 0.05

Where an end has no name or a wrong one, the refusal lists the middles of all ends in the unit of
the surface, to be copied. A vessel with its aorta has ``aorta_inlet`` and ``aorta_outlet`` instead.
"""

# %%
# A surface on disk
# -----------------
# Rings of points along an arc of a circle, joined by triangles; the ends stay open.
import pathlib
import tempfile

import matplotlib.pyplot as plt
import numpy as np
import trimesh

from jaxfsi import Region, tet_volumes
from jaxfsi.anatomy import surface_anatomy
from jaxfsi.meshing import build_mesh

n_along, n_around, bend = 60, 32, 40.0  # mm, radius of the arc
s = np.linspace(0.0, 30.0, n_along)  # mm
radius = 1.6 * (1.0 - 0.35 * np.exp(-(((s - 15.0) / 3.0) ** 2)))
along, around = s / bend, np.linspace(0.0, 2.0 * np.pi, n_around, endpoint=False)
out = bend + radius[:, None] * np.cos(around)
points = np.stack(
    [
        out * np.cos(along)[:, None],
        radius[:, None] * np.sin(around) * np.ones_like(out),
        out * np.sin(along)[:, None],
    ],
    axis=-1,
).reshape(-1, 3)
here = np.arange((n_along - 1) * n_around).reshape(-1, n_around)
right = np.roll(here, -1, axis=1)
corners = np.stack([here, here + n_around, right, right, here + n_around, right + n_around], -1)
stl = pathlib.Path(tempfile.mkdtemp()) / "lumen.stl"
trimesh.Trimesh(points, corners.reshape(-1, 3), process=False).export(stl)
print(f"{stl.name}: {len(points)} points in mm")

# %%
# Lumen and wall
# --------------
# The ends are named by a point near the middle of each. The wall is a tenth of the local radius, at
# least 0.5 mm; both are options.
ends = {"inlet": (bend, 0.0, 0.0), "outlet": tuple(points[-n_around:].mean(axis=0))}
anatomy = surface_anatomy(stl, unit="mm", names=ends)
for opening in anatomy.openings:
    print(f"{opening.name}: centre {np.round(opening.centre, 2)} cm")

# %%
# Mesh
# ----
mesh, report = build_mesh(anatomy, preset="coarse")
blood = np.abs(tet_volumes(mesh.points, mesh.tets_of(Region.FLUID))).sum()
exact = np.pi * np.trapezoid(radius**2, s) / 1e3
print(f"{len(mesh.tets)} tetrahedra in {sum(report.wall_time_s.values()):.0f} s")
print(f"blood {blood:.4f} ml; drawn {exact:.4f} ml")
print("labels:", ", ".join(mesh.label_names))

# %%
# A cut through the plane of the arc: blood, and the wall around it.
fig, axis = plt.subplots(figsize=(7.0, 3.4))
for region, colour in ((Region.FLUID, "tab:red"), (Region.SOLID, "0.6")):
    middle = mesh.points[mesh.tets_of(region)].mean(axis=1)
    near = middle[np.abs(middle[:, 1]) < 0.03]
    axis.plot(near[:, 2], near[:, 0], ".", color=colour, markersize=3, label=region.name.lower())
axis.set(xlabel="z [cm]", ylabel="x [cm]", aspect="equal")
axis.legend()
fig.tight_layout()
