"""Elements of the wall: bending and near incompressibility of each, as deflection over the exact.

A clamped strip and a squeezed ring with one to three layers and elements as long as the wall is
thick, or twice as long; a thick tube against Lamé; thin shells in large rotations against published
curves. One number is right where linear elements lock.
"""

from typing import Any

from benchmarks import wall_shells
from benchmarks.timing import timed
from jaxfsi.core.statics.equilibrium import equilibrium, static_factor
from jaxfsi.verification import (
    RING_WORK,
    STRIP_WORK,
    WallProblem,
    axial_strain,
    clamped_strip,
    lame_displacement,
    radial_displacement,
    squeezed_ring,
    thick_tube,
    work,
)

_LEAST, _MOST = 0.94, 1.03
"""Share of the deflection that one layer of wedges reaches."""

_RATIOS = (0.3, 0.49, 0.4999)
_ELEMENTS = ("linear", "bending", "quadratic")


def run(rounds: int) -> dict[str, Any]:
    """Run the benchmark; it has one round, since nothing is timed twice."""
    del rounds
    rows = []
    for nu in _RATIOS:
        for element in _ELEMENTS:
            for layers in (1, 2, 3):
                problem = clamped_strip(nu, element, n_layers=layers)
                rows.append(_row("strip", nu, element, layers, problem, STRIP_WORK[nu]))
            for layers, around in ((1, 16), (1, 32), (2, 32)):
                problem = squeezed_ring(
                    nu, element, n_layers=layers, n_around=around, n_axial=max(2, around // 10)
                )
                rows.append(_row("ring", nu, element, layers, problem, RING_WORK[nu], around))
            for layers in (1, 2) if element == "bending" else (2,):
                problem = thick_tube(nu, element, n_layers=layers)
                rows.append(_row("tube", nu, element, layers, problem, None, 32))
    worst = max(
        abs(row["ratio"] - 1.0)
        for row in rows
        if row["element"] == "quadratic" and row["around"] != 16
    )
    one_layer = [
        row
        for row in rows
        if row["element"] == "bending"
        and row["layers"] == 1
        and row["around"] != 16
        and row["nu"] < 0.4999
    ]
    shells = wall_shells.shell_rows()
    far = max(row["error"] for row in wall_shells.finest(shells))
    return {
        "name": "wall",
        "rows": rows + shells,
        "notes": [
            "ratio: work of the load over the converged one; of the tube, widening over Lamé's with"
            " the axial strain found.",
            "16 round the ring makes elements twice as long as the wall is thick.",
            *wall_shells.NOTES,
        ],
        "passed": worst <= 0.05
        and far <= wall_shells.LIMIT
        and all(_LEAST <= row["ratio"] <= _MOST for row in one_layer),
    }


def _row(
    case: str,
    nu: float,
    element: str,
    layers: int,
    problem: WallProblem,
    reference: float | None,
    around: int | str = "",
) -> dict[str, Any]:
    def solve() -> Any:
        factor = static_factor(problem.model)
        return equilibrium(
            problem.model, problem.loads, factor, max_linear=300, tolerance=1e-7, throw=False
        )

    end, seconds = timed(solve)
    if reference is None:
        strain = axial_strain(problem.mesh, end.d, 1.0, 0.4)
        exact = lame_displacement(0.5, 0.5, 0.6, 1e-4, 1.0, nu, strain)
        ratio = radial_displacement(problem, end.d, 0.5, 1.0) / exact
    else:
        ratio = work(problem, end.d) / reference
    return {
        "case": case,
        "nu": nu,
        "element": element,
        "layers": layers,
        "around": around,
        "ratio": float(ratio),
        "linear_iterations": int(end.n_gmres),
        "out_of_balance": float(end.residual),
        "first_s": seconds,
    }
