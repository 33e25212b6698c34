"""Thin shells in large rotations with one layer of wedges, against published curves.

Three meshes of each problem, each twice as fine as the one before; the order of convergence is that
of the differences between them.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from benchmarks.timing import timed
from jaxfsi.verification import shells

LIMIT = 0.03
"""Largest error of the finest mesh, over the largest deflection of the problem."""


class _Case(NamedTuple):
    name: str
    problem: Callable[..., shells.ShellProblem]
    meshes: tuple[tuple[int, ...], ...]


_CASES = (
    _Case("cantilever, end shear", shells.cantilever_under_shear, ((4, 1), (8, 1), (16, 1))),
    _Case("cantilever, end moment", shells.cantilever_under_moment, ((16, 1), (32, 1), (64, 1))),
    _Case("slit annular plate", shells.slit_annular_plate, ((4, 32), (8, 64), (16, 128))),
    _Case("pinched hemisphere", shells.pinched_hemisphere, ((12,), (24,), (48,))),
)

NOTES = [
    "Shells: deflection at the full load; the reference of Sze, Liu & Lo"
    " 2004 is that of Abaqus S4R on fine meshes, of the moment the exact one. order: of the"
    " differences between three meshes.",
    "Hemisphere at half the load (outward, inward), Abaqus manual, 3DNLG-9, one nodal spacing for"
    " all elements: S4R 3.41, 5.90; S3R 3.34, 5.67; SC6R, a continuum shell of six nodes, 3.21,"
    " 5.42. Published curve: 3.406, 5.902.",
    "Hemisphere at 1 % of the load, Elmer, shell elements of order 4 (its test"
    " Shell_OpenHemisphere_High_Order_Blending): 0.18494, 0.18902.",
]


def shell_rows() -> list[dict[str, Any]]:
    """Rows of all problems."""
    rows = []
    for case in _CASES:
        for mesh in case.meshes:
            rows += _rows(case.name, case.problem(*mesh), mesh)
        own = [row for row in rows if row["case"] == case.name]
        for name in dict.fromkeys(row["deflection"] for row in own):
            found = [row for row in own if row["deflection"] == name]
            steps = np.abs(np.diff([row["found"] for row in found]))
            found[-1]["order"] = float(np.log2(steps[0] / steps[1]))
    shares = np.array([0.01, 0.5])
    part = shells.pinched_hemisphere(48)._replace(loads=shares)
    other_codes = {0.01: (0.18494, 0.18902), 0.5: (3.406, 5.902)}
    for share, deflections in zip(shares, shells.shell_path(part).deflections, strict=True):
        for watched, value, known in zip(
            part.deflections, deflections, other_codes[float(share)], strict=True
        ):
            case = f"hemisphere, {100 * share:.0f} % load"
            rows.append(_row(case, (48,), watched.name, value, known, known))
    return rows


def finest(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The rows of the finest mesh of each problem."""
    last = {case.name: "x".join(map(str, case.meshes[-1])) for case in _CASES}
    return [row for row in rows if last.get(row["case"], row["mesh"]) == row["mesh"]]


def _rows(name: str, problem: shells.ShellProblem, mesh: tuple[int, ...]) -> list[dict[str, Any]]:
    path, seconds = timed(lambda: shells.shell_path(problem))
    size = max(d.reference for d in problem.deflections)
    return [
        _row(name, mesh, d.name, value, d.reference, size)
        | {"linear_systems": path.n_iterations, "first_s": seconds}
        for d, value in zip(problem.deflections, path.deflections[-1], strict=True)
    ]


def _row(
    case: str, mesh: tuple[int, ...], deflection: str, value: float, reference: float, size: float
) -> dict[str, Any]:
    return {
        "case": case,
        "element": "bending",
        "layers": 1,
        "mesh": "x".join(map(str, mesh)),
        "deflection": deflection,
        "found": float(value),
        "reference": reference,
        "error": float(abs(value - reference) / size),
    }
