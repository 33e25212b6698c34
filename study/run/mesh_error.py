"""Mesh error of a study's ramp: the same ramp on a second mesh, both carried on to none.

The second mesh (`study.run.second_mesh`) is coarser or finer in narrow lumens. From both curves
follows the one without mesh error (`calibration.grid_convergence`), and in 0D with it what the mesh
does to R0, α, flow and FFR: α is tuned with each curve, as a study tunes it on its mesh, so that
what calibration takes back is taken back.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from calibration import RampFit, calibrate_alpha, mesh_band
from calibration.alpha import mean_aortic_pressure
from jaxfsi.anatomy import Anatomy
from jaxfsi.mesh import Mesh
from jaxfsi.meshing import elements_across
from lumped import ML_PER_MIN
from study.case.model import Case
from study.run.patient import load_patient
from study.run.ratio_uncertainty import stress_model
from study.run.study_context import case_with_curve
from study.run.study_parts import Band, MeshErrorPart

ORDERS = (2.0, 4.0, 12.0)
"""Least, usual and largest order of the mesh error in the elements across: 2.1 to 9 on the
bundled patient and three drawn anatomies (docs/benchmarks/algorithm-1.md). With 12 the error is
gone on the finer of both meshes."""

_PERCENT = 5.0


def fineness(mesh: Mesh, anatomy: Anatomy) -> float:
    """Elements across the lumen that all but one in twenty of the blood's tetrahedra reach."""
    return float(np.percentile(elements_across(mesh, anatomy), _PERCENT))


def compared(
    case: Case, fits: tuple[RampFit, RampFit], across: tuple[float, float], tets: int
) -> MeshErrorPart:
    """What two meshes say of the mesh error.

    Args:
        case: the case, its conditions calibrated in 0D with every curve.
        fits: curve of its own mesh and of the second one.
        across: elements across the lumen of both, see `fineness`.
        tets: of the second mesh.

    Raises:
        ValueError: the meshes are too much alike, or a number of the case cannot be calibrated.
    """
    tangents = [float(fit.tangent()[0]) for fit in fits]
    band = mesh_band(tangents[0], tangents[1], across[0] / across[1], ORDERS)
    law = fits[0].law
    found = []
    for tangent in band:
        share = float(tangent / band.value)  # of √(a² + 4 b ΔP)
        found.append(_calibrated(case, float(law.R0) * share, float(law.K) * share**2))
    return MeshErrorPart(
        elements_across=across[0],
        second_elements_across=across[1],
        second_tets=tets,
        orders=list(ORDERS),
        tangent_40_mmHg=Band(*(float(tangent) for tangent in band)),
        alpha=_spread([one.alpha for one in found]),
        rest_flow_ml_per_min=_spread([one.rest_flow / ML_PER_MIN for one in found]),
        ffr={name: _spread([one.ffr[name] for one in found]) for name in found[0].ffr},
    )


class _Calibrated(NamedTuple):
    """0D with a curve: α, mean flow at rest [cm³/s] and FFR by condition under stress."""

    alpha: float
    rest_flow: float
    ffr: dict[str, float]


def _calibrated(case: Case, a: float, b: float) -> _Calibrated:
    patient = load_patient(case_with_curve(case, a, b))
    surrogate, rest = patient.model.surrogate, patient.conditions["rest"]
    target = patient.case.conditions["rest"].ffr
    assert target is not None, "checked by check_study"
    alpha = float(calibrate_alpha(surrogate, rest, target).alpha)
    drop = target * mean_aortic_pressure(surrogate, rest) - surrogate.coronary.P_venous
    flow = float(drop / (alpha * surrogate.coronary.R_total))
    return _Calibrated(
        alpha, flow, {n: float(stress_model(patient, n)()) for n in patient.stresses}
    )


def _spread(values: Sequence[float]) -> Band:
    """Values with the curves of a band."""
    value, expected, *ends = values
    return Band(value, expected, min(ends), max(ends))
