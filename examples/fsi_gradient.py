"""
Gradient through blood and wall
===============================

One reverse sweep through the coupled steps: the derivative of the outlet's mean pressure with
respect to Young's modulus and to the position of every node.
"""

# %% An elastic tube with a Windkessel, twenty steps of 2 ms
import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxfsi import core, meshing
from lumped import MMHG, RCR, Sinusoid

E = 1.5e6  # dyn/cm²
mesh = meshing.tube(radius=0.5, length=2.0, thickness=0.1, n_around=8, n_axial=6, n_rings=2)
ports = {
    "inlet": core.FlowPort(Sinusoid(4.0, 4.0, 0.1, np.pi)),
    "outlet": core.BlockPort(RCR(R_proximal=400.0, C=2e-5, R_distal=1500.0)),
}
model = core.build_model(mesh, ports, wall=core.Wall(core.NeoHookean(E, 0.45), rho_s=1.1))
stepper = core.prepare(2e-3, model, tolerance=1e-6)


# %% Any scalar of a march has a gradient with the structure of the model
def outlet_pressure(model):
    """Mean pressure of the outlet [mmHg]."""
    run = core.march(model, core.initial_state(model), stepper, 20, throw=False)
    return jnp.mean(run.history.P_port[:, model.names.index("outlet")]) / MMHG


value, slope = eqx.filter_jit(eqx.filter_value_and_grad(outlet_pressure))(model)
print(f"mean pressure of the outlet {value:.4f} mmHg")
print(f"dP / d log E = {E * slope.wall.material.E:+.4f} mmHg")

# %% By node positions: widen the lumen by 0.1 mm, the wall moving along
x = np.asarray(model.x)
r = np.hypot(x[0], x[1])
outwards = np.where(r > 0.49, np.stack([x[0], x[1], 0.0 * r]) / np.maximum(r, 1e-9), 0.0)
print(f"lumen wider by 0.1 mm: {0.01 * np.sum(slope.x * outwards):+.4f} mmHg")
