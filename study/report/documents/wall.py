"""The document of the command `calibrate-wall`, `wall.json`."""

import dataclasses

from study.report.documents.parts import Note
from study.store.provenance import Provenance


@dataclasses.dataclass(frozen=True)
class FittedStiffness:
    """One number that was fitted.

    Attributes:
        name: `aorta`, `coronary`, `septum` (Young's moduli), `support` or `thickness`.
        unit: of the numbers; empty where they have none.
        start: what the case gives.
        value: what explains the fitted states best.
        low: lower end of its interval of 95 %, widened by the misfit.
        high: upper end.
    """

    name: str
    unit: str
    start: float
    value: float
    low: float
    high: float


@dataclasses.dataclass(frozen=True)
class LumenNumbers:
    """A lumen along the distance from the ostium.

    Attributes:
        area_mm2: areas [mm²].
        minor_mm: minor axes [mm].
    """

    area_mm2: list[float]
    minor_mm: list[float]


@dataclasses.dataclass(frozen=True)
class LumenState:
    """A measured state beside the image.

    Attributes:
        fitted: whether the fit knew it.
        P_aorta_mmHg: pressure in the aorta [mmHg].
        P_distal_mmHg: pressure at the end of the course [mmHg].
        measured: its lumen.
        area_sd_mm2: standard deviation of the areas [mm²].
        minor_sd_mm: of the minor axes [mm].
        predicted: by model: `linear` elements, `literature` moduli of the case, `fitted`.
        change: mean change of the area from the image, as measured and by model [-].
        deviation: root mean square of what each model misses, in standard deviations [-];
            `rigid` is a lumen that does not move.
    """

    fitted: bool
    P_aorta_mmHg: float
    P_distal_mmHg: float
    measured: LumenNumbers
    area_sd_mm2: list[float]
    minor_sd_mm: list[float]
    predicted: dict[str, LumenNumbers]
    change: dict[str, float]
    deviation: dict[str, float]


@dataclasses.dataclass(frozen=True)
class WallDocument:
    """Stiffness of a wall, from the measured motion of its lumen.

    Attributes:
        format: name and version of the layout.
        kind: `wall`.
        patient: id of the patient.
        image: state whose shape the mesh has.
        P_image_mmHg: pressure in the aorta then [mmHg].
        s_mm: distances from the ostium [mm].
        image_lumen: measured lumen of the image there.
        stiffness: what was fitted.
        misfit: root of χ² over its degrees of freedom, at least 1 [-].
        evaluations: how often the motion was computed for the fit.
        determined: what the lumens say of each number beyond what was known beforehand.
        notes: how far the prediction falls short, and what may be the reason.
        states: measured and predicted lumens of the others.
        provenance: inputs, options, versions.
    """

    format: str
    kind: str
    patient: str
    image: str
    P_image_mmHg: float
    s_mm: list[float]
    image_lumen: LumenNumbers
    stiffness: list[FittedStiffness]
    misfit: float
    evaluations: int
    determined: list[str]
    notes: list[Note]
    states: dict[str, LumenState]
    provenance: Provenance
