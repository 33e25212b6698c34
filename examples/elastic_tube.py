"""Blood pulses through an elastic tube into a Windkessel; the mean pressure obeys Ohm's law."""

import numpy as np

from jaxfsi import core, meshing
from lumped import MMHG, RCR, Sinusoid

PERIOD, STEPS = 0.1, 50  # s, and steps in each of four cycles
Q_MEAN = 4.0  # cm³/s
outlet = RCR(R_proximal=400.0, C=2e-5, R_distal=1500.0, P_ref=500.0)  # CGS

mesh = meshing.tube(radius=0.5, length=2.0, thickness=0.1, n_around=8, n_axial=8, n_rings=2)
model = core.build_model(
    mesh,
    {
        "inlet": core.FlowPort(Sinusoid(Q_MEAN, Q_MEAN, PERIOD, np.pi)),
        "outlet": core.BlockPort(outlet),
    },
    wall=core.Wall(core.NeoHookean(1.5e6, 0.45), rho_s=1.1),
)
stepper = core.prepare(PERIOD / STEPS, model)
run = core.march(model, core.initial_state(model), stepper, 4 * STEPS)

P = run.history.P_port[-STEPS:, model.names.index("outlet")].mean() / MMHG
ohm = (outlet.P_ref + (outlet.R_proximal + outlet.R_distal) * Q_MEAN) / MMHG
print(f"mean pressure of the outlet {P:.3f} mmHg, by Ohm's law {ohm:.3f} mmHg")
assert abs(P / ohm - 1.0) < 1e-2
