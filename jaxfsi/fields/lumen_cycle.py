"""The lumen over the last cycle of a run, as its frames hold it: pressure and motion of each node.

The mean of a cycle is taken over its frames, which are fewer than its steps. The line that takes
the frames' means at the inlet and at the distal outlet to those of all steps takes the means of all
nodes along::

    P = P_distal + (⟨p⟩ − ⟨p⟩_distal) (P_inlet − P_distal)/(⟨p⟩_inlet − ⟨p⟩_distal)

so that a ratio read at either end is the very one of the run. ⟨p⟩: mean of the frames; at an
opening that of its face.
"""

import pathlib
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxfsi.fields.frame_arrays import frame_arrays
from jaxfsi.fields.series import Entry
from jaxfsi.mesh import INTERFACE, Mesh

_LEAST_DROP = 1.0
"""Drop from which the line is fixed by its two ends [mmHg]; below, it only shifts."""


class LumenCycle(NamedTuple):
    """The lumen over a cycle.

    Attributes:
        nodes: nodes of the mesh on the lumen, ascending.
        triangles: of the lumen, as indices into `nodes`.
        points: where the nodes are in the reference shape [cm].
        t: times of the frames from the start of the cycle [s].
        whole: whether the frames hold a whole cycle.
        moved: displacement [cm].
        P: pressure [mmHg].
        P_openings: mean pressure of each opening of the mesh [mmHg].
    """

    nodes: Int[np.ndarray, " nodes"]
    triangles: Int[np.ndarray, "triangles 3"]
    points: Float[np.ndarray, "nodes 3"]
    t: Float[np.ndarray, " frames"]
    whole: bool
    moved: Float[np.ndarray, "frames nodes 3"]
    P: Float[np.ndarray, "frames nodes"]
    P_openings: dict[str, Float[np.ndarray, " frames"]]


def lumen_cycle(
    folder: pathlib.Path, entries: Sequence[Entry], mesh: Mesh, period: float
) -> LumenCycle | None:
    """The lumen over the last whole cycle of a run, or over the part of one that there is.

    Args:
        folder: of the frames.
        entries: frames of the run.
        mesh: its mesh.
        period: length of a cycle [s].

    Returns:
        None where there is no frame after the start, or no lumen.
    """
    begin, frames = cycle_frames(entries, period)
    if not frames or INTERFACE not in mesh.label_names:
        return None
    nodes, inverse = np.unique(mesh.labelled(INTERFACE), return_inverse=True)
    moved, P = [], []
    faces: dict[str, list[float]] = {name: [] for name in mesh.openings}
    for entry in frames:
        arrays = frame_arrays(folder / entry.file, ("pressure_mmHg", "displacement_cm"))
        pressure = arrays["pressure_mmHg"].astype(float)
        moved.append(arrays["displacement_cm"].reshape(-1, 3)[nodes].astype(float))
        P.append(pressure[nodes])
        for name, values in faces.items():
            values.append(_face_mean(mesh, name, pressure))
    t = np.array([entry.t for entry in frames]) - begin
    return LumenCycle(
        nodes=nodes,
        triangles=inverse.reshape(-1, 3),
        points=mesh.points[nodes],
        t=t,
        whole=bool(t[-1] > period * (1.0 - 1e-6)),
        moved=np.array(moved),
        P=np.array(P),
        P_openings={name: np.array(values) for name, values in faces.items()},
    )


def cycle_frames(entries: Sequence[Entry], period: float) -> tuple[float, list[Entry]]:
    """Start of the last whole cycle [s], or of the first, and its frames without that at the start.

    Args:
        entries: frames of the run.
        period: length of a cycle [s].
    """
    if not entries:
        return 0.0, []
    slack = 1e-6 * period
    begin = max(0.0, np.floor(entries[-1].t / period + 1e-6) - 1.0) * period
    return begin, [e for e in entries if begin + slack < e.t < begin + period + slack]


def mean_pressure(
    cycle: LumenCycle, inlet: tuple[str, float], distal: tuple[str, float]
) -> Float[np.ndarray, " nodes"]:
    """Mean pressure of each node over the cycle [mmHg], by the equation above.

    Args:
        cycle: the lumen over it.
        inlet: name of the inlet, and its mean pressure over all steps [mmHg].
        distal: the same of the distal outlet.
    """
    mean = cycle.P.mean(axis=0)
    above, below = (cycle.P_openings[name].mean() for name, _ in (inlet, distal))
    if abs(above - below) < _LEAST_DROP:
        return mean + 0.5 * (inlet[1] - above + distal[1] - below)
    return distal[1] + (mean - below) * (inlet[1] - distal[1]) / (above - below)


def _face_mean(mesh: Mesh, name: str, values: Float[np.ndarray, " nodes"]) -> float:
    """Mean of a field over an opening, triangles weighed by their area."""
    faces = mesh.labelled(name)
    a, b, c = (mesh.points[faces[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return float(area @ values[faces].mean(axis=1) / area.sum())
