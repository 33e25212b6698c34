"""From an anatomy to a labelled conforming mesh of blood and wall, in one call.

The stages: sample L and W on a lattice, extract both surfaces, choose element sizes, remesh, cut
at the openings, remesh, project onto L = 0 and W = 0, stand columns of wedges in the wall where
asked, close by caps, fill with tetrahedra, improve, label, check. A mesh that does not pass the
checks is made again with a finer lattice, smaller elements and a closer fit; one whose triangles
cut too much off the tissue between two lumens, at the lip of an ostium, with a closer fit alone.
"""

import contextlib
import dataclasses
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jaxfsi.anatomy import Anatomy
from jaxfsi.mesh import Mesh
from jaxfsi.mesh_parts import reordered
from jaxfsi.meshing.check.fidelity import Fidelity, mesh_fidelity
from jaxfsi.meshing.check.quality import Quality, Wedges, mesh_quality
from jaxfsi.meshing.check.topology import TopologyReport, check_topology
from jaxfsi.meshing.columns.cover import NoColumns, cover
from jaxfsi.meshing.columns.stack import no_stack
from jaxfsi.meshing.demands import MeshRequest, check_demands
from jaxfsi.meshing.isolate import MeshingError, NotInstalledError
from jaxfsi.meshing.labels import label_faces
from jaxfsi.meshing.presets import PRESETS
from jaxfsi.meshing.surface.clipping import (
    clip,
)
from jaxfsi.meshing.surface.complex import Complex, assemble, check_complex
from jaxfsi.meshing.surface.fitted import NAMES, fitted
from jaxfsi.meshing.surface.isosurface import extract_surface
from jaxfsi.meshing.surface.remesh import remesh_surfaces
from jaxfsi.meshing.surface.sizes import SizeField, choose_sizes, sample_surface
from jaxfsi.meshing.volume.fill import fill_complex
from jaxfsi.meshing.volume.lattice import LatticeSettings, sample_lattice
from jaxfsi.opening import canonically_ordered

Progress = Callable[[str, float], None]

LEAST_DIHEDRAL_DEG = 5.0
_LEAST_TRIANGLE_QUALITY = 0.15

LEAST_SEPTUM = 0.75
"""Thickness of the tissue between two lumens, over that of the anatomy, that all but one in a
hundred places must keep for a mesh to be taken at once."""

_CLOSER = 0.5
"""Deviation of the closer fit over that of the attempt."""


class Attempt(NamedTuple):
    """Settings of one attempt.

    Attributes:
        lattice: how finely the anatomy is sampled.
        deviation: of remeshed surfaces before they are projected, over the smallest element.
        refinement: number of tetrahedra aimed at, over that of the preset.
    """

    lattice: LatticeSettings
    deviation: float
    refinement: float


_WITH_WEDGES = 2
"""Attempts with wedges before tetrahedra alone fill the wall."""

ATTEMPTS = (
    Attempt(LatticeSettings(), 1.0, 1.0),
    Attempt(LatticeSettings().finer(), 0.4, 1.4),
    Attempt(LatticeSettings().finer().finer(), 0.15, 2.0),
)


@dataclasses.dataclass(frozen=True)
class MeshReport:
    """What a mesh is like and how it was made.

    Attributes:
        topology: Euler numbers, components, volumes.
        quality: shape of elements, layers, thickness, areas.
        fidelity: thickness and resolution against the anatomy.
        wall_time_s: wall time of each stage of the attempt that succeeded [s].
        retries: why earlier attempts were given up.
        settings: what was asked for.
        notes: what was asked for but could not be had.
    """

    topology: TopologyReport
    quality: Quality
    fidelity: Fidelity
    wall_time_s: dict[str, float]
    retries: tuple[str, ...]
    settings: dict[str, object]
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, object]:
        """Plain values for a JSON file."""
        return {
            "settings": self.settings,
            "topology": self.topology.to_dict(),
            "quality": self.quality.to_dict(),
            "fidelity": self.fidelity.to_dict(),
            "wall_time_s": self.wall_time_s,
            "retries": list(self.retries),
            "notes": list(self.notes),
        }


class MeshResult(NamedTuple):
    """A mesh and what is known of it."""

    mesh: Mesh
    report: MeshReport


_Made = tuple[Mesh, TopologyReport, Quality, Fidelity]


class _Stages:
    """Times stages and tells of their beginning."""

    _SHARES = (
        ("sampling", 0.0),
        ("sizes", 0.15),
        ("remeshing", 0.2),
        ("closing", 0.3),
        ("filling", 0.35),
        ("checking", 0.9),
    )

    def __init__(self, progress: Progress | None):
        self.progress = progress
        self.wall_time_s: dict[str, float] = {}
        self.current: str | None = None
        self.since = 0.0

    def enter(self, stage: str) -> None:
        self.leave()
        self.current, self.since = stage, time.perf_counter()
        if self.progress is not None:
            self.progress(stage, dict(self._SHARES)[stage])

    def leave(self) -> None:
        if self.current is not None:
            self.wall_time_s[self.current] = time.perf_counter() - self.since
        self.current = None


