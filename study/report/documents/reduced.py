"""The documents of the commands `run` and `calibrate`, `result.json` and `calibration.json`."""

import dataclasses

from study.report.documents.parts import AlphaCurve, BodyNumbers, Headline, Note
from study.report.documents.uncertainty import UncertainFFR
from study.store.json_form import ABSENT, Absent
from study.store.mesh_parts import MeshFailure, MeshPart
from study.store.provenance import Provenance

Derivatives = dict[str, float]


@dataclasses.dataclass(frozen=True, kw_only=True)
class ModelNumbers:
    """The surrogate of the patient under a law of the artery: ΔP = R0 Q + K Q|Q|.

    Attributes:
        R0: resistance [dyn·s/cm⁵].
        R0_mmHg_s_per_ml: the same in mmHg·s/mL.
        K: of the quadratic term [dyn·s²/cm⁸]; None under the linear law.
        K_mmHg_s2_per_ml2: the same in mmHg·s²/mL².
        C0: compliance of the artery [cm⁵/dyn].
        origin: where R0 and K come from, in words.
        R0_assumed: whether nothing is known of R0.
    """

    R0: float
    R0_mmHg_s_per_ml: float
    K: float | None
    K_mmHg_s2_per_ml2: float | None
    C0: float
    origin: str
    R0_assumed: bool | Absent = ABSENT


@dataclasses.dataclass(frozen=True)
class VesselShape:
    """Shape of the lumen along the artery, and where its pressure drop ΔP = a Q + b Q|Q| arises.

    Attributes:
        s_mm: distance of each contour from the ostium.
        area_mm2: its area.
        major_axis_mm: its major axis.
        minor_axis_mm: its minor axis.
        a_frames: part of a from each contour to the next [dyn·s/cm⁵].
        a_viscous: a, from friction [dyn·s/cm⁵].
        b_contraction: part of b from the contraction [dyn·s²/cm⁸].
        b_development: part of b from the growth of the profile [dyn·s²/cm⁸].
        b_expansion: part of b from the expansion [dyn·s²/cm⁸].
        b_head: part of b from the velocity head at the end [dyn·s²/cm⁸].
        s_narrowest_mm: distance of the least area from the ostium.
    """

    s_mm: list[float]
    area_mm2: list[float]
    major_axis_mm: list[float]
    minor_axis_mm: list[float]
    a_frames: list[float]
    a_viscous: float
    b_contraction: float
    b_development: float
    b_expansion: float
    b_head: float
    s_narrowest_mm: float


@dataclasses.dataclass(frozen=True)
class AorticWindkessel:
    """Three elements behind the aorta.

    Attributes:
        R_c: characteristic resistance [dyn·s/cm⁵].
        R_s: systemic resistance [dyn·s/cm⁵].
        C_s: systemic compliance [cm⁵/dyn].
    """

    R_c: float
    R_s: float
    C_s: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class ConditionNumbers:
    """A condition as the case gives it.

    Attributes:
        kind: `rest` or `stress`.
        P_systolic_mmHg: systolic aortic pressure.
        P_diastolic_mmHg: diastolic aortic pressure.
        period_s: length of a beat.
        measured_waveform: whether the aortic pressure is a measured beat.
        measured_rest_ratio: at rest, the measured ratio [-]; None where it was not measured.
        measured_ffr: the same under stress [-].
        measured_ifr: measured instantaneous wave-free ratio at rest [-].
        aortic_windkessel: where cardiac output and stroke volume are known, else None.
    """

    kind: str
    P_systolic_mmHg: float
    P_diastolic_mmHg: float
    period_s: float
    measured_waveform: bool
    measured_rest_ratio: float | Absent | None = ABSENT
    measured_ffr: float | Absent | None = ABSENT
    measured_ifr: float | Absent = ABSENT
    aortic_windkessel: AorticWindkessel | None


@dataclasses.dataclass(frozen=True)
class CoronaryOutlet:
    """Five elements behind the anomalous artery with α = 1.

    Attributes:
        R_1: arterial resistance [dyn·s/cm⁵].
        R_2: microvascular resistance [dyn·s/cm⁵].
        R_3: venous resistance [dyn·s/cm⁵].
        C_a: arterial compliance [cm⁵/dyn].
        C_im: intramyocardial compliance [cm⁵/dyn].
        P_venous_mmHg: venous pressure.
        im_factor: intramyocardial over ventricular pressure [-].
    """

    R_1: float
    R_2: float
    R_3: float
    C_a: float
    C_im: float
    P_venous_mmHg: float
    im_factor: float


