"""The smallest case that a study can use: a tube whose outlet is half aorta, half artery."""

import dataclasses

import numpy as np

from jaxfsi.mesh_files import write_mesh
from jaxfsi.meshing import tube

CASE = """\
[patient]
id = "tube"
[anatomy]
kind = "mesh"
path = "tube.vtu"
unit = "cm"
[condition.rest]
P_systolic_mmHg = 110.0
P_diastolic_mmHg = 65.0
period_s = 0.80
cardiac_output_l_per_min = 4.5
ffr = {ffr}
[condition.exercise]
P_systolic_mmHg = {systolic}
P_diastolic_mmHg = 70.0
period_s = 0.45
[solver]
dt_s = 2.0e-3
"""


def three_openings():
    """A tube whose outlet is one half aorta, one half anomalous artery."""
    mesh = tube(radius=1.0, length=3.0, thickness=0.2, n_around=10, n_axial=5, n_layers=1)
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


def write_case(folder, *, ffr=0.91, systolic=130.0):
    """Write case and mesh into a folder, which is made if needed; gives the case's file."""
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / "tube.vtu").exists():
        write_mesh(folder / "tube.vtu", three_openings(), unit="cm")
    (folder / "case.toml").write_text(CASE.format(ffr=ffr, systolic=systolic))
    return folder / "case.toml"
