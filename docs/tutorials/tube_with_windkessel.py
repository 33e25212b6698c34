"""
A 3D tube with a Windkessel
===========================

Blood pulses into an elastic tube; behind its outlet stands a three-element Windkessel (RCR), the
same object that 0D networks use. The mean pressure must obey Ohm's law; its waves are compared with
those of the Windkessel alone under the same flow.
"""

# %%
# Mesh, ports, model
# ------------------
# A *port* is the boundary condition of an opening. Units are CGS: cm, g, s, dyn/cm².
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import lumped
from jaxfsi import core, meshing
from lumped import MMHG

period, n_steps, cycles, Q_mean = 0.1, 25, 4, 4.0  # s, -, -, cm³/s
inflow = lumped.Sinusoid(Q_mean, Q_mean, period, np.pi)
outlet = lumped.RCR(R_proximal=400.0, C=2e-5, R_distal=1500.0)

mesh = meshing.tube(radius=0.5, length=2.0, thickness=0.1, n_around=8, n_axial=8, n_rings=2)
model = core.build_model(
    mesh,
    {"inlet": core.FlowPort(inflow), "outlet": core.BlockPort(outlet)},
    wall=core.Wall(core.NeoHookean(1.5e6, 0.45), rho_s=1.1),
)
print(f"{len(mesh.tets)} tetrahedra, {len(mesh.points)} nodes")

# %%
# Steps
# -----
# `prepare` factorises what does not change from step to step; `march` takes all steps in one
# compiled loop.
stepper = core.prepare(period / n_steps, model)
run = core.march(model, core.initial_state(model), stepper, cycles * n_steps)
report = run.history.report
print(f"iterations of GMRES a step: {float(jnp.mean(report.n_gmres)):.1f}")

# %%
# Against 0D
# ----------
# The elastic wall stores blood in systole and gives it back later, so the outlet sees smaller and
# later waves than the Windkessel alone.
where = model.names.index("outlet")
P, Q = run.history.P_port[:, where] / MMHG, run.history.Q_port[:, where]
network = lumped.connect({"flow": (lumped.FlowSource(inflow), "outlet"), "bed": (outlet, "outlet")})
alone = lumped.solve_periodic(network, period)
ohm = (outlet.R_proximal + outlet.R_distal) * Q_mean / MMHG
print(f"mean pressure {P[-n_steps:].mean():.3f} mmHg, by Ohm's law {ohm:.3f} mmHg")

t = np.asarray(run.history.t)
fig, axes = plt.subplots(2, 1, figsize=(7.0, 5.0), sharex=True)
axes[0].plot(t, Q, label="outlet, 3D")
axes[0].plot(t, np.asarray([inflow(s) for s in t]), "k:", label="inflow")
axes[0].set_ylabel("flow [cm³/s]")
axes[1].plot(t, P, label="outlet, 3D")
axes[1].plot(
    np.asarray(alone.t) + (cycles - 1) * period, alone.pressure("outlet") / MMHG, "k:",
    label="Windkessel alone, periodic",
)  # fmt: skip
axes[1].set(xlabel="time [s]", ylabel="pressure [mmHg]")
for axis in axes:
    axis.legend(loc="lower right")
fig.tight_layout()