@dataclasses.dataclass(frozen=True)
class AlphaNumbers:
    """α of a law, found in several ways.

    Attributes:
        alpha: scale of the resistances of the outlet, by Newton's method [-].
        alpha_95: its 95 % interval from the error of the measured ratio [-].
        log_alpha_by_log: ∂ log α / ∂ log parameter, the measured ratio kept, and for the measured
            ratio itself, `rest_ratio` [-].
        target: measured resting ratio [-].
        rest_ratio: resting ratio of the model with this α [-].
        newton_iterations: steps of Newton's method.
        closed_form: α of the divider [-]; None where the law is not linear.
        bisection: α by bisection [-]; None where it lies outside 1e-4 to 1e4.
        bisection_iterations: evaluations of the model that the bisection took.
    """

    alpha: float
    alpha_95: list[float]
    log_alpha_by_log: Derivatives
    target: float
    rest_ratio: float
    newton_iterations: int
    closed_form: float | None
    bisection: float | None
    bisection_iterations: int


@dataclasses.dataclass(frozen=True)
class AlphaFailure:
    """A law that could not be calibrated.

    Attributes:
        failure: why.
    """

    failure: str


@dataclasses.dataclass(frozen=True)
class RatioGapNumbers:
    """Predicted less measured ratio.

    Attributes:
        difference: their difference [-].
        z: the same in standard deviations of both [-].
        p: chance of as large a z by noise alone [-].
    """

    difference: float
    z: float
    p: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReducedRun:
    """A periodic state: a condition under a law, a stress rule and an outlet.

    Attributes:
        condition: name of the condition.
        law: `linear` or `quadratic`.
        rule: stress rule; None at rest.
        boundary: `fixed` (α = 1) or `calibrated`.
        alpha: scale of the resistances of the outlet [-].
        rest_ratio: at rest, mean distal over mean aortic pressure [-].
        rest_ratio_sd: its standard deviation from the error of the measured resting ratio [-].
        ffr: the same ratio under stress [-].
        ffr_sd: its standard deviation [-].
        ifr: instantaneous wave-free ratio [-].
        mean_P_aorta_mmHg: mean aortic pressure.
        mean_P_distal_mmHg: mean distal pressure.
        mean_flow_ml_per_min: mean coronary flow.
        systolic_share: share of the flow that passes in systole [-].
        floquet_multiplier: factor by which a disturbance shrinks in a cycle [-].
        error_estimate: of the periodic state, relative [-].
        gap: predicted less measured ratio; None without a measurement.
    """

    condition: str
    law: str
    rule: str | None
    boundary: str
    alpha: float
    rest_ratio: float | Absent = ABSENT
    rest_ratio_sd: float | Absent = ABSENT
    ffr: float | Absent = ABSENT
    ffr_sd: float | Absent = ABSENT
    ifr: float
    mean_P_aorta_mmHg: float
    mean_P_distal_mmHg: float
    mean_flow_ml_per_min: float
    systolic_share: float
    floquet_multiplier: float
    error_estimate: float
    gap: RatioGapNumbers | None


@dataclasses.dataclass(frozen=True)
class RunSensitivity:
    """Derivatives of the ratio of a run, ∂ log ratio / ∂ log parameter [-].

    Attributes:
        condition: name of the condition.
        law: `linear` or `quadratic`.
        rule: stress rule; None at rest.
        boundary: `calibrated`.
        at_fixed_alpha: with α held.
        recalibrated: with α tuned again at rest.
    """

    condition: str
    law: str
    rule: str | None
    boundary: str
    at_fixed_alpha: Derivatives
    recalibrated: Derivatives


@dataclasses.dataclass(frozen=True)
class PaperReading:
    """How an equation of the method paper is read.

    Attributes:
        topic: what it is about.
        reading: how it is read.
    """

    topic: str
    reading: str


