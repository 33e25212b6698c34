"""Tuning of models to a patient: resistances, the scale factor alpha, general fits, batch sweeps."""
