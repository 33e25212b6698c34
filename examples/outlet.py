"""
One outlet alone
================

The four views of a coronary block, and its periodic state.
"""

# %% The block of the paper with a beating ventricle behind it
import jax.numpy as jnp

import lumped
from lumped import MMHG

ventricle = lumped.VentricularPressure(P_peak=110.0 * MMHG, period=0.8)
block = lumped.Coronary(
    R_1=3.1992e4, R_2=6.3984e4, R_3=2.666e5, C_a=4.5e-7, C_im=3e-6, P_im=ventricle
)

# %% As a 3D solver sees it over one millisecond: P = Z Q + b
x = jnp.array([90.0, 60.0]) * MMHG
Z, b = lumped.implicit_step(0.0, 1e-3, x, block, 0.3, 0.3)
print(f"implicit step: Z = {Z:.0f} dyn s/cm5, b = {b / MMHG:.1f} mmHg")

# %% As a wave sees it, and over a whole cycle
omega = 2 * jnp.pi / 0.8 * jnp.arange(4.0)
print("impedance modulus:", jnp.abs(lumped.transfer_impedance(block, omega)).round(0))
R, P_0 = lumped.direct_current(0.0, block)
print(f"direct current: R = {R:.0f} dyn s/cm5")

# %% Driven by the aorta: the periodic state, found without running cycles
aorta = lumped.AorticPressure(P_systolic=110.0 * MMHG, P_diastolic=65.0 * MMHG, period=0.8)
network = lumped.connect({"aorta": (lumped.PressureSource(aorta), "root"), "bed": (block, "root")})
state = lumped.solve_periodic(network, period=0.8)
print(f"mean flow {state.mean_flow('bed') / lumped.ML_PER_MIN:.1f} mL/min")
print(f"Floquet multiplier {state.floquet_multiplier:.1e}, error {state.error_estimate:.0e}")
