"""The fields of a run as a time series for ParaView, written while it runs.

Each frame is a VTU file that PyVista and meshio read too. One mesh holds both regions (cell array
``region``: 0 blood, 1 wall, as the field data ``region_blood`` and ``region_wall`` say). Points
stay where they are in the reference configuration; ``displacement_cm`` (that of the wall in the
wall, that of the blood's mesh in the blood) moves them: Warp By Vector in ParaView,
``warp_by_vector`` in PyVista.

| array | where | |
|---|---|---|
| ``velocity_cm_per_s`` | points | of blood and wall |
| ``pressure_mmHg`` | points | of the blood; not a number inside the wall, which has none |
| ``displacement_cm`` | points | see above |
| ``wss_dyn_per_cm2`` | points | shear stress on the interface, 0 elsewhere |
| ``stress_dyn_per_cm2`` | cells | Cauchy stress of the wall: xx, yy, zz, xy, yz, xz |
| ``von_mises_dyn_per_cm2`` | cells | its von Mises stress; all cell arrays are 0 in the blood |
| ``strain`` | cells | Green's strain of the wall, in the same order |

Stress and strain are the means of an element's quadrature points, prestress included. Fields are
in single precision: the files are half as large.
"""

import pathlib

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxfsi.core.laws.wall_balance import wall_geometry
from jaxfsi.core.step.model import Model
from jaxfsi.core.step.state import State
from jaxfsi.fields.frame import Grid
from jaxfsi.fields.series import Entry, find_frames, frame_name, write_series
from jaxfsi.fields.wall_shear import WallPatches, wall_patches, wall_shear
from jaxfsi.fields.wall_stress import wall_stress
from jaxfsi.mesh import INTERFACE, Mesh, Region
from jaxfsi.simulation.observer import AbstractObserver, ObserverState
from lumped.device import quick_jit
from lumped.units import MMHG

_VOIGT = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))


class FieldSeries(AbstractObserver):
    """Writes ``NAME.pvd`` and one VTU file a frame."""

    def __init__(self, folder: pathlib.Path, mesh: Mesh, *, every: int, stem: str = "fields"):
        """Make the folder; nothing is written before the first frame.

        Args:
            folder: where the files go; made if needed.
            mesh: the mesh of the model.
            every: whole steps between two frames.
            stem: how the files' names begin.
        """
        folder.mkdir(parents=True, exist_ok=True)
        self._folder, self._stem, self._every = folder, stem, every
        self._entries: list[Entry] = []
        self._grid = Grid(
            mesh.points,
            mesh.tets,
            {"region": mesh.region.astype(np.uint8)},
            {"region": ("blood", "wall")},
        )
        self._solid = mesh.region == Region.SOLID
        wet = np.any(mesh.region == Region.FLUID) and INTERFACE in mesh.label_names
        self._patches = wall_patches(mesh) if wet else None

    @property
    def name(self) -> str:
        """The stem."""
        return self._stem

    @property
    def every(self) -> int:
        """Whole steps between two frames."""
        return self._every

    @property
    def path(self) -> pathlib.Path:
        """The PVD file."""
        return self._folder / f"{self._stem}.pvd"

    def observe(self, step: int, model: Model, state: State) -> None:
        """Write a frame and add it to the PVD."""
        points, cells = frame_fields(model, state, self._patches)
        points = {name: values[: self._grid.n_points] for name, values in points.items()}
        whole = {
            name: np.zeros((len(self._solid), *v.shape[1:]), np.float32)
            for name, v in cells.items()
        }
        for name, values in cells.items():
            whole[name][self._solid] = values
        t, file = float(state.t), frame_name(self._stem, step)
        self._grid.write(self._folder / file, t, points, whole)
        self._entries = [*(e for e in self._entries if e.step < step), Entry(t, file)]
        write_series(self.path, self._entries)

    def saved_state(self) -> ObserverState:
        """Nothing: the files hold it."""
        return {}

    def restore(self, step: int, saved_state: ObserverState) -> None:
        """List the frames up to a step anew, whatever the PVD says; later ones come again.

        A frame that was removed, or whose time cannot be read, is left out.
        """
        frames = find_frames(self._folder, self._stem)
        self._entries = [e for e in frames if e.step <= step and e.step % self._every == 0]
        write_series(self.path, self._entries)


Arrays = dict[str, np.ndarray]


def frame_fields(model: Model, state: State, patches: WallPatches | None) -> tuple[Arrays, Arrays]:
    """Fields at the points of the mesh, and on the elements of its wall, as files name them."""
    points, cells = jax.device_get(_fields(model, state, patches))
    return points, cells


@quick_jit
def _fields(model: Model, state: State, patches: WallPatches | None):
    displacement = jnp.where(model.in_solid, state.d, state.d_mesh)
    # the node from which the pressure may count is one of the blood, though it is no unknown there
    wet = jnp.zeros(model.n_nodes, bool).at[model.fluid_tets].set(True)
    points = {
        "velocity_cm_per_s": state.u.T,
        "pressure_mmHg": jnp.where(wet, state.p, jnp.nan) / MMHG,
        "displacement_cm": displacement.T,
    }
    points = {name: field[: model.n_vertices] for name, field in points.items()}
    if patches is not None:
        shear = wall_shear(state.u, model.x + displacement, model.blood, patches)
        points["wss_dyn_per_cm2"] = (
            jnp.zeros((3, model.n_vertices)).at[:, patches.nodes].set(shear).T
        )
    cells = {}
    if model.wall is not None:
        shape = wall_geometry(model.x, model.element)
        found = wall_stress(
            state.u, state.d, model.wall, model.element, shape, model.prestress, model.P_ambient
        )
        cells = {
            "stress_dyn_per_cm2": _voigt(found.sigma),
            "von_mises_dyn_per_cm2": found.von_mises,
            "strain": _voigt(found.strain),
        }
    return jax.tree.map(lambda a: a.astype(jnp.float32), (points, cells))


def _voigt(tensor: Float[Array, "3 3 tets"]) -> Float[Array, "tets 6"]:
    return jnp.stack([tensor[i, j] for i, j in _VOIGT], axis=1)
