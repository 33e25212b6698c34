"""Tuning of models to a patient: resistances, the scale factor alpha, general fits, sweeps."""

from calibration.vascular import FreeParameters as FreeParameters
from calibration.vascular import VesselFit as VesselFit
from calibration.vascular import calibrate_vessels as calibrate_vessels
from calibration.vessel_record import VesselParameters as VesselParameters
from calibration.vessel_record import VesselRecord as VesselRecord
from calibration.vessel_record import synthetic_record as synthetic_record
from calibration.vessel_record import vessel_residuals as vessel_residuals
