"""Closed surfaces filled with tetrahedra by one of several backends.

A backend is an adapter in `jaxfsi.meshing.native` that takes a closed surface and returns
tetrahedra whose first nodes are the surface's, in its order. The regions of a complex are filled
and improved side by side, each from its own surface; as neither step touches the surface, they
fit together at the interface.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jaxfsi.mesh import Region, tet_volumes
from jaxfsi.meshing.isolate import Arrays, MeshingError, native_call, run_all_isolated
from jaxfsi.meshing.surface.complex import (
    Complex,
    RegionSurface,
    region_surface,
    unfilled_surface,
)
from jaxfsi.meshing.surface.isosurface import Surface
from jaxfsi.meshing.surface.remesh import volume_call
from jaxfsi.meshing.surface.sizes import SizeField
from jaxfsi.meshing.volume.layers import split_spanning_edges
from jaxfsi.meshing.volume.relief import relieved

_SAME_POINT = 1e-9


class Backend(NamedTuple):
    """A mesher that fills closed surfaces.

    Attributes:
        licence: of the library behind it.
        adapter: name of its file in `jaxfsi.meshing.native`.
        options: settings of its adapter.
        few: settings of its adapter for tetrahedra without inner nodes where that goes.
    """

    licence: str
    adapter: str
    options: dict[str, object]
    few: dict[str, object]


BACKENDS: Mapping[str, Backend] = MappingProxyType(
    {
        "netgen": Backend(
            "LGPL-2.1",
            "fill_netgen",
            {"steps": 1, "grading": 0.4},
            {"steps": 3, "grading": 1.0},
        ),
        "gmsh": Backend("GPL-2.0-or-later", "fill_gmsh", {"algorithm": 1}, {"algorithm": 1}),
        "tetgen": Backend(
            "AGPL-3.0-or-later",
            "fill_tetgen",
            {"switches": "pq1.4/12YQ"},
            {"switches": "pq2.0/8YQ"},
        ),
    }
)


class Filling(NamedTuple):
    """Tetrahedra of one or several regions over shared nodes.

    Attributes:
        points: nodes [cm].
        tets: positively oriented.
        region: `Region` of each tetrahedron.
    """

    points: Float[np.ndarray, "nodes 3"]
    tets: Int[np.ndarray, "tets 4"]
    region: Int[np.ndarray, " tets"]


def backend_named(name: str) -> Backend:
    """A backend by its name.

    Raises:
        ValueError: there is none of this name.
    """
    if name not in BACKENDS:
        raise ValueError(
            f"there is no meshing backend {name!r}. Choose one of {', '.join(BACKENDS)}."
        )
    return BACKENDS[name]


def fill_surfaces(
    surfaces: Sequence[Surface], backend: str = "netgen", *, few: Sequence[bool] = ()
) -> list[Filling]:
    """Fill closed surfaces with tetrahedra, side by side.

    Args:
        surfaces: closed, normals outwards.
        backend: ``netgen``, or ``gmsh`` or ``tetgen`` where they are installed.
        few: for each surface whether as few tetrahedra as can be fill it; empty for none.

    Returns:
        For each surface its vertices in their order followed by inner nodes, and tetrahedra;
        the region of all is 0.

    Raises:
        ValueError: there is no such backend.
        MeshingError: the backend is not installed, or cannot fill a surface.
    """
    chosen = backend_named(backend)
    calls = [
        native_call(chosen.adapter, surface._asdict(), chosen.few if sparse else chosen.options)
        for surface, sparse in zip(surfaces, few or [False] * len(surfaces), strict=True)
    ]
    filled = run_all_isolated(calls)
    return [
        _checked(out, surface.points, backend)
        for out, surface in zip(filled, surfaces, strict=True)
    ]


def fill_complex(
    complex_: Complex, field: SizeField, *, backend: str = "netgen", layers: bool = True
) -> Filling:
    """Fill blood and wall of a complex and improve the tetrahedra by mmg3d.

    Wedges are filled by three tetrahedra each, which stay as they are. The wall beside them bends
    by edges of its own (`jaxfsi.core.elements`), so that one layer of tetrahedra is enough there:
    as few fill it as can be. Flat tetrahedra of both regions are then mended one by one.

    Args:
        complex_: closed surfaces of both regions over shared points.
        field: element size.
        backend: what fills them.
        layers: at least two layers of tetrahedra between any two surfaces; not beside wedges.

    Raises:
        MeshingError: a mesher fails or changes a surface.
    """
    surfaces = [region_surface(complex_, Region.FLUID)]
    beside = unfilled_surface(complex_)
    if beside is not None:
        surfaces.append(beside)
    few = [False, len(complex_.wedges) > 0][: len(surfaces)]
    filled = fill_surfaces([Surface(s.points, s.triangles) for s in surfaces], backend, few=few)
    calls = [
        volume_call(part.points, part.tets, surface.triangles, surface.label, field, layers=layers)
        for part, surface, sparse in zip(filled, surfaces, few, strict=True)
        if not sparse
    ]
    improved = [
        _checked(out, surface.points, "mmg3d")
        for out, surface in zip(run_all_isolated(calls), surfaces, strict=False)
    ]
    if layers:
        improved = [_in_layers(part) for part in improved]
    if any(few):
        parts = [*improved, filled[-1]]
        improved = [_mended(complex_, *part) for part in zip(surfaces, parts, strict=True)]
    return _joined(complex_, surfaces, improved)


def _mended(complex_: Complex, surface: RegionSurface, part: Filling) -> Filling:
    """Tetrahedra of a region without flat ones; none has all its nodes at one wedge."""
    number = np.full(len(complex_.points), -1, dtype=np.int64)
    number[surface.nodes] = np.arange(len(surface.nodes))
    sides = number[complex_.wedges][:, [[0, 1, 4, 3], [1, 2, 5, 4], [2, 0, 3, 5]]].reshape(-1, 4)
    sides = np.unique(np.sort(sides[(sides >= 0).all(axis=1)], axis=1), axis=0)
    points, tets = relieved(part.points, part.tets, surface.triangles, surface.label, barred=sides)
    return _checked({"points": points, "tets": tets}, surface.points, "mmg3d")


def _in_layers(part: Filling) -> Filling:
    points, tets = split_spanning_edges(part.points, part.tets)
    return Filling(points, tets, np.zeros(len(tets), dtype=np.int64))


def _checked(out: Arrays, surface: Float[np.ndarray, "points 3"], name: str) -> Filling:
    """Refuse a filling that is empty, inverted or does not begin with the surface's vertices."""
    points, tets = out["points"], out["tets"]
    if len(tets) == 0:
        raise MeshingError(
            f"{name} could not fill a region. Its surface probably cuts itself: use a finer preset"
            " or another backend."
        )
    kept = len(points) >= len(surface) and np.allclose(
        points[: len(surface)], surface, rtol=0.0, atol=_SAME_POINT
    )
    if not kept:
        raise MeshingError(
            f"{name} changed the surface that it was to fill. Use another backend, or a finer"
            " preset."
        )
    volumes = tet_volumes(points, tets)
    if volumes.sum() < 0.0:
        tets, volumes = tets[:, [0, 1, 3, 2]], -volumes
    if volumes.min() <= 0.0:
        raise MeshingError(
            f"{name} made {np.sum(volumes <= 0.0)} inverted tetrahedra. Use a finer preset or"
            " another backend."
        )
    return Filling(points, tets, np.zeros(len(tets), dtype=np.int64))


def _joined(
    complex_: Complex, surfaces: Sequence[RegionSurface], parts: Sequence[Filling]
) -> Filling:
    points, tets, region = [complex_.points], [], []
    count = len(complex_.points)
    for which, surface, part in zip(Region, surfaces, parts, strict=False):
        inner = part.points[len(surface.points) :]
        nodes = np.concatenate([surface.nodes, count + np.arange(len(inner))])
        points.append(inner)
        tets.append(nodes[part.tets])
        region.append(np.full(len(part.tets), int(which), dtype=np.int64))
        count += len(inner)
    if len(complex_.wedges):
        tets.append(complex_.wedge_tets)
        region.append(np.full(len(tets[-1]), int(Region.SOLID), dtype=np.int64))
    return Filling(np.concatenate(points), np.concatenate(tets), np.concatenate(region))
