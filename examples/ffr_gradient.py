"""
Gradient of stress FFR
======================

With respect to everything, through the calibration at rest.
"""

# %% FFR under stress of a patient whose alpha is calibrated to the resting ratio
import equinox as eqx
import jax
import jax.numpy as jnp

import calibration
import lumped

rest = lumped.condition_from_clinic(110.0, 65.0, 0.8)
stress = lumped.condition_from_clinic(130.0, 70.0, 0.45)


def stress_ffr(patient, rule, measured):
    """FFR under stress after calibration to the measured resting ratio."""
    alpha = calibration.calibrate_alpha(patient, rest, measured, throw=False).alpha
    patient = eqx.tree_at(lambda s: s.alpha, patient, alpha)
    network = patient.network(stress, rule=rule)
    return lumped.pressure_ratio(lumped.solve_periodic(network, stress.period, throw=False))


# %% One reverse pass: sensitivities to the measurement, the vessel and the stress rule
patient = lumped.Surrogate(R0=5e3)
rule = lumped.stress_rule("printed")
value, slopes = jax.jit(jax.value_and_grad(stress_ffr, argnums=(0, 1, 2)))(
    patient, rule, jnp.asarray(0.91)
)
print(f"FFR under stress {value:.4f}")
print(f"d FFR / d (resting ratio)  {slopes[2]:+.4f}")
print(f"d FFR / d (factor of R_2)  {slopes[1].R_2:+.4f}")
print(f"d FFR / d log R0           {slopes[0].R0 * patient.R0:+.1e}  (calibration absorbs R0)")

# %% The same gradient with a quadratic loss, where no closed form exists
lossy = lumped.Surrogate(R0=5e2, K=5e3)
value, slopes = jax.jit(jax.value_and_grad(stress_ffr, argnums=(0, 1, 2)))(
    lossy, rule, jnp.asarray(0.91)
)
print(f"with K: FFR {value:.4f}, d FFR / d log K {slopes[0].K * lossy.K:+.4f}")
