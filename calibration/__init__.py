"""Tuning of models to a patient: resistances, the scale factor alpha, fits, batch sweeps."""

from calibration.reduced_law import (
    LumenLosses,
    PressureFlowLaw,
    contraction_coefficient,
    lumen_law,
    lumen_losses,
)
