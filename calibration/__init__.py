"""Tuning of models to a patient: resistances, the scale factor alpha, fits, batch sweeps."""

from typing import TYPE_CHECKING

from lumped.lazy_package import import_on_first_use

if TYPE_CHECKING:
    from calibration.alpha import (
        AlphaFit,
        alpha_closed_form,
        alpha_sensitivities,
        calibrate_alpha,
        mean_aortic_pressure,
        require_feasible,
        with_alpha,
    )
    from calibration.aortic_root import aortic_root_diameter
    from calibration.bisection import bisect_alpha, ratio_after_cycles, ratio_of_periodic_state
    from calibration.body import (
        Body,
        body_surface_area,
        coronary_flow,
        left_ventricular_mass,
        right_share,
        territory_flow,
    )
    from calibration.body_bed import bed_flow, bed_for_flow
    from calibration.body_priors import PRIORS, Prior, body_priors
    from calibration.cases import map_cases
    from calibration.fit import fit, fit_batch, stacked
    from calibration.free_parameter import FreeParameter
    from calibration.gauss_newton import DampedGaussNewton
    from calibration.grid_convergence import (
        MeshBand,
        ThreeMeshes,
        extrapolated,
        mesh_band,
        three_meshes,
    )
    from calibration.growth_charts import (
        height_at,
        height_score,
        modified_height_score,
        modified_weight_score,
        weight_at,
        weight_score,
    )
    from calibration.identifiability import (
        Identifiability,
        RatioIdentifiability,
        identifiability,
        ratio_identifiability,
    )
    from calibration.in_loop import (
        MOST_EXTRA_RUNS,
        RATIO_TOLERANCE,
        LoopFit,
        Trial,
        calibrate_in_loop,
        next_alpha,
        surrogate_ratio,
    )
    from calibration.interval import Uncertainty
    from calibration.lumen_record import LumenChange, LumenProfile, lumen_change, lumen_profile
    from calibration.optimum import Fit
    from calibration.outlets import network_start
    from calibration.patient_inputs import MeasurementErrors, patient_inputs
    from calibration.profile import Profile, profile
    from calibration.ramp import PAPER_DROP, RampFit, RampRecord, fit_ramp, measured_slope
    from calibration.reduced_law import (
        LumenLosses,
        PressureFlowLaw,
        contraction_coefficient,
        lumen_law,
        lumen_losses,
    )
    from calibration.reweighting import Evidence
    from calibration.sensitivity import (
        REST_RULE,
        RatioResponse,
        alpha_response,
        ratio_response,
        through_calibration,
    )
    from calibration.spreads import (
        AbstractSpread,
        LogNormal,
        Normal,
        Truncated,
        Uniform,
        central_range,
    )
    from calibration.stress_evidence import StressEvidence, stress_evidence
    from calibration.stress_ratio import FormFactors, StressRatio
    from calibration.sweep import (
        Calibrations,
        Sweep,
        calibrate_many,
        grid,
        simulate_many,
        sweep_alpha,
    )
    from calibration.systemic import characteristic_impedance, systemic_windkessel
    from calibration.targets import (
        Experiment,
        NetworkExperiment,
        Target,
        diastolic_target,
        mean_flow_target,
        mean_pressure_target,
        ratio_target,
        systolic_target,
        waveform_target,
    )
    from calibration.two_levels import Correction, Runs, correction
    from calibration.uncertain_names import BED_FACTOR, STRESS_LOSS
    from calibration.uncertainty import (
        evaluate,
        interval_bounds,
        standard_normals,
        uncertainty,
    )
    from calibration.vascular import FreeParameters, VesselFit, calibrate_vessels
    from calibration.vessel_record import (
        VesselParameters,
        VesselRecord,
        synthetic_record,
        vessel_residuals,
    )

__all__ = [
    "BED_FACTOR",
    "MOST_EXTRA_RUNS",
    "PAPER_DROP",
    "PRIORS",
    "RATIO_TOLERANCE",
    "REST_RULE",
    "STRESS_LOSS",
    "AbstractSpread",
    "AlphaFit",
    "Body",
    "Calibrations",
    "Correction",
    "DampedGaussNewton",
    "Evidence",
    "Experiment",
    "Fit",
    "FormFactors",
    "FreeParameter",
    "FreeParameters",
    "Identifiability",
    "LogNormal",
    "LoopFit",
    "LumenChange",
    "LumenLosses",
    "LumenProfile",
    "MeasurementErrors",
    "MeshBand",
    "NetworkExperiment",
    "Normal",
    "PressureFlowLaw",
    "Prior",
    "Profile",
    "RampFit",
    "RampRecord",
    "RatioIdentifiability",
    "RatioResponse",
    "Runs",
    "StressEvidence",
    "StressRatio",
    "Sweep",
    "Target",
    "ThreeMeshes",
    "Trial",
    "Truncated",
    "Uncertainty",
    "Uniform",
    "VesselFit",
    "VesselParameters",
    "VesselRecord",
    "alpha_closed_form",
    "alpha_response",
    "alpha_sensitivities",
    "aortic_root_diameter",
    "bed_flow",
    "bed_for_flow",
    "bisect_alpha",
    "body_priors",
    "body_surface_area",
    "calibrate_alpha",
    "calibrate_in_loop",
    "calibrate_many",
    "calibrate_vessels",
    "central_range",
    "characteristic_impedance",
    "contraction_coefficient",
    "coronary_flow",
    "correction",
    "diastolic_target",
    "evaluate",
    "extrapolated",
    "fit",
    "fit_batch",
    "fit_ramp",
    "grid",
    "height_at",
    "height_score",
    "identifiability",
    "interval_bounds",
    "left_ventricular_mass",
    "lumen_change",
    "lumen_law",
    "lumen_losses",
    "lumen_profile",
    "map_cases",
    "mean_aortic_pressure",
    "mean_flow_target",
    "mean_pressure_target",
    "measured_slope",
    "mesh_band",
    "modified_height_score",
    "modified_weight_score",
    "network_start",
    "next_alpha",
    "patient_inputs",
    "profile",
    "ratio_after_cycles",
    "ratio_identifiability",
    "ratio_of_periodic_state",
    "ratio_response",
    "ratio_target",
    "require_feasible",
    "right_share",
    "simulate_many",
    "stacked",
    "standard_normals",
    "stress_evidence",
    "surrogate_ratio",
    "sweep_alpha",
    "synthetic_record",
    "systemic_windkessel",
    "systolic_target",
    "territory_flow",
    "three_meshes",
    "through_calibration",
    "uncertainty",
    "vessel_residuals",
    "waveform_target",
    "weight_at",
    "weight_score",
    "with_alpha",
]

import_on_first_use(__name__)
