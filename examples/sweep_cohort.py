"""
Sweep a cohort
==============

Patients, conditions and scale factors in one call.
"""

# %% Twenty patients who differ in R0 and pressures
import jax.numpy as jnp
import numpy as np

import calibration
import lumped
from lumped import MMHG

rng = np.random.default_rng(1)
R0 = jnp.asarray(rng.uniform(1e3, 1e4, 20))
alphas = jnp.geomspace(0.02, 2.0, 50)
conditions = lumped.HaemodynamicCondition(
    P_systolic=jnp.array([110.0, 130.0]) * MMHG,
    P_diastolic=jnp.array([65.0, 70.0]) * MMHG,
    period=jnp.array([0.8, 0.45]),
)

# %% All combinations: 20 x 50 x 2 periodic states
index_R0, index_alpha = jnp.meshgrid(jnp.arange(20), jnp.arange(50), indexing="ij")
patients = lumped.Surrogate(R0=R0[index_R0.ravel()], alpha=alphas[index_alpha.ravel()])
patients, states = calibration.grid(patients, conditions)
sweep = calibration.simulate_many(patients, states, waveforms=False)
ratio = sweep.metrics.ratio.reshape(20, 50, 2)
print("cases:", ratio.size)

# %% What alpha does to the ratio, cohort median
for k in (0, 25, 49):
    print(f"alpha {alphas[k]:.3f}: rest {jnp.median(ratio[:, k, 0]):.3f}")

# %% Calibrated instead of swept: every alpha and its derivative with respect to the measurement
targets = jnp.asarray(rng.uniform(0.85, 0.97, 20))
rest = lumped.condition_from_clinic(110.0, 65.0, 0.8)
fits = calibration.calibrate_many(lumped.Surrogate(R0=R0), rest, targets, derivatives=True)
print("alpha from", f"{fits.fit.alpha.min():.3f} to {fits.fit.alpha.max():.3f}")
print(f"largest d alpha/d ratio: {fits.d_target.max():.1f}")
