"""The document of the command `study`, `study.json`."""

import dataclasses
from typing import Any

from study.report.documents.parts import AlphaCurve, BodyNumbers, Headline, Note
from study.report.documents.uncertainty import UncertainFFR
from study.run.results import Run3D
from study.run.study_parts import (
    Computed,
    MeasuredLumen,
    MeshErrorPart,
    MotionPart,
    RampPart,
)
from study.store.json_form import ABSENT, Absent, under
from study.store.provenance import Provenance

Derivatives = dict[str, float]


@dataclasses.dataclass(frozen=True)
class AlphaEntry:
    """A run at rest and where its α comes from.

    Attributes:
        run: id of the run.
        label: what its α comes from.
        origin: the same in words.
        alpha: scale of the resistances of the anomalous outlet [-].
        rest_ratio: resting ratio in 3D [-].
        error: its difference to the measured one [-].
        best: whether it is the calibrated one.
        drift_mmHg: largest change of a state of the anomalous bed over the run.
    """

    run: str
    label: str
    origin: str
    alpha: float
    rest_ratio: float | None
    error: float | None
    best: bool
    drift_mmHg: float | None


@dataclasses.dataclass(frozen=True)
class LoopTrial:
    """A run of the calibration in the loop.

    Attributes:
        alpha: scale factor [-].
        ratio: resting ratio [-].
    """

    alpha: float
    ratio: float


@dataclasses.dataclass(frozen=True)
class Loop:
    """The calibration with the 3D model in the loop.

    Attributes:
        run: id of the run that it chose.
        alpha: its scale factor [-].
        rest_ratio: its resting ratio [-].
        reached: whether that is within the tolerance of the measured one.
        extra_runs: runs beyond the first.
        trials: all its runs, in order.
    """

    run: str
    alpha: float
    rest_ratio: float
    reached: bool
    extra_runs: int
    trials: list[LoopTrial]


@dataclasses.dataclass(frozen=True)
class RatioRow:
    """Ratios of a condition under a stress rule side by side [-].

    Attributes:
        condition: name of the condition.
        rule: stress rule; None at rest.
        measured: measured ratio.
        linear_0d: linear surrogate with its α.
        curve_0d: surrogate with the curve of the ramp and its α.
        curve_0d_nominal: the same with α = 1.
        fsi: 3D with α as calibrated in 3D.
        fsi_sd: its standard deviation.
        fsi_nominal: 3D with α = 1.
        flow_ml_per_min: mean flow of the anomalous artery in 3D.
        ifr: instantaneous wave-free ratio in 3D, at rest.
        measured_ifr: measured one.
    """

    condition: str
    rule: str | None
    measured: float | None
    linear_0d: float | None
    curve_0d: float | None
    curve_0d_nominal: float | None
    fsi: float | None
    fsi_sd: float | None
    fsi_nominal: float | None
    flow_ml_per_min: float | None
    ifr: float | Absent | None = ABSENT
    measured_ifr: float | Absent = ABSENT


@dataclasses.dataclass(frozen=True)
class ReducedSensitivity:
    """Derivatives of FFR in 0D, ∂ log FFR / ∂ log parameter [-].

    Attributes:
        condition: name of the condition.
        rule: stress rule.
        ffr: FFR [-].
        at_fixed_alpha: with α held.
        recalibrated: with α tuned again at rest.
    """

    condition: str
    rule: str | None
    ffr: float
    at_fixed_alpha: Derivatives
    recalibrated: Derivatives


@dataclasses.dataclass(frozen=True)
class LumenPieces:
    """Change of a ratio in 3D where the lumen is wider by 0.1 mm on all sides [-].

    Attributes:
        edges_mm: ends of the pieces, distances from the ostium.
        wider: for each piece.
        whole_wider: for the whole artery.
    """

    edges_mm: list[float]
    wider: list[float] = dataclasses.field(metadata=under("wider_0.1_mm"))
    whole_wider: float = dataclasses.field(metadata=under("whole_wider_0.1_mm"))


