"""
Laws of wall and blood
======================

A viscoelastic wall, tissue around it and shear-thinning blood in a pulse.
"""

import jax.numpy as jnp

from jaxfsi import core, meshing
from lumped import MMHG, RCR, Sinusoid

PERIOD, STEPS, Q_MEAN = 0.1, 20, 4.0  # s, steps of a cycle, cm³/s
mesh = meshing.tube(radius=0.5, length=2.0, thickness=0.1, n_around=8, n_axial=6, n_rings=2)
ports = {
    "inlet": core.FlowPort(Sinusoid(Q_MEAN, Q_MEAN, PERIOD, jnp.pi)),
    "outlet": core.BlockPort(RCR(R_proximal=400.0, C=2e-5, R_distal=1500.0)),
}
material = core.NeoHookean(1.5e6, 0.45)
walls = {
    "elastic": core.Wall(material),
    "viscoelastic": core.Wall(material, damping=2e4),  # Kelvin-Voigt, poise
    "supported": core.Wall(material, support_stiffness=5e6, support_damping=1e3),  # CGS
}
bloods = {"Newtonian": core.Blood(), "Carreau-Yasuda": core.Blood(viscosity=core.CarreauYasuda())}

for blood_name, blood in bloods.items():
    for wall_name, wall in walls.items():
        model = core.build_model(mesh, ports, blood=blood, wall=wall)
        stepper = core.prepare(PERIOD / STEPS, model)
        run = core.march(model, core.initial_state(model), stepper, STEPS)
        widest = float(jnp.abs(run.state.d).max())
        P = float(run.history.P_port[-1, 0]) / MMHG
        moved = f"{1e4 * widest:5.1f} um at the end"
        print(f"{blood_name:14s} {wall_name:12s} {P:5.2f} mmHg, {moved}")
