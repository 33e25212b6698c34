"""What parameters and causes are called on pages."""

NAMES = {
    "rest_ratio": "measured resting ratio",
    "R0": "artery, R0",
    "K": "artery, quadratic loss K",
    "alpha": "alpha",
    "stress_R_1": "stress factor of R_1",
    "stress_R_2": "stress factor of R_2",
    "stress_R_3": "stress factor of R_3",
    "stress_C_a": "stress factor of C_a",
    "stress_C_im": "stress factor of C_im",
    "R_1": "outlet R_1 (proximal)",
    "R_2": "outlet R_2 (microvascular)",
    "R_3": "outlet R_3 (venous)",
    "P_systolic": "systolic pressure under stress",
    "P_diastolic": "diastolic pressure under stress",
    "period": "cycle length under stress",
    "periodic states": "0D by means alone",
    "runs in 3D": "0D for 3D",
    "rest_P_systolic": "systolic pressure at rest",
    "rest_P_diastolic": "diastolic pressure at rest",
    "rest_period": "cycle length at rest",
    "P_venous": "venous pressure",
    "im_factor": "intramyocardial factor",
    "bed_factor": "dilation of the bed under stress",
    "stress_loss": "narrowing of the artery under stress",
}
"""By the name that documents have."""
