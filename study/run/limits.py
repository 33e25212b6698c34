"""Limits that results are held against, one place each."""

FFR_THRESHOLD = 0.80
"""FFR at or below which an obstruction is held to matter, as in the clinical cohorts [-]."""

FFR_GREY = 0.75
"""FFR from which on to `FFR_THRESHOLD` lies the grey zone; below, ischaemia was certain (Pijls et
al. 1996, N Engl J Med 334:1703; De Bruyne et al. 2012, N Engl J Med 367:991) [-]."""

IFR_THRESHOLD = 0.89
"""iFR at or below which an obstruction is held to matter (Götberg et al. 2017, N Engl J Med
376:1813; Davies et al. 2017, N Engl J Med 376:1824) [-]."""

REST_RATIO_THRESHOLD = 0.92
"""The same of the resting Pd/Pa; cohorts give 0.91 to 0.92 (Jeremias et al. 2014, J Am Coll Cardiol
63:1253) [-]."""

CATHETER_MM = 1.03
"""Diameter of the ultrasound catheter: no narrower lumen can be read from its images [mm]."""

AREA_BOUND = 0.03
"""Relative error of the lumen area of a mesh beyond which its report warns [-]."""

MOST_DRAWN = 8
"""Runs in 3D of a condition, with drawn numbers, that may be asked for."""

SEPTUM_BOUND = 0.10
"""The same of the thickness of the tissue between the lumens [-]."""
