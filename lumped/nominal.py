"""Nominal values of the coronary bed, and how well a patient's numbers are usually known.

Without JAX: input files have them as defaults.

Source: Puelz et al. 2024 (after Arthurs et al. 2016); of the errors, `calibration.patient_inputs`.
"""

from lumped.units import MMHG

NOMINAL = {"R_1": 3.1992e4, "R_2": 6.3984e4, "R_3": 2.666e5, "C_a": 4.5e-7, "C_im": 3e-6}
"""Nominal coronary parameters of Puelz et al. 2024 (after Arthurs et al. 2016), CGS."""

C0_NOMINAL = 1e-7
"""Nominal compliance of the 3D part of the surrogate [cm⁵/dyn], Puelz et al. 2024."""

PRESSURE_SD = 3.0 * MMHG
"""Standard deviation of a measured aortic pressure [dyn/cm²]."""

PERIOD_SD = 0.02
"""That of a period, relative [-]."""

LOSS_SD = 0.3
"""That of the logarithm of a loss of the anomalous artery [-]."""

IM_FACTOR_SD = 0.3
"""That of the logarithm of the intramyocardial factor [-]."""

P_VENOUS_RANGE = (3.0 * MMHG, 12.0 * MMHG)
"""Least and largest venous pressure [dyn/cm²]."""

RESERVE_ERROR = 0.15
"""Relative standard deviation of a measured flow reserve where none is given: that of two readings
of one (coronary thermodilution against Doppler)."""
