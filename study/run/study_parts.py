"""Parts of the document of a study, as plain classes."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from study.store.json_form import ABSENT, Absent


@dataclasses.dataclass(frozen=True)
class Code:
    """Code that computed something; None where that is not known.

    Attributes:
        version: of the package.
        commit: of its checkout.
        libraries: versions by name.
        numerics: versions of the parts of the numerics by name.
    """

    version: str | None
    commit: str | None
    libraries: dict[str, str | None] | None
    numerics: dict[str, str] | None


@dataclasses.dataclass(frozen=True)
class ComputedPart:
    """A part of a study, and the code that began it.

    Attributes:
        part: its name.
        kept: whether it was done before the command that wrote the document.
        date: when it was done.
        begun: when its march was begun.
        version: see `Code`.
        commit: see `Code`.
        libraries: see `Code`.
        numerics: see `Code`.
    """

    part: str
    kept: bool
    date: str | None
    begun: str | None
    version: str | None
    commit: str | None
    libraries: dict[str, str | None] | None
    numerics: dict[str, str] | None


@dataclasses.dataclass(frozen=True)
class Computed:
    """The parts of a study.

    Attributes:
        by: the code that wrote the document.
        parts: mesh, ramp, runs and derivatives.
    """

    by: Code
    parts: list[ComputedPart]


Numbers = list[float | None]


@dataclasses.dataclass(frozen=True)
class MotionPart:
    """Lumen and wall over a cycle; a number is None where a plane finds no lumen.

    Attributes:
        t_s: times of the frames from the start of the cycle.
        s_mm: distance of each plane from the ostium.
        area_image_mm2: area in the reference shape.
        minor_image_mm: minor axis there.
        area_mm2: area, by frame and plane.
        minor_mm: minor axis, by frame and plane.
        narrowest: index of the plane with the least area.
        narrowest_s_mm: where it lies.
        least_area_mm2: least area there.
        largest_area_mm2: largest area there.
        area_change: one less their ratio [-].
        von_mises_p99_kPa: 99th percentile of the stress of the wall around the planes.
    """

    t_s: list[float]
    s_mm: Numbers
    area_image_mm2: Numbers
    minor_image_mm: Numbers
    area_mm2: list[Numbers]
    minor_mm: list[Numbers]
    narrowest: int
    narrowest_s_mm: float
    least_area_mm2: float
    largest_area_mm2: float
    area_change: float
    von_mises_p99_kPa: list[float]


@dataclasses.dataclass(frozen=True)
class MeasuredLumen:
    """Lumen of a state as its contours give it.

    Attributes:
        s_mm: distance from the ostium.
        area_mm2: area of each contour.
        minor_mm: its minor axis.
    """

    s_mm: Numbers
    area_mm2: Numbers
    minor_mm: Numbers


@dataclasses.dataclass(frozen=True)
class Secant:
    """Resistance at a pressure drop.

    Attributes:
        secant: drop over flow [dyn·s/cm⁵].
        sd: its standard deviation [dyn·s/cm⁵].
    """

    secant: float
    sd: float


@dataclasses.dataclass(frozen=True)
class RampPower:
    """What takes the power of drop and flow in a ramp, see `jaxfsi.fields.viscous_loss`.

    The rest is the velocity head that leaves. Lists go by frame of the ramp.

    Attributes:
        viscous: resistance of the viscosity that the mesh resolves, at the last frame [dyn·s/cm⁵].
        viscous_defect: its mesh error, by recovery of the velocity's gradient [dyn·s/cm⁵].
        frame_drop_mmHg: drop.
        viscous_share: share of the power that resolved viscosity takes [-].
        defect_share: mesh error of that over the same power [-].
        unresolved_share: share that the scales below the mesh take, by the stabilisation [-].
    """

    viscous: float
    viscous_defect: float
    frame_drop_mmHg: list[float]
    viscous_share: list[float]
    defect_share: list[float]
    unresolved_share: list[float]


@dataclasses.dataclass(frozen=True)
class RampPart:
    """The ramp as documents hold it; the curve is ΔP = a Q + b Q|Q| + L dQ/dt.

    Attributes:
        P_image_mmHg: pressure at which the ramp starts.
        rate_mmHg_per_s: rate of the drop.
        largest_drop_mmHg: largest drop.
        a: of the curve [dyn·s/cm⁵].
        a_sd: its standard deviation.
        b: of the curve [dyn·s²/cm⁸].
        b_sd: its standard deviation.
        inertance: L of the curve [dyn·s²/cm⁵].
        rms_mmHg: root mean square of what the curve misses.
        n_effective: number of independent samples.
        tangent_40_mmHg: slope of the curve at 40 mmHg [dyn·s/cm⁵].
        tangent_40_mmHg_sd: its standard deviation.
        measured_slope_40_mmHg: slope of the ramp itself there [dyn·s/cm⁵].
        secants_by_drop_mmHg: resistance at some drops.
        Q_cm3_per_s: flow of some samples.
        drop_mmHg: drop of these.
        power: what takes its power; left out where no frames of the ramp were kept.
    """

    P_image_mmHg: float
    rate_mmHg_per_s: float
    largest_drop_mmHg: float
    a: float
    a_sd: float
    b: float
    b_sd: float
    inertance: float
    rms_mmHg: float
    n_effective: float
    tangent_40_mmHg: float
    tangent_40_mmHg_sd: float
    measured_slope_40_mmHg: float | None
    secants_by_drop_mmHg: dict[str, Secant]
    Q_cm3_per_s: list[float]
    drop_mmHg: list[float]
    power: RampPower | Absent = ABSENT


@dataclasses.dataclass(frozen=True)
class Band:
    """A number of a mesh, and where it lies without mesh error.

    Attributes:
        value: on the mesh.
        expected: without mesh error, with the usual order.
        low: least over the orders.
        high: largest over the orders.
    """

    value: float
    expected: float
    low: float
    high: float


@dataclasses.dataclass(frozen=True)
class MeshErrorPart:
    """Mesh error of a ramp from one on a second mesh, see `calibration.grid_convergence`.

    Attributes:
        elements_across: across the lumen, which 95 % of the blood's tetrahedra reach.
        second_elements_across: the same of the second mesh.
        second_tets: its tetrahedra.
        orders: least, usual and largest order of the error.
        tangent_40_mmHg: slope of the curve at 40 mmHg [dyn·s/cm⁵].
        alpha: scale of the anomalous outlet, tuned in 0D with each curve [-].
        rest_flow_ml_per_min: mean flow of the anomalous artery at rest with it.
        ffr: FFR with it, by condition under stress [-].
    """

    elements_across: float
    second_elements_across: float
    second_tets: int
    orders: list[float]
    tangent_40_mmHg: Band
    alpha: Band
    rest_flow_ml_per_min: Band
    ffr: dict[str, Band]


class Sensitivity(NamedTuple):
    """What moves the ratio of a run.

    Attributes:
        ratio: of the run, pressures read in every step [-].
        relative: ∂ log ratio / ∂ log parameter, by name [-].
        lumen: derivative of the ratio per shift outwards and area at each node of the lumen,
            smoothed [1/cm³].
        raw: the same without smoothing.
        seconds: that the sweep took [s].
    """

    ratio: float
    relative: dict[str, float]
    lumen: Float[np.ndarray, " nodes"]
    raw: Float[np.ndarray, " nodes"]
    seconds: float
