"""
Elastic tube with a Windkessel
==============================

Blood pulses through an elastic tube into a Windkessel; the mean pressure obeys Ohm's law.
"""

import numpy as np

from jaxfsi import core, meshing
from lumped import MMHG, RCR, Sinusoid

T, Q, n = 0.1, 4.0, 50  # period [s], mean flow [cm³/s], steps of a cycle
mesh = meshing.tube(radius=0.5, length=2.0, thickness=0.1, n_around=8, n_axial=8, n_rings=2)
outlet = RCR(R_proximal=400.0, C=2e-5, R_distal=1500.0, P_ref=500.0)  # CGS
ports = {"inlet": core.FlowPort(Sinusoid(Q, Q, T, np.pi)), "outlet": core.BlockPort(outlet)}
model = core.build_model(mesh, ports, wall=core.Wall(core.NeoHookean(1.5e6, 0.45), rho_s=1.1))
run = core.march(model, core.initial_state(model), core.prepare(T / n, model), 4 * n)

P = run.history.P_port[-n:, model.names.index("outlet")].mean() / MMHG
ohm = (outlet.P_ref + (outlet.R_proximal + outlet.R_distal) * Q) / MMHG
print(f"mean pressure of the outlet {P:.3f} mmHg, by Ohm's law {ohm:.3f} mmHg")
assert abs(P / ohm - 1.0) < 1e-2