@dataclasses.dataclass(frozen=True)
class Sensitivity3D:
    """Derivatives of a ratio in 3D, ∂ log ratio / ∂ log parameter [-].

    Attributes:
        run: id of the run.
        condition: name of the condition.
        rule: stress rule; None at rest.
        ratio: pressures read in every step [-].
        at_fixed_alpha: with α held.
        recalibrated: with α tuned again at rest; None where rest was not differentiated.
        seconds: that the derivatives took.
        lumen: what a wider lumen does; None where the anatomy has no axis of the artery.
    """

    run: str
    condition: str
    rule: str | None
    ratio: float
    at_fixed_alpha: Derivatives
    recalibrated: Derivatives | None
    seconds: float
    lumen: LumenPieces | None


@dataclasses.dataclass(frozen=True)
class StudyMesh:
    """Size of the mesh.

    Attributes:
        nodes: number of nodes.
        tets: number of tetrahedra.
        preset: size that was asked for.
    """

    nodes: int
    tets: int
    preset: str


@dataclasses.dataclass(frozen=True)
class StudyWall:
    """The wall.

    Attributes:
        E_dyn_per_cm2: Young's modulus.
        nu: Poisson's ratio [-].
        material: elastic law.
    """

    E_dyn_per_cm2: float
    nu: float
    material: str


@dataclasses.dataclass(frozen=True)
class StudyDocument:
    """All numbers of Algorithm 1 in 3D for one patient.

    Attributes:
        format: name and version of the layout.
        kind: `study`.
        patient: id of the patient.
        rule: stress rule of the case.
        verdict: the result in a few sentences.
        headline: the numbers behind it.
        notes: what looks implausible or needs care.
        rest_ratio_measured: measured resting ratio [-].
        ramp: the ramp and its curve.
        calibrations: runs at rest side by side.
        loop: the calibration in 3D.
        curves: resting ratio over α in 0D, by law.
        rows: ratios by condition and rule.
        runs: the 3D runs.
        shown: ids of those with α as calibrated, rest first.
        motion: lumen and wall over a cycle, by id of the run.
        measured_states: lumen as measured, by state.
        sensitivities: derivatives of FFR in 0D.
        fsi_sensitivities: derivatives of ratios in 3D.
        mesh: size of the mesh.
        wall: the wall.
        pictures: names of the pictures, by id of the run.
        picture_times_s: instants that they show, by id of the run.
        picture_notes: why there are none.
        films: ids of runs with an animation.
        computed: when each part was computed, and by which code.
        numerics: what decides the numbers, see `study.store.numerics`.
        provenance: inputs, options, versions.
        mesh_error: what a second mesh says of the ramp; absent without `--mesh-error`.
        uncertainty: FFR in 3D of each condition under stress with an interval; absent without
            `--uncertainty`.
        body: the body of the patient and what was assumed from it; absent where it is not known.
    """

    format: str
    kind: str
    patient: str
    rule: str
    verdict: str
    headline: Headline
    notes: list[Note]
    rest_ratio_measured: float | None
    ramp: RampPart
    calibrations: list[AlphaEntry]
    loop: Loop
    curves: dict[str, AlphaCurve]
    rows: list[RatioRow]
    runs: list[Run3D]
    shown: list[str]
    motion: dict[str, MotionPart]
    measured_states: dict[str, MeasuredLumen]
    sensitivities: list[ReducedSensitivity]
    fsi_sensitivities: list[Sensitivity3D]
    mesh: StudyMesh
    wall: StudyWall
    pictures: dict[str, list[str]]
    picture_times_s: dict[str, list[float]]
    picture_notes: list[str]
    films: list[str]
    computed: Computed
    numerics: dict[str, Any]
    provenance: Provenance
    mesh_error: MeshErrorPart | Absent = ABSENT
    uncertainty: list[UncertainFFR] | Absent = ABSENT
    body: BodyNumbers | Absent = ABSENT
