"""Derivatives of a number of a run in 3D by reverse accumulation, and chain rules."""
