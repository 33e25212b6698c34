"""Resolution of a beat in the diagnosis, without JAX: records are folded to it."""

SAMPLES = 256
"""Samples of a beat; they resolve the kept harmonics of the ventricle's steep pressure."""

HARMONICS = 40
"""Harmonics kept, besides the mean."""
