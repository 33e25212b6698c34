"""Surfaces and volumes brought to a size field by mmg (Dapogny, Dobrzynski and Frey 2014)."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from jaxfsi.meshing.isolate import NativeCall, native_call, run_all_isolated
from jaxfsi.meshing.surface.isosurface import Surface
from jaxfsi.meshing.surface.sizes import SizeField, size_at

_GRADATION = 1.3


def remesh_surfaces(
    surfaces: Sequence[Surface],
    field: SizeField,
    *,
    deviation: float,
    kept: Int[np.ndarray, "edges 2"] | None = None,
) -> list[Surface]:
    """Remesh surfaces side by side; open borders stay where they are.

    Args:
        surfaces: what is remeshed.
        field: element size.
        deviation: largest distance between old and new surface [cm].
        kept: edges of every surface that are neither split nor moved.
    """
    options: dict[str, object] = {
        "hausd": deviation,
        "hgrad": _GRADATION,
        # Vessel surfaces are smooth: creases of the triangulation are no features.
        "angle": 0,
    }
    calls = [
        native_call(
            "mmg_surface",
            {
                "points": surface.points,
                "triangles": surface.triangles,
                "size": size_at(field, surface.points),
                **({} if kept is None else {"kept": kept}),
            },
            options,
        )
        for surface in surfaces
    ]
    return [Surface(out["points"], out["triangles"]) for out in run_all_isolated(calls)]


def volume_call(
    points: Float[np.ndarray, "nodes 3"],
    tets: Int[np.ndarray, "tets 4"],
    triangles: Int[np.ndarray, "triangles 3"],
    label: Int[np.ndarray, " triangles"],
    field: SizeField,
    *,
    layers: bool,
) -> NativeCall:
    """A call that improves the tetrahedra of one region and keeps its surface triangles.

    Args:
        points: nodes [cm].
        tets: positively oriented.
        triangles: of the surface, normals outwards.
        label: of each triangle; edges between labels stay.
        field: element size.
        layers: split edges that run from surface to surface, so that two layers fill thin parts.
    """
    arrays = {
        "points": points,
        "tets": tets,
        "region": np.zeros(len(tets), dtype=np.int64),
        "triangles": triangles,
        "label": label,
        "size": size_at(field, points),
    }
    options: dict[str, object] = {"hgrad": _GRADATION, "nosurf": 1, "angle": 0}
    return native_call("mmg_volume", arrays, options if layers else {**options, "nofem": 1})
