"""Tuning of models to a patient: resistances, the scale factor alpha, general fits, batch sweeps."""

from calibration.reduced_law import LumenLosses as LumenLosses
from calibration.reduced_law import PressureFlowLaw as PressureFlowLaw
from calibration.reduced_law import contraction_coefficient as contraction_coefficient
from calibration.reduced_law import lumen_law as lumen_law
from calibration.reduced_law import lumen_losses as lumen_losses
