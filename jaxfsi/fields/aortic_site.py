"""The place in the aorta that a ratio is taken to: at the level of the anomalous ostium.

A guide catheter measures the aortic pressure at the ostium. In 3D the pressure is given at the
inlet of the aorta; between the two lie the inertia of the blood and the recovery of its velocity
head, mean 1 to 2 mmHg, as much as the loss of a mild obstruction. The site is a ball midway between
ostium and axis of the aorta; its pressure is read from the frames of a run, and the difference to
the inlet at the same instants shifts the means of a cycle::

    mean P_aorta = mean P_inlet + ⟨P_site − P_inlet⟩ over the frames of the cycle
"""

import pathlib
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from jaxfsi.anatomy import Anatomy
from jaxfsi.fields.frame_arrays import frame_arrays
from jaxfsi.fields.series import Entry
from jaxfsi.mesh import Mesh, Region
from jaxfsi.opening import ANOMALOUS

_SHARE = 0.5
"""Way from the ostium to the axis of the aorta."""

_RADIUS = 0.3
"""Of the ball [cm]."""

_LEAST_NODES = 6


def aortic_site(mesh: Mesh, anatomy: Anatomy | None) -> Int[np.ndarray, " nodes"] | None:
    """Nodes of the site; None where the anatomy does not tell where ostium and aorta lie."""
    if anatomy is None or not {ANOMALOUS, "aorta"} <= set(anatomy.centerlines):
        return None
    ostium = anatomy.centerlines[ANOMALOUS].points[0]
    axis = anatomy.centerlines["aorta"].points
    centre = axis[np.argmin(np.linalg.norm(axis - ostium, axis=1))]
    place = ostium + _SHARE * (centre - ostium)
    blood = np.unique(mesh.tets_of(Region.FLUID))
    distance = np.linalg.norm(mesh.points[blood] - place, axis=1)
    order = np.argsort(distance)
    n = max(_LEAST_NODES, int(np.sum(distance < _RADIUS)))
    return np.sort(blood[order[:n]])


def site_pressures(
    folder: pathlib.Path, entries: Sequence[Entry], nodes: Int[np.ndarray, " nodes"]
) -> Float[np.ndarray, " frames"]:
    """Mean pressure of the site in each frame [mmHg]."""
    name = "pressure_mmHg"
    return np.array(
        [float(frame_arrays(folder / e.file, (name,))[name][nodes].mean()) for e in entries]
    )


def cycle_offsets(
    t: Float[np.ndarray, " frames"],
    difference: Float[np.ndarray, " frames"],
    period: float,
    n_cycles: int,
) -> list[float]:
    """Mean difference over each cycle; the frame at its start belongs to the cycle before."""
    number = np.ceil(t / period - 1e-6).astype(int) - 1
    found = []
    for k in range(n_cycles):
        part = difference[number == k]
        found.append(float(part.mean()) if len(part) else 0.0)
    return found
