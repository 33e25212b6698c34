"""
Calibration with 3D in the loop
===============================

The surrogate knows the artery as one resistance; the 3D run has entrance losses besides. α is
corrected until the resting Pd/Pa of the 3D run is the measured one.
"""

# %% A narrow rigid artery between the aortic pressure and a coronary bed
import equinox as eqx
import jax.numpy as jnp
import numpy as np

import calibration
import lumped
from jaxfsi import core, meshing

radius, length, measured, n_steps = 0.06, 0.6, 0.91, 60  # cm, cm, Pd/Pa, steps of a beat
rest = lumped.condition_from_clinic(110.0, 65.0, 0.8)
blood = core.Blood()
poiseuille = 8.0 * blood.viscosity.mu * length / (np.pi * radius**4)
surrogate = lumped.Surrogate(R0=poiseuille)
aorta = lumped.AorticPressure(rest.P_systolic, rest.P_diastolic, rest.period)
mesh = meshing.tube(
    radius=radius, length=length, thickness=0.0, n_around=10, n_axial=16, n_layers=0, n_rings=3
)


def ratio_in_3d(alpha):
    """Resting Pd/Pa of one beat in 3D, from the periodic state of the surrogate."""
    tuned = eqx.tree_at(lambda s: s.alpha, surrogate, jnp.asarray(alpha, float))
    network = tuned.network(rest)
    ports = {"inlet": core.PressurePort(aorta), "outlet": core.BlockPort(network["coronary"])}
    model = core.build_model(mesh, ports, blood=blood)
    blocks = (None, calibration.network_start(network, rest.period))
    state = core.initial_state(model, p=aorta(0.0), blocks=blocks)
    run = core.march(model, state, core.prepare(rest.period / n_steps, model), n_steps)
    P = run.history.P_port.mean(axis=0)
    return float(P[1] / P[0])


# %% The surrogate's own α first, then corrections
start = float(calibration.alpha_closed_form(surrogate, rest, measured))
found = calibration.calibrate_in_loop(surrogate, rest, measured, ratio_in_3d, [start])
for trial in found.trials:
    print(f"alpha {trial.alpha:.4f}: Pd/Pa in 3D {trial.ratio:.4f}")
print(f"reached {measured} within {calibration.RATIO_TOLERANCE}: {found.reached}")