def build_mesh(
    anatomy: Anatomy,
    *,
    preset: str = "medium",
    elements_across: int | None = None,
    wall_layers: int = 2,
    wedge_layers: int = 0,
    backend: str = "netgen",
    progress: Progress | None = None,
) -> MeshResult:
    """Mesh the blood and the wall of an anatomy.

    Args:
        anatomy: implicit lumen and wall with openings, in any order: the mesh has them in that of
            `jaxfsi.opening.canonical_order`.
        preset: ``coarse``, ``medium`` or ``fine``: about 30 000, 150 000 or 500 000 tetrahedra.
        elements_across: least number of elements across the width of the lumen (the minor axis of
            a slit), where the mesh grows beyond the tetrahedra of its preset; None: 6 or 8 of
            a medium or fine preset, two to three of a coarse one.
        wall_layers: layers of tetrahedra through the wall; 2 by splitting, more by smaller
            elements, 1 leaves what the size gives. Beside wedges one layer stands, for
            tetrahedra that bend.
        wedge_layers: layers of wedges in columns through the wall; tetrahedra fill the septum and
            other places where no column fits. With 0 they fill the wall. Where columns cannot be
            had at all, they do so too, and the report's notes say why.
        backend: ``netgen``, or ``gmsh`` or ``tetgen`` where they are installed.
        progress: called with each stage and the share of the work before it.

    Returns:
        The mesh, in an order that keeps neighbours close, and its report.

    Raises:
        ValueError: the request or the anatomy cannot be meshed at all.
        MeshingError: no attempt gave a mesh that passes the checks.
    """
    if elements_across is None and preset in PRESETS:
        elements_across = PRESETS[preset].across
    request = MeshRequest(preset, elements_across, wall_layers, wedge_layers, backend)
    check_demands(anatomy, request, smallest=ATTEMPTS[-1].lattice.smallest)
    anatomy = dataclasses.replace(anatomy, openings=canonically_ordered(anatomy.openings))
    faults: list[str] = []
    for attempt, tried in _plan(request):
        stages = _Stages(progress)
        try:
            made, notes, stages = _fitting(anatomy, attempt, tried, stages)
        except NotInstalledError:
            raise
        except MeshingError as error:
            faults.append(str(error))
            continue
        if tried != request:
            notes.append(f"tetrahedra alone fill the wall: with wedges {faults[_WITH_WEDGES - 1]}")
        mesh, topology, quality, fidelity = made
        report = MeshReport(
            topology,
            quality,
            fidelity,
            stages.wall_time_s,
            tuple(faults),
            request._asdict(),
            tuple(notes),
        )
        return MeshResult(mesh, report)
    raise MeshingError(
        f"{anatomy.name!r} was not meshed in {len(faults)} attempts, the last at finer settings:"
        f" {faults[-1]}"
    )


def _plan(request: MeshRequest) -> list[tuple[Attempt, MeshRequest]]:
    """Attempts one after the other: with wedges where they are asked for, then without."""
    plan = [(attempt, request._replace(wedge_layers=0)) for attempt in ATTEMPTS]
    if request.wedge_layers:
        plan = [(attempt, request) for attempt in ATTEMPTS[:_WITH_WEDGES]] + plan
    return plan


def _fitting(
    anatomy: Anatomy, attempt: Attempt, request: MeshRequest, stages: _Stages
) -> tuple[_Made, list[str], _Stages]:
    """An attempt, with a closer fit where the septum keeps too little of its thickness."""
    made, notes = _attempted(anatomy, attempt, request, stages)
    kept = _septum_kept(made[-1])
    if kept >= LEAST_SEPTUM:
        return made, notes, stages
    closer = attempt._replace(deviation=_CLOSER * attempt.deviation)
    with contextlib.suppress(MeshingError, ValueError):  # what was made is good enough
        more = _Stages(stages.progress)
        again, others = _attempted(anatomy, closer, request, more)
        keeps, wedges = _septum_kept(again[-1]), len(again[0].wedges)
        # columns are given up for a septum that is right, not for one that is hardly better
        if keeps >= LEAST_SEPTUM or (keeps > kept and wedges >= len(made[0].wedges)):
            made, notes, stages, kept = again, others, more, keeps
    if kept < LEAST_SEPTUM:
        notes.append(
            f"the tissue between two lumens keeps {kept:.0%} of its thickness at its worst place"
            " in a hundred: use a finer preset"
        )
    return made, notes, stages


