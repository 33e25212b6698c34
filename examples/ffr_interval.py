"""
FFR with an error bar
=====================

Which causes it has, and which measurement would shrink it.
"""

# %% A patient whose alpha is tuned to the resting ratio, in every sample anew
import lumped
from calibration import LogNormal, Normal, StressRatio, uncertainty
from lumped import MMHG

rest = lumped.condition_from_clinic(120.0, 75.0, 0.86)
stress = lumped.condition_from_clinic(140.0, 70.0, 0.42)
artery = lumped.Surrogate(R0=680.0, K=940.0)
patient = StressRatio(artery, rest, stress, lumped.stress_rule("printed"), rest_ratio=0.91)

# %% What is known of its numbers; dilation is a common factor of the bed's resistances under stress
inputs = {
    "rest_ratio": Normal(0.91, 0.01),
    "dilation": LogNormal(1.0, 0.3),
    "im_factor": LogNormal(float(artery.coronary.im_factor), 0.2),
    "P_systolic": Normal(140.0 * MMHG, 5.0 * MMHG),
    "K": LogNormal(940.0, 0.3),
}
found = uncertainty(lambda x: patient.with_values(x)(), inputs, n_samples=2**7)

# %% The interval, its causes, and what would shrink it
low, high = found.interval()
print(f"FFR {found.nominal:.3f} [{low:.3f}, {high:.3f}]")
print(f"chance of 0.80 or below: {100.0 * found.chance(0.80):.0f} %")
for name, share in found.shares.items():
    low, high = found.known_better(name)
    print(f"{name:10} {100.0 * share:5.1f} % of the variance; known: [{low:.3f}, {high:.3f}]")
