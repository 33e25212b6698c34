"""Wall shear stress over a cycle: its mean size and how much it changes direction.

::

    TAWSS = 1/T ∫ |τ| dt,     OSI = ½ (1 − |∫ τ dt| / ∫ |τ| dt)

over the time from `t_from` to the end of the run; trapezoids between the instants that are looked
at. OSI is 0 where the direction never changes, ½ where the mean shear vanishes.

Source: He & Ku 1996 (J Biomech Eng 118:74), eqs. 1-2.
"""

import pathlib
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxfsi.core.model import Model
from jaxfsi.core.state import State
from jaxfsi.fields.frame import Grid
from jaxfsi.fields.wall_shear import WallPatches, wall_patches, wall_shear
from jaxfsi.mesh import Mesh
from jaxfsi.simulation.observer import AbstractObserver, Memory


class ShearMeans(NamedTuple):
    """Averages at the nodes of the interface.

    Attributes:
        tawss: time-averaged wall shear stress [dyn/cm²].
        osi: oscillatory shear index.
        mean: mean of the shear vector [dyn/cm²].
        duration: time averaged over [s].
    """

    tawss: Float[np.ndarray, " wall"]
    osi: Float[np.ndarray, " wall"]
    mean: Float[np.ndarray, "wall 3"]
    duration: float


class ShearCycle(AbstractObserver):
    """Adds up the wall shear stress of a run from a given time on."""

    def __init__(self, mesh: Mesh, *, every: int, t_from: float = 0.0):
        """Find the patches of the wall.

        Args:
            mesh: the mesh of the model; it must have blood and an interface.
            every: whole steps between two looks; 40 looks a cycle give the mean to 1 %.
            t_from: time from which on is averaged [s].
        """
        self._patches = wall_patches(mesh)
        self._points = mesh.points
        self._every, self._t_from = every, t_from
        n = self._patches.nodes.shape[0]
        self._size, self._vector = np.zeros(n), np.zeros((3, n))
        self._last = np.zeros((3, n))
        self._times = np.full(2, np.nan)  # of the first and of the last look

    @property
    def name(self) -> str:
        """Of its own."""
        return "shear"

    @property
    def every(self) -> int:
        """Whole steps between two looks."""
        return self._every

    def observe(self, step: int, model: Model, state: State) -> None:
        """Add the trapezoid since the last look."""
        t = float(state.t)
        if t < self._t_from - 1e-9 * max(abs(t), 1.0):
            return
        shear = np.asarray(_shear(model, state, self._patches))
        if np.isnan(self._times[0]):
            self._times[:] = t
        half = 0.5 * (t - self._times[1])
        self._size += half * (np.linalg.norm(shear, axis=0) + np.linalg.norm(self._last, axis=0))
        self._vector += half * (shear + self._last)
        self._last, self._times[1] = shear, t

    def memory(self) -> Memory:
        """Integrals, the last shear and the times."""
        return {
            "size": self._size.copy(),
            "vector": self._vector.copy(),
            "last": self._last.copy(),
            "times": self._times.copy(),
        }

    def restore(self, step: int, memory: Memory) -> None:
        """Take the integrals of a checkpoint."""
        self._size, self._vector = memory["size"].copy(), memory["vector"].copy()
        self._last, self._times = memory["last"].copy(), memory["times"].copy()

    def means(self) -> ShearMeans | None:
        """Averages so far; None before two looks."""
        duration = float(self._times[1] - self._times[0])
        if not duration > 0.0:
            return None
        length = np.linalg.norm(self._vector, axis=0)
        osi = 0.5 * (1.0 - length / np.maximum(self._size, 1e-300))
        osi = np.where(self._size > 0.0, np.clip(osi, 0.0, 0.5), 0.0)
        return ShearMeans(self._size / duration, osi, self._vector.T / duration, duration)

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
        grid.write(path, float(self._times[1]), {n: v.astype("f4") for n, v in values.items()})
        return True


@eqx.filter_jit
def _shear(model: Model, state: State, patches: WallPatches) -> Float[Array, "3 wall"]:
    displacement = jnp.where(model.in_solid, state.d, state.d_mesh)
    return wall_shear(state.u, model.x + displacement, model.blood, patches)
