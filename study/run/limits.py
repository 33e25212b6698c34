"""Limits that results are held against, one place each."""

FFR_THRESHOLD = 0.80
"""FFR at or below which an obstruction is held to matter, as in the clinical cohorts [-]."""

CATHETER_MM = 1.03
"""Diameter of the ultrasound catheter: no narrower lumen can be read from its images [mm]."""

AREA_BOUND = 0.03
"""Relative error of the lumen area of a mesh beyond which its report warns [-]."""

MOST_DRAWN = 8
"""Runs in 3D of a condition, with drawn numbers, that may be asked for."""

SEPTUM_BOUND = 0.10
"""The same of the thickness of the tissue between the lumens [-]."""
