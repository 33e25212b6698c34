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
    from calibration.bisection import bisect_alpha, ratio_after_cycles, ratio_of_periodic_state
    from calibration.fit import fit, fit_batch, stacked
    from calibration.free_parameter import FreeParameter
    from calibration.gauss_newton import DampedGaussNewton
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
    from calibration.spreads import AbstractSpread, LogNormal, Normal, Truncated, Uniform
    from calibration.stress_evidence import StressEvidence, stress_evidence
    from calibration.stress_ratio import BED_FACTOR, STRESS_LOSS, FormFactors, StressRatio
    from calibration.sweep import (
        Calibrations,
        Sweep,
        calibrate_many,
        grid,
        map_cases,
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

import_on_first_use(__name__)