@dataclasses.dataclass(frozen=True)
class RunWaveform:
    """Waves of a run over a beat.

    Attributes:
        condition: name of the condition.
        law: `linear` or `quadratic`.
        rule: stress rule; None at rest.
        boundary: `fixed` or `calibrated`.
        t_s: times.
        P_aorta_mmHg: aortic pressure.
        P_distal_mmHg: distal pressure.
        Q_ml_per_min: coronary flow.
    """

    condition: str
    law: str
    rule: str | None
    boundary: str
    t_s: list[float]
    P_aorta_mmHg: list[float]
    P_distal_mmHg: list[float]
    Q_ml_per_min: list[float]


@dataclasses.dataclass(frozen=True, kw_only=True)
class CalibrateDocument:
    """α of a patient at rest.

    Attributes:
        format: name and version of the layout.
        kind: `calibrate`.
        patient: id of the patient.
        law: the case's own law of the artery, `linear` or `quadratic`.
        rule: stress rule of the case.
        models: the surrogate by law, the case's own first.
        vessel: shape of the artery; None where the case has no contours.
        conditions: conditions of the case, rest first.
        coronary: the outlet with α = 1.
        sources: where the values of each table of the case come from.
        remarks: notes of the case, by table.
        calibrations: α by law, or why there is none.
        alpha: that of the case's own law [-].
        provenance: inputs, options, versions.
    """

    format: str
    kind: str
    patient: str
    law: str
    rule: str
    models: dict[str, ModelNumbers]
    vessel: VesselShape | None
    conditions: dict[str, ConditionNumbers]
    coronary: CoronaryOutlet
    sources: dict[str, str]
    remarks: dict[str, str]
    calibrations: dict[str, AlphaNumbers | AlphaFailure]
    alpha: float
    provenance: Provenance


@dataclasses.dataclass(frozen=True, kw_only=True)
class RunDocument:
    """A patient calibrated at rest, and every condition predicted under every reading.

    Attributes:
        format: name and version of the layout.
        kind: `run`.
        patient: id of the patient.
        law: the case's own law of the artery, `linear` or `quadratic`.
        rule: stress rule of the case.
        verdict: the result in a few sentences.
        headline: the numbers behind it.
        resistance_words: whether R0 matters to FFR; empty where it does.
        notes: what looks implausible or needs care.
        models: the surrogate by law, the case's own first.
        vessel: shape of the artery; None where the case has no contours.
        conditions: conditions of the case, rest first.
        coronary: the outlet with α = 1.
        sources: where the values of each table of the case come from.
        remarks: notes of the case, by table.
        calibrations: α by law, or why there is none.
        calibration_curves: resting ratio over α, by law.
        fixed_rest_ratio_error: resting ratio with α = 1 less the measured one [-].
        runs: every condition, law, rule and outlet.
        sensitivities: derivatives of the ratios of the calibrated runs.
        identifiability: what the measured resting ratio determines, in sentences.
        readings: how the equations of the method paper are read.
        provenance: inputs, options, versions.
        waveforms: waves of each run over a beat.
        mesh: a coarse mesh of the first state, or why it could not be made; None where it was not
            asked for.
        uncertainty: FFR of each condition under stress with an interval; absent without
            `--uncertainty`.
        body: the body of the patient and what was assumed from it; absent where it is not known.
    """

    format: str
    kind: str
    patient: str
    law: str
    rule: str
    verdict: str
    headline: Headline | Absent = ABSENT
    resistance_words: str | Absent = ABSENT
    notes: list[Note]
    models: dict[str, ModelNumbers]
    vessel: VesselShape | None
    conditions: dict[str, ConditionNumbers]
    coronary: CoronaryOutlet
    sources: dict[str, str]
    remarks: dict[str, str]
    calibrations: dict[str, AlphaNumbers | AlphaFailure]
    calibration_curves: dict[str, AlphaCurve]
    fixed_rest_ratio_error: float
    runs: list[ReducedRun]
    sensitivities: list[RunSensitivity]
    identifiability: list[str]
    readings: list[PaperReading]
    provenance: Provenance
    waveforms: list[RunWaveform]
    mesh: MeshPart | MeshFailure | Absent | None = ABSENT
    uncertainty: list[UncertainFFR] | Absent = ABSENT
    body: BodyNumbers | Absent = ABSENT