def _septum_kept(fidelity: Fidelity) -> float:
    """Share of its thickness that the septum keeps, in all but one in a hundred places."""
    return 1.0 if fidelity.septum_ratio is None else fidelity.septum_ratio.p1


def _attempted(
    anatomy: Anatomy, attempt: Attempt, request: MeshRequest, stages: _Stages
) -> tuple[_Made, list[str]]:
    complex_, field, notes = _surfaces(anatomy, attempt, request, stages)
    stages.enter("filling")
    layers = request.wall_layers > 1
    filled = fill_complex(complex_, field, backend=request.backend, layers=layers)
    stages.enter("checking")
    mesh = _labelled(anatomy, *filled, complex_.wedges)
    topology, quality = _passed(mesh)
    fidelity = mesh_fidelity(mesh, anatomy)
    stages.leave()
    return (mesh, topology, quality, fidelity), notes


def _surfaces(
    anatomy: Anatomy,
    attempt: Attempt,
    request: MeshRequest,
    stages: _Stages,
) -> tuple[Complex, SizeField, list[str]]:
    functions = (anatomy.lumen, anatomy.wall)
    stages.enter("sampling")
    lattice = sample_lattice(anatomy, attempt.lattice)
    surfaces = [
        extract_surface(lattice.points, lattice.tets, values, f)
        for values, f in zip((lattice.lumen, lattice.wall), functions, strict=True)
    ]
    stages.enter("sizes")
    field = choose_sizes(
        sample_surface(anatomy, surfaces[0]),
        target=round(attempt.refinement * PRESETS[request.preset].tets),
        elements_across=request.elements_across,
        wall_layers=request.wall_layers,
    )
    deviation = attempt.deviation * min(float(sizes.min()) for sizes in field.sizes)
    stages.enter("remeshing")
    surfaces = remesh_surfaces(surfaces, field, deviation=deviation)
    surfaces = [
        clip(surface, anatomy.openings, what=name).surface
        for surface, name in zip(surfaces, NAMES, strict=True)
    ]
    surfaces = remesh_surfaces(surfaces, field, deviation=deviation)
    stages.enter("closing")
    lumen, wall = (fitted(surface, anatomy, i) for i, surface in enumerate(surfaces))
    columns, notes = no_stack(), []
    if request.wedge_layers:
        try:
            covered = cover(lumen, wall, anatomy, field, deviation=deviation)
        except NoColumns as reason:
            notes.append(f"tetrahedra alone fill the wall: {reason}")
        else:
            wall = covered.outer
            columns = covered.stack(lumen, layers=request.wedge_layers)
    complex_ = assemble(
        anatomy, lumen, wall, field, wall_layers=request.wall_layers, columns=columns
    )
    check_complex(complex_, anatomy, least_quality=_LEAST_TRIANGLE_QUALITY)
    return complex_, field, notes


def _labelled(
    anatomy: Anatomy,
    points: np.ndarray,
    tets: np.ndarray,
    region: np.ndarray,
    wedges: np.ndarray,
) -> Mesh:
    try:
        mesh = label_faces(points, tets, region, anatomy.openings)
    except ValueError as error:
        raise MeshingError(str(error)) from error
    meta = {"anatomy": anatomy.name, **anatomy.meta}
    mesh = dataclasses.replace(mesh, wedges=wedges)
    return dataclasses.replace(reordered(mesh), node_ids=None, meta=meta)


def _passed(mesh: Mesh) -> tuple[TopologyReport, Quality]:
    topology = check_topology(mesh)
    try:
        topology.raise_faults()
    except ValueError as error:
        raise MeshingError(str(error)) from error
    quality = mesh_quality(mesh)
    if quality.min_dihedral_deg < LEAST_DIHEDRAL_DEG:
        raise MeshingError(
            f"the smallest dihedral angle is {quality.min_dihedral_deg:.2g} degrees, less than"
            f" {LEAST_DIHEDRAL_DEG:g}. Use a finer preset, or a lumen without sharp corners."
        )
    if quality.wedges is not None:
        _pass_wedges(quality.wedges)
    return topology, quality


def _pass_wedges(wedges: Wedges) -> None:
    jacobian, angle = wedges.scaled_jacobian.minimum, wedges.min_dihedral_deg.minimum
    if jacobian <= 0.0 or angle < LEAST_DIHEDRAL_DEG:
        raise MeshingError(
            f"the poorest wedge has the scaled Jacobian {jacobian:.2g} and the dihedral angle"
            f" {angle:.2g} degrees, allowed from 0 and from {LEAST_DIHEDRAL_DEG:g}."
            " Use a finer preset."
        )
