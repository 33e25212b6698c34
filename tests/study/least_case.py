"""The least case that a run in 0D can use."""

LEAST_CASE = """\
[patient]
id = "{name}"
[condition.rest]
P_systolic_mmHg = 110.0
P_diastolic_mmHg = 65.0
period_s = 0.80
ffr = 0.93
[surrogate]
R0_dyn_s_per_cm5 = 5.0e3
"""
