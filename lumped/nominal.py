"""Nominal values of the coronary bed, without JAX: input files have them as defaults.

Source: Puelz et al. 2024 (after Arthurs et al. 2016).
"""

NOMINAL = {"R_1": 3.1992e4, "R_2": 6.3984e4, "R_3": 2.666e5, "C_a": 4.5e-7, "C_im": 3e-6}
"""Nominal coronary parameters of Puelz et al. 2024 (after Arthurs et al. 2016), CGS."""

C0_NOMINAL = 1e-7
"""Nominal compliance of the 3D part of the surrogate [cm⁵/dyn], Puelz et al. 2024."""
