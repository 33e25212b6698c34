"""Tuning of models to a patient: resistances, the scale factor alpha, fits, batch sweeps."""

from calibration.reduced_law import (
    LumenLosses,
    PressureFlowLaw,
    contraction_coefficient,
    lumen_law,
    lumen_losses,
)
from calibration.vascular import FreeParameters, VesselFit, calibrate_vessels
from calibration.vessel_record import (
    VesselParameters,
    VesselRecord,
    synthetic_record,
    vessel_residuals,
)
