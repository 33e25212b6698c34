"""What a finished 3D run shows along the artery, as files for other programs.

`centerline.vtp` and `pullback.csv` hold pressure and lumen along the axis of the anomalous artery,
`lumen.glb` the surface of the blood with colours of the mean pressure over that of the aorta.
"""

import pathlib

import numpy as np
from jaxtyping import Float

from jaxfsi import INTERFACE, Mesh
from jaxfsi.anatomy import Anatomy
from jaxfsi.fields import read_series
from jaxfsi.fields.artery_profile import ArteryProfile, artery_profile
from jaxfsi.mesh_files import write_polylines
from jaxfsi.simulation import StepHistory
from jaxfsi.simulation.cycles import inlet_of
from lumped.units import MM
from lumped.whole_files import write_whole
from study.store.result_files import (
    AXIS_FILE,
    FIELD_FOLDER,
    LUMEN_FILE,
    PULLBACK_FILE,
    SERIES_FILE,
)

_METRE = 0.01  # of a centimetre, the unit of GLB
_COLOURS = np.array(
    [[103, 0, 31], [214, 96, 77], [253, 219, 199], [146, 197, 222], [33, 102, 172]], float
)
_LOWEST = 0.5


def write_artery_files(
    folder: pathlib.Path,
    mesh: Mesh,
    anatomy: Anatomy | None,
    record: StepHistory,
    names: tuple[str, ...],
    period: float,
) -> bool:
    """Write the files of a run into its folder; whether there is anything to write.

    Args:
        folder: of the run, with its fields.
        mesh: the mesh that was solved on.
        anatomy: its anatomy; None: unknown.
        record: of all steps.
        names: of the ports of the model, in their order.
        period: length of a cycle [s].
    """
    entries = read_series(folder / SERIES_FILE)
    if anatomy is None or not entries:
        return False
    inlet = inlet_of(record, names)
    aorta = inlet.t, inlet.P_mmHg
    found = artery_profile(folder / FIELD_FOLDER, entries, mesh, anatomy, period, aorta)
    if found is None:
        return False
    write_profile(folder, found)
    write_whole(folder / LUMEN_FILE, coloured_lumen(mesh, found))
    return True


def _columns(found: ArteryProfile) -> dict[str, Float[np.ndarray, " places"]]:
    """Columns of both files, by name with unit."""
    return {
        "distance_mm": found.s / MM,
        "P_mmHg": found.P,
        "ratio": found.ratio,
        "area_mm2": found.area / MM**2,
        "least_area_mm2": found.least_area / MM**2,
        "least_minor_axis_mm": found.least_minor / MM,
        "image_area_mm2": found.image_area / MM**2,
        "image_minor_axis_mm": found.image_minor / MM,
    }


def write_profile(folder: pathlib.Path, found: ArteryProfile) -> None:
    """Write `centerline.vtp` (mm) and `pullback.csv`.

    Args:
        folder: where they go.
        found: pressure and lumen along the artery.
    """
    columns = _columns(found)
    write_polylines(
        folder / AXIS_FILE,
        found.points / MM,
        [np.arange(len(found.s))],
        point_data=columns,
    )
    rows = [",".join(columns)]
    for row in zip(*columns.values(), strict=True):
        rows.append(",".join("" if np.isnan(v) else f"{v:.6g}" for v in row))
    write_whole(folder / PULLBACK_FILE, "\n".join(rows) + "\n")


def coloured_lumen(mesh: Mesh, found: ArteryProfile) -> bytes:
    """The surface of the blood in its mean shape as a GLB file, in metres.

    Colours run from red at the lowest ratio (not below 0.5) to blue at 1; the file's extras say
    which.
    """
    triangles = mesh.labelled(INTERFACE)
    nodes, faces = np.unique(triangles, return_inverse=True)
    ratio = found.P_nodes[nodes] / found.P_aorta
    ratio = np.where(np.isfinite(ratio), ratio, 1.0)
    low = max(_LOWEST, np.floor(20.0 * float(np.percentile(ratio, 1.0))) / 20.0)
    low = min(low, 0.95)
    place = np.clip((ratio - low) / (1.0 - low), 0.0, 1.0)
    stops = np.linspace(0.0, 1.0, len(_COLOURS))
    colours = np.stack([np.interp(place, stops, _COLOURS[:, i]) for i in range(3)], axis=1)
    alpha = np.full((len(nodes), 1), 255.0)
    import trimesh  # a quarter of a second to import, for surfaces alone

    surface = trimesh.Trimesh(
        (mesh.points + found.moved)[nodes] * _METRE,
        faces.reshape(triangles.shape),
        vertex_colors=np.concatenate([colours, alpha], axis=1).round().astype(np.uint8),
        process=False,
        metadata={"colours": "mean pressure over mean aortic pressure", "red": low, "blue": 1.0},
    )
    data = surface.export(file_type="glb")
    assert isinstance(data, bytes)
    return data
