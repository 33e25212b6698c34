"""
Diagnose a record
=================

Simulation and measurement differ: why? Here the answer is known. A patient is simulated whose
ostium loses pressure with the square of the flow, which the calibrated model leaves out; noise is
added; and the diagnosis is asked for the cause.

On the command line: ``jaxfsi diagnose record/`` with a folder as ``jaxfsi template --record``
makes it.
"""

# %%
# A record
# --------
# Rest and two drugs, twelve beats of pressure with 1 mmHg of noise each, and the mean flow. How
# noisy the mean beat is follows from the scatter of the beats.
import matplotlib.pyplot as plt
import numpy as np

import diagnosis
import lumped
from lumped import MMHG

R0, K = 3.75 * MMHG, 6.0 * MMHG  # mmHg·s/mL and mmHg·s²/mL² in CGS
patient = lumped.Surrogate(R0=R0, K=K, alpha=0.25)
beats = {
    "rest": ("none", 110.0, 65.0, 0.8),
    "adenosine": ("adenosine", 105.0, 60.0, 0.7),
    "dobutamine": ("dobutamine", 130.0, 70.0, 0.45),
}
rng = np.random.default_rng(2)
conditions = []
for order, (name, (drug, systolic, diastolic, period)) in enumerate(beats.items()):
    condition = lumped.condition_from_clinic(systolic, diastolic, period)
    rule = None if drug == "none" else lumped.stress_rule("printed")
    state = lumped.solve_periodic(patient.network(condition, rule=rule), period)
    t = np.linspace(0.0, period, 128, endpoint=False)
    pressures = {
        f"P_{node}": np.interp(t, state.t, state.pressure(node), period=period)[None]
        + 1.0 * MMHG * rng.standard_normal((12, t.size))
        for node in ("aorta", "distal")
    }
    conditions.append(
        diagnosis.RecordedCondition(
            name, drug, order, False, period, systolic * MMHG, diastolic * MMHG,
            mean_Q=float(state.mean_flow("coronary")), beats=pressures,
        )
    )  # fmt: skip
record = diagnosis.Record("tutorial", tuple(conditions), R0=R0, R0_sd_log=0.15)
noise = diagnosis.noise_of(record)
print(f"noise of the mean beat: {noise.pressure_sd / MMHG:.2f} mmHg, {noise.origin}")

# %%
# The verdict
# -----------
# All effects of the catalogue are fitted and compared by their evidence, with "no gap", pairs, and
# a free waveform that stands for causes outside the catalogue.
(found,) = diagnosis.diagnose(diagnosis.stacked([diagnosis.measured(record)]))
judgement = found.judgement
print(f"verdict: {judgement.verdict}, {', '.join(judgement.named)}")
likely = sorted(judgement.probabilities.items(), key=lambda pair: -pair[1])[:4]
for name, probability in likely:
    print(f"  {name:40s} {probability:.3f}")

# %%
names, shares = zip(*reversed(likely), strict=True)
fig, axis = plt.subplots(figsize=(7.0, 2.4))
axis.barh(names, shares)
axis.set(xlabel="probability", xlim=(0.0, 1.0))
fig.tight_layout()
