"""
First report
============

One real patient in 0D, from the case file to FFR under stress. The lumen of this anomalous right
coronary artery was measured by intravascular ultrasound; its pressures are typical adult values, as
the case file says line by line.

On the command line the same is::

    jaxfsi run --demo --out results        # report.html and result.json
    jaxfsi study --demo --quick            # the whole algorithm in 3D, as `make demo`
"""

# %%
# A case
# ------
# A case file holds what is known of a patient. Reading it checks every key, its unit and its range,
# and converts to CGS units.
import matplotlib.pyplot as plt

import study
from lumped import ML_PER_MIN, MMHG

case = study.read_case(study.demo_case_path())
rest = case.conditions["rest"]
print(f"{case.id}: {rest.P_systolic / MMHG:.0f} over {rest.P_diastolic / MMHG:.0f} mmHg,")
print(f"{60.0 / rest.period:.0f} beats/min, resting Pd/Pa {rest.ffr}")

# %%
# The pipeline
# ------------
# `run_case` computes the losses of the lumen from its contours, calibrates the scale factor α of
# the coronary bed to the resting ratio, and predicts every condition of the case. The law of the
# artery is linear, as in the paper, or quadratic; its stress rule is read in two ways.
result = study.run_case(case)
for law, fit in result.calibrations.items():
    print(f"{law:10s} alpha = {fit.alpha:.4f}, resting ratio {fit.ratio:.4f}")

# %%
# Ratios
# ------
# At rest the calibrated ratio is the measured one. Under stress it is FFR.
calibrated = [run for run in result.runs if run.boundary == "calibrated"]
for run in calibrated:
    print(f"{run.condition:11s} {run.law:10s} rule {run.rule or '-':8s} ratio {run.ratio:.3f}")

# %%
# Waveforms
# ---------
# Coronary flow comes mostly in diastole: in systole the heart muscle squeezes its own vessels.
fig, axes = plt.subplots(1, 2, figsize=(9.0, 3.2), sharex=True)
for run in calibrated[:2]:
    name = run.condition if run.rule is None else f"{run.condition}, rule {run.rule}"
    axes[0].plot(run.t / run.t[-1], run.P_distal / MMHG, label=name)
    axes[1].plot(run.t / run.t[-1], run.Q / ML_PER_MIN, label=name)
axes[0].set(xlabel="time [cycles]", ylabel="distal pressure [mmHg]")
axes[1].set(xlabel="time [cycles]", ylabel="coronary flow [mL/min]")
axes[0].legend()
fig.tight_layout()

# %%
# Next: give the patient's own numbers with ``jaxfsi template > case.toml``; every key is explained
# in the reference of case files. ``--uncertainty`` gives each FFR an interval.
