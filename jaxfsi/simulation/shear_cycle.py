"""Wall shear stress over a cycle: its mean size and how much it changes direction.

::

    TAWSS = 1/T ∫ |τ| dt,     OSI = ½ (1 − |∫ τ dt| / ∫ |τ| dt)

over each cycle of length T; trapezoids between the instants that are looked at. The last cycle
that was completed counts, or what there is of the first. OSI is 0 where the direction never
changes, ½ where the mean shear vanishes.

Source: He & Ku 1996 (J Biomech Eng 118:74), eqs. 1-2.
"""

import math
import pathlib
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxfsi.core.step.model import Model
from jaxfsi.core.step.state import State
from jaxfsi.fields.frame import Grid
from jaxfsi.fields.wall_shear import WallPatches, wall_patches, wall_shear
from jaxfsi.measures import triangle_areas
from jaxfsi.mesh import Mesh
from jaxfsi.simulation.observer import AbstractObserver, ObserverState
from lumped.device import quick_jit


class ShearMeans(NamedTuple):
    """Averages at the nodes of the interface.

    Attributes:
        tawss: time-averaged wall shear stress [dyn/cm²].
        osi: oscillatory shear index.
        mean: mean of the shear vector [dyn/cm²].
        area: of the node's share of the interface, a third of its triangles, undeformed [cm²].
        duration: time averaged over [s].
        t_end: its end [s].
    """

    tawss: Float[np.ndarray, " wall"]
    osi: Float[np.ndarray, " wall"]
    mean: Float[np.ndarray, "wall 3"]
    area: Float[np.ndarray, " wall"]
    duration: float
    t_end: float

    @property
    def mean_tawss(self) -> float:
        """Mean of the time-averaged shear over the interface [dyn/cm²]."""
        return float(np.average(self.tawss, weights=self.area))

    @property
    def mean_osi(self) -> float:
        """Mean of the oscillatory shear index over the interface."""
        return float(np.average(self.osi, weights=self.area))

    def tawss_above(self, share: float) -> float:
        """Time-averaged shear that a share of the interface exceeds [dyn/cm²].

        Args:
            share: of the area, from 0 to 1.
        """
        order = np.argsort(self.tawss)
        below = np.cumsum(self.area[order]) - 0.5 * self.area[order]
        return float(np.interp((1.0 - share) * self.area.sum(), below, self.tawss[order]))


class ShearCycle(AbstractObserver):
    """Adds up the wall shear stress of each cycle of a run."""

    def __init__(self, mesh: Mesh, *, every: int, period: float = math.inf):
        """Find the patches of the wall.

        Args:
            mesh: the mesh of the model; it must have blood and an interface.
            every: whole steps between two looks; 40 looks a cycle give the mean to 1 %. The end of
                a cycle should be one of them.
            period: length of a cycle [s], counted from t = 0; by default the whole run is one.
        """
        self._patches = wall_patches(mesh)
        self._points = mesh.points
        self._every, self._period = every, period
        self._area = _nodal_area(mesh, self._patches)
        n = self._patches.nodes.shape[0]
        self._sums: ObserverState = {
            "size": np.zeros(n),
            "vector": np.zeros((3, n)),
            "last": np.zeros((3, n)),
            "times": np.full(2, np.nan),  # of the first and of the last look of this cycle
            "whole_size": np.zeros(n),  # the same of the last whole cycle
            "whole_vector": np.zeros((3, n)),
            "whole_times": np.full(2, np.nan),
        }

    @property
    def name(self) -> str:
        """Name of this observer."""
        return "shear"

    @property
    def every(self) -> int:
        """Whole steps between two looks."""
        return self._every

    def observe(self, step: int, model: Model, state: State) -> None:
        """Add the trapezoid since the last look; a cycle that is over makes way for the next."""
        t = float(state.t)
        shear = np.asarray(_shear(model, state, self._patches))
        now = self._sums
        if np.isnan(now["times"][0]):
            now["times"] = np.array([t, t])
        first, last = now["times"]
        half = 0.5 * (t - last)
        length = np.linalg.norm(shear, axis=0) + np.linalg.norm(now["last"], axis=0)
        now["size"] = now["size"] + half * length
        now["vector"] = now["vector"] + half * (shear + now["last"])
        now["last"], now["times"] = shear, np.array([first, t])
        if math.floor(t / self._period + 1e-6) > math.floor(first / self._period + 1e-6):
            for name in ("size", "vector", "times"):
                now[f"whole_{name}"] = now[name]
                now[name] = np.zeros_like(now[name])
            now["times"] = np.array([t, t])

    def saved_state(self) -> ObserverState:
        """Integrals, the last shear and the times; arrays are replaced, never changed."""
        return dict(self._sums)

    def restore(self, step: int, saved_state: ObserverState) -> None:
        """Take the integrals of a checkpoint."""
        self._sums = dict(saved_state)

    def means(self) -> ShearMeans | None:
        """Averages over the last whole cycle, or over what there is of the first; None before."""
        now = self._sums
        whole = "" if np.isnan(now["whole_times"][0]) else "whole_"
        first, last = now[f"{whole}times"]
        duration = float(last - first)
        if not duration > 0.0:
            return None
        size, vector = now[f"{whole}size"], now[f"{whole}vector"]
        length = np.linalg.norm(vector, axis=0)
        osi = np.clip(0.5 * (1.0 - length / np.maximum(size, 1e-300)), 0.0, 0.5)
        osi = np.where(size > 0.0, osi, 0.0)
        shear, mean = size / duration, vector.T / duration
        return ShearMeans(shear, osi, mean, self._area, duration, float(last))

    def write(self, path: pathlib.Path) -> bool:
        """Write the averages as a VTU file of the interface; says whether there were any."""
        means = self.means()
        if means is None:
            return False
        nodes, faces = np.asarray(self._patches.nodes), np.asarray(self._patches.faces).T
        grid = Grid(self._points[nodes], np.searchsorted(nodes, faces))
        values = {
            "tawss_dyn_per_cm2": means.tawss,
            "osi": means.osi,
            "mean_wss_dyn_per_cm2": means.mean,
        }
        grid.write(path, means.t_end, {n: v.astype("f4") for n, v in values.items()})
        return True


@quick_jit
def _shear(model: Model, state: State, patches: WallPatches) -> Float[Array, "3 wall"]:
    displacement = jnp.where(model.in_solid, state.d, state.d_mesh)
    return wall_shear(state.u, model.x + displacement, model.blood, patches)


def _nodal_area(mesh: Mesh, patches: WallPatches) -> Float[np.ndarray, " wall"]:
    faces, nodes = np.asarray(patches.faces).T, np.asarray(patches.nodes)
    thirds = np.repeat(triangle_areas(mesh.points, faces) / 3.0, 3)
    return np.bincount(faces.ravel(), thirds, minlength=len(mesh.points))[nodes]
