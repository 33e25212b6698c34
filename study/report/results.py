"""The documents of the commands `run` and `calibrate`.

Keys are named as in the code; a unit stands in the key where it is not CGS. The report, the text
summary and `jaxfsi show` are made from the document alone.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from lumped import ML_PER_MIN, MM, MMHG, MMHG_S_PER_ML, RCR
from study.report.body_words import body_part
from study.report.documents.parts import AlphaCurve
from study.report.documents.reduced import (
    AlphaFailure,
    AlphaNumbers,
    AorticWindkessel,
    CalibrateDocument,
    ConditionNumbers,
    CoronaryOutlet,
    ModelNumbers,
    PaperReading,
    RatioGapNumbers,
    ReducedRun,
    RunDocument,
    RunSensitivity,
    RunWaveform,
    VesselShape,
)
from study.report.headline import headline_numbers
from study.report.readings import READINGS
from study.report.remarks import (
    fixed_error,
    identifiability,
    notes,
    resistance_words,
    stress_readings,
    verdict,
)
from study.report.uncertainty_part import uncertainty_parts
from study.run.patient import ContouredArtery, Patient
from study.run.reduced_results import Calibration, CaseResult, Run, Tuning
from study.store.document_rows import ratio_name
from study.store.json_form import ABSENT
from study.store.layouts import FORMAT
from study.store.mesh_parts import MeshFailure, MeshPart
from study.store.provenance import Provenance
from study.store.result_names import CALIBRATED


def case_document(
    result: CaseResult, provenance: Provenance, mesh: MeshPart | MeshFailure | None = None
) -> RunDocument:
    """The document of a run of the pipeline.

    Args:
        result: what it found.
        provenance: where the result comes from.
        mesh: a mesh beside it, or why it could not be made.
    """
    patient = result.patient
    return RunDocument(
        **_head(patient),
        kind="run",
        verdict=verdict(result),
        headline=headline_numbers(stress_readings(result)),
        resistance_words=resistance_words(result),
        notes=notes(result),
        **_patient_part(patient),
        calibrations=_calibrations(result.calibrations, result.failures),
        calibration_curves={
            law: AlphaCurve(_list(curve.alpha), _list(curve.ratio))
            for law, curve in result.curves.items()
        },
        fixed_rest_ratio_error=fixed_error(result),
        runs=[_numbers(run) for run in result.runs],
        sensitivities=[_sensitivity(run) for run in result.runs if run.boundary == CALIBRATED],
        identifiability=identifiability(result),
        readings=[PaperReading(topic, text) for topic, text in READINGS],
        provenance=provenance,
        waveforms=[_waveform(run) for run in result.runs],
        mesh=mesh,
        uncertainty=(
            ABSENT
            if result.uncertainty is None
            else uncertainty_parts(result.uncertainty.found, patient.case.surrogate.law)
        ),
        body=body_part(patient.case),
    )


def calibration_document(
    patient: Patient, tuning: Tuning, provenance: Provenance
) -> CalibrateDocument:
    """The document of a calibration alone."""
    return CalibrateDocument(
        **_head(patient),
        kind="calibrate",
        **_patient_part(patient),
        calibrations=_calibrations(*tuning),
        alpha=tuning.calibrations[patient.case.surrogate.law].alpha,
        provenance=provenance,
    )


def _head(patient: Patient) -> dict[str, Any]:
    """What documents of a patient begin with, by field."""
    case = patient.case
    law, rule = case.surrogate.law, case.stress.rule
    return {"format": FORMAT, "patient": case.id, "law": law, "rule": rule}


def _patient_part(patient: Patient) -> dict[str, Any]:
    """The patient as the case gives it, by field."""
    coronary = patient.model.surrogate.coronary
    return {
        "models": {law: _model(patient, law) for law in patient.models},
        "vessel": None if patient.vessel is None else vessel_part(patient.vessel),
        "conditions": {name: _condition(patient, name) for name in patient.conditions},
        "coronary": CoronaryOutlet(
            R_1=float(coronary.R_1),
            R_2=float(coronary.R_2),
            R_3=float(coronary.R_3),
            C_a=float(coronary.C_a),
            C_im=float(coronary.C_im),
            P_venous_mmHg=float(coronary.P_venous) / MMHG,
            im_factor=float(coronary.im_factor),
        ),
        "sources": patient.case.source,
        "remarks": patient.case.notes,
    }


def _model(patient: Patient, law: str) -> ModelNumbers:
    model = patient.models[law]
    surrogate = model.surrogate
    return ModelNumbers(
        R0=float(surrogate.R0),
        R0_mmHg_s_per_ml=float(surrogate.R0) / MMHG_S_PER_ML,
        K=None if surrogate.K is None else float(surrogate.K),
        K_mmHg_s2_per_ml2=None if surrogate.K is None else float(surrogate.K) / MMHG,
        C0=float(surrogate.C0),
        origin=model.origin,
        R0_assumed=model.assumed,
    )


def vessel_part(vessel: ContouredArtery) -> VesselShape:
    """Shape of the lumen along the vessel, and where its resistance sits."""
    lumen, losses = vessel.lumen, vessel.losses
    return VesselShape(
        s_mm=_list(lumen.s / MM),
        area_mm2=_list(vessel.area / MM**2),
        major_axis_mm=_list(vessel.calipers.major / MM),
        minor_axis_mm=_list(vessel.calipers.minor / MM),
        a_frames=_list(losses.a_frames),
        a_viscous=float(losses.a_viscous),
        b_contraction=float(losses.b_contraction),
        b_development=float(losses.b_development),
        b_expansion=float(losses.b_expansion),
        b_head=float(losses.b_head),
        s_narrowest_mm=float(losses.s_narrowest) / MM,
    )


def _condition(patient: Patient, name: str) -> ConditionNumbers:
    entry = patient.case.conditions[name]
    windkessel = patient.windkessels.get(name)
    return ConditionNumbers(
        kind=entry.kind,
        P_systolic_mmHg=entry.P_systolic / MMHG,
        P_diastolic_mmHg=entry.P_diastolic / MMHG,
        period_s=entry.period,
        measured_waveform=entry.waveform is not None,
        measured_rest_ratio=entry.ffr if name == "rest" else ABSENT,
        measured_ffr=ABSENT if name == "rest" else entry.ffr,
        measured_ifr=ABSENT if entry.ifr is None else entry.ifr,
        aortic_windkessel=None if windkessel is None else _windkessel(windkessel),
    )


def _windkessel(block: RCR) -> AorticWindkessel:
    return AorticWindkessel(float(block.R_proximal), float(block.R_distal), float(block.C))


def _calibrations(
    calibrations: Mapping[str, Calibration], failures: Mapping[str, str]
) -> dict[str, AlphaNumbers | AlphaFailure]:
    found: dict[str, AlphaNumbers | AlphaFailure] = {
        law: AlphaNumbers(
            alpha=fit.alpha,
            alpha_95=[fit.alpha * math.exp(sign * 1.96 * fit.sd_log) for sign in (-1.0, 1.0)],
            log_alpha_by_log=fit.by,
            target=fit.target,
            rest_ratio=fit.ratio,
            newton_iterations=fit.iterations,
            closed_form=fit.closed_form,
            bisection=fit.bisection,
            bisection_iterations=fit.bisection_iterations,
        )
        for law, fit in calibrations.items()
    }
    return found | {law: AlphaFailure(why) for law, why in failures.items()}


def _setting(run: Run) -> dict[str, Any]:
    """Which run, by field."""
    return {
        "condition": run.condition,
        "law": run.law,
        "rule": run.rule,
        "boundary": run.boundary,
    }


def _numbers(run: Run) -> ReducedRun:
    gap, name = run.gap, ratio_name(run.condition)
    ratio: dict[str, Any] = {name: run.ratio, f"{name}_sd": run.ratio_sd}
    return ReducedRun(
        **_setting(run),
        alpha=run.alpha,
        **ratio,
        ifr=run.ifr,
        mean_P_aorta_mmHg=run.mean_P_aorta / MMHG,
        mean_P_distal_mmHg=run.mean_P_distal / MMHG,
        mean_flow_ml_per_min=run.flow_ml_per_min,
        systolic_share=run.systolic_share,
        floquet_multiplier=run.floquet_multiplier,
        error_estimate=run.error_estimate,
        gap=None
        if gap is None
        else RatioGapNumbers(float(gap.difference), float(gap.z), float(gap.p_value)),
    )


def _sensitivity(run: Run) -> RunSensitivity:
    return RunSensitivity(
        **_setting(run),
        at_fixed_alpha=run.at_fixed_alpha,
        recalibrated=run.recalibrated,
    )


def _waveform(run: Run) -> RunWaveform:
    return RunWaveform(
        **_setting(run),
        t_s=_list(run.t),
        P_aorta_mmHg=_list(run.P_aorta / MMHG),
        P_distal_mmHg=_list(run.P_distal / MMHG),
        Q_ml_per_min=_list(run.Q / ML_PER_MIN),
    )


def _list(values: Any) -> list[float]:
    """Numbers with seven digits: a waveform is no better, and the file half as long."""
    return [float(f"{value:.7g}") for value in np.asarray(values).tolist()]
