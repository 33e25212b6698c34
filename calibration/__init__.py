"""Tuning of models to a patient: resistances, the scale factor alpha, fits, batch sweeps."""

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
from calibration.reduced_law import (
    LumenLosses,
    PressureFlowLaw,
    contraction_coefficient,
    lumen_law,
    lumen_losses,
)
from calibration.sensitivity import (
    REST_RULE,
    RatioResponse,
    alpha_response,
    ratio_response,
    through_calibration,
)
from calibration.sweep import (
    Calibrations,
    Sweep,
    calibrate_many,
    grid,
    map_cases,
    simulate_many,
    sweep_alpha,
)
from calibration.systemic import systemic_windkessel
from calibration.vascular import FreeParameters, VesselFit, calibrate_vessels
from calibration.vessel_record import (
    VesselParameters,
    VesselRecord,
    synthetic_record,
    vessel_residuals,
)
