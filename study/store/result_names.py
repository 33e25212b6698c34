"""What results call their outlets and where the α of a run comes from."""

FIXED, CALIBRATED = "fixed", "calibrated"
"""Outlets of a run: nominal, or with α as tuned."""

FIXED_0D = "fixed, 0D"
"""In a cohort: the nominal outlet behind the curve of the ramp in 0D."""

RAMP = "ramp"
"""The run whose slope gives R0, and its stage."""

PAPER, CURVE, LOOP, NOMINAL = "paper", "curve", "loop", "nominal"
DRAWN = "drawn"
"""What the α of a run in 3D comes from: the linear surrogate, the quadratic one, the correction in
3D, or nothing (α = 1, the paper's fixed boundary condition)."""
