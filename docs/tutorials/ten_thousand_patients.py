"""
Calibrate ten thousand patients
===============================

The scale factor α of ten thousand virtual patients, and the derivative of each with respect to its
measurement and its resistance, in one call.
"""

# %%
# Patients
# --------
# Resistances, pressures, heart rates and measured resting ratios are arrays.
import time

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import calibration
import lumped
from lumped import MMHG

rng = np.random.default_rng(7)
n = 10_000
diastolic = rng.uniform(45.0, 80.0, n)
rest = lumped.HaemodynamicCondition(
    P_systolic=jnp.asarray((diastolic + rng.uniform(30.0, 70.0, n)) * MMHG),
    P_diastolic=jnp.asarray(diastolic * MMHG),
    period=jnp.asarray(rng.uniform(0.4, 1.1, n)),
)
patients = lumped.Surrogate(R0=jnp.asarray(rng.uniform(5e2, 2e4, n)))
measured = jnp.asarray(rng.uniform(0.6, 0.985, n))


# %%
# Calibration
# -----------
# The first call compiles; the second one shows what a calibration costs. All devices of JAX share
# the patients: GPUs, or as many parts of the processor as
# ``XLA_FLAGS=--xla_force_host_platform_device_count=2`` says.
def calibrated():
    """All scale factors, with derivatives."""
    return jax.block_until_ready(
        calibration.calibrate_many(patients, rest, measured, derivatives=True)
    )


fits = calibrated()
start = time.perf_counter()
fits = calibrated()
print(f"{n} patients with derivatives in {time.perf_counter() - start:.2f} s")

# %%
# The linear surrogate has a closed form, α = R0 r / ((1 − r) R), which tells how exact they are.
total = patients.coronary.R_1 + patients.coronary.R_2 + patients.coronary.R_3
exact = patients.R0 * measured / ((1.0 - measured) * total)
error = float(jnp.max(jnp.abs(fits.fit.alpha / exact - 1.0)))
print(f"largest relative error of alpha {error:.1e}")
assert error < 1e-10


# %%
# In a loss of your own
# ---------------------
# `calibrate_alpha` of one patient passes through ``vmap``, ``grad`` and ``jit``. Where no α reaches
# the ratio it is NaN there; outside them it raises.
def mean_alpha(R0):
    """Mean scale factor of the first thousand patients at one resting condition [-]."""
    usual = lumped.condition_from_clinic(110.0, 65.0, 0.8)

    def alpha(R0, ratio):
        return calibration.calibrate_alpha(lumped.Surrogate(R0=R0), usual, ratio).alpha

    return jnp.mean(jax.vmap(alpha)(R0, measured[:1000]))


value, slope = jax.jit(jax.value_and_grad(mean_alpha))(patients.R0[:1000])
print(f"mean alpha {value:.3f}; by log R0 in all {jnp.sum(slope * patients.R0[:1000]):.3f}")

# %%
# What a measurement is worth
# ---------------------------
# An error of 0.01 in a resting ratio near 1 moves α by a fifth and more.
fig, axis = plt.subplots(figsize=(7.0, 3.2))
axis.plot(measured, 0.01 * fits.d_target / fits.fit.alpha, ".", markersize=2)
axis.set(xlabel="measured resting ratio", ylabel="relative change of α for 0.01", yscale="log")
fig.tight_layout()
