"""What a document holds of the sensitivities of 3D runs."""

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float, Int

from jaxfsi import Mesh
from jaxfsi.adjoint.chain_rules import recalibrated
from jaxfsi.adjoint.lumen_shape import LumenSurface, lumen_surface, vessel_nodes, widening
from jaxfsi.anatomy import Anatomy
from jaxfsi.opening import ANOMALOUS
from lumped import MM
from study.report.documents.study import LumenPieces, Sensitivity3D
from study.run.results import Run3D
from study.run.study_parts import Sensitivity

BOTH = ("alpha", "E", "nu", "thickness", "P_image", "rho_f", "mu")
"""Parameters that a run at rest shares with one under stress."""

_BIN_MM = 1.0
_REACH_MM = 16.0


def sensitivity_parts(
    runs: Sequence[tuple[Run3D, Sensitivity]], mesh: Mesh, anatomy: Anatomy | None
) -> Iterator[Sensitivity3D]:
    """Entries of the document, one a run.

    Args:
        runs: runs with what moves their ratios.
        mesh: the mesh.
        anatomy: tells where along the artery a node lies; None: unknown.
    """
    if not runs:
        return
    surface = lumen_surface(mesh)
    places = None if anatomy is None else places_along(surface, anatomy)
    rest = next((part for run, part in runs if run.is_rest), None)
    for run, part in runs:
        again = None
        if not run.is_rest and rest is not None:
            again = recalibrated(part.relative, rest.relative, BOTH.__contains__)
        yield Sensitivity3D(
            run=run.id,
            condition=run.condition,
            rule=run.rule,
            ratio=part.ratio,
            at_fixed_alpha=part.relative,
            recalibrated=again,
            seconds=part.seconds,
            lumen=None if places is None else along_artery(part, surface, *places),
        )


def places_along(
    surface: LumenSurface, anatomy: Anatomy
) -> tuple[Int[np.ndarray, " chosen"], Float[np.ndarray, " chosen"]] | None:
    """Nodes of the anomalous artery and their distance from the ostium [mm]; None: no axis."""
    line = anatomy.centerlines.get(ANOMALOUS)
    if line is None:
        return None
    chosen = np.flatnonzero(vessel_nodes(surface, line.points))
    apart = np.linalg.norm(surface.points[chosen][:, None] - line.points[None], axis=2)
    return chosen, np.asarray(line.s)[np.argmin(apart, axis=1)] / MM


def along_artery(
    part: Sensitivity,
    surface: LumenSurface,
    chosen: Int[np.ndarray, " chosen"],
    s_mm: Float[np.ndarray, " chosen"],
) -> LumenPieces:
    """What a lumen that is wider by 0.1 mm on all sides does, piece by piece and altogether."""
    edges = np.arange(0.0, min(_REACH_MM, float(s_mm.max())) + _BIN_MM, _BIN_MM)
    pieces = [
        widening(part.lumen, surface, chosen[(s_mm >= a) & (s_mm < b)])
        for a, b in itertools.pairwise(edges)
    ]
    return LumenPieces(
        edges_mm=edges.tolist(),
        wider=[float(f"{v:.5g}") for v in pieces],
        whole_wider=widening(part.lumen, surface, chosen),
    )
