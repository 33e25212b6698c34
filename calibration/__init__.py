"""Tuning of models to a patient: resistances, the scale factor alpha, fits, batch sweeps."""
