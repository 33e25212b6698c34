"""What a document holds of the sensitivities of 3D runs."""

import itertools
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from calibration.lumen_shape import LumenSurface, lumen_surface, vessel_nodes
from jaxfsi import Mesh
from jaxfsi.anatomy import Anatomy
from lumped import MM
from study.run.lumen_motion import VESSEL
from study.run.sensitivity import Sensitivity, recalibrated, widening

BOTH = ("alpha", "E", "nu", "thickness", "P_image", "rho_f", "mu")
"""Parameters that a run at rest shares with one under stress."""

_BIN_MM = 1.0
_REACH_MM = 16.0


def sensitivity_parts(
    found: Mapping[tuple[str, str | None], Sensitivity],
    names: Mapping[tuple[str, str | None], str],
    mesh: Mesh,
    anatomy: Anatomy | None,
) -> Iterator[dict[str, Any]]:
    """Entries of the document, one a run.

    Args:
        found: sensitivities by condition and rule.
        names: names of the runs' folders by the same.
        mesh: the mesh.
        anatomy: tells where along the artery a node lies; None: unknown.
    """
    surface = lumen_surface(mesh)
    places = None if anatomy is None else places_along(surface, anatomy)
    rest = next((part for (condition, _), part in found.items() if condition == "rest"), None)
    for (condition, rule), part in found.items():
        again = None
        if condition != "rest" and rest is not None:
            again = recalibrated(part.relative, rest.relative, BOTH.__contains__)
        entry = {
            "run": names[condition, rule],
            "condition": condition,
            "rule": rule,
            "ratio": part.ratio,
            "at_fixed_alpha": part.relative,
            "recalibrated": again,
            "seconds": part.seconds,
            "lumen": None,
        }
        if places is not None:
            entry["lumen"] = along_artery(part, surface, *places)
        yield entry


def places_along(
    surface: LumenSurface, anatomy: Anatomy
) -> tuple[Int[np.ndarray, " chosen"], Float[np.ndarray, " chosen"]] | None:
    """Nodes of the anomalous artery and their distance from the ostium [mm]; None: no axis."""
    line = anatomy.centerlines.get(VESSEL)
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
) -> dict[str, Any]:
    """What a lumen that is wider by 0.1 mm on all sides does, piece by piece and altogether."""
    edges = np.arange(0.0, min(_REACH_MM, float(s_mm.max())) + _BIN_MM, _BIN_MM)
    pieces = [
        widening(part.lumen, surface, chosen[(s_mm >= a) & (s_mm < b)])
        for a, b in itertools.pairwise(edges)
    ]
    return {
        "edges_mm": edges.tolist(),
        "wider_0.1_mm": [float(f"{v:.5g}") for v in pieces],
        "whole_wider_0.1_mm": widening(part.lumen, surface, chosen),
    }
