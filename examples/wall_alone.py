"""
A wall alone
============

A thick tube without blood under a pressure from inside, against Lamé's solution.
"""

# %% A tube of one layer of quadratic elements, clamped at its ends
import numpy as np

from jaxfsi import core, meshing

a, b, E, nu, p = 0.5, 0.6, 1.5e7, 0.3, 1e4  # radii [cm], dyn/cm², -, dyn/cm²
mesh = meshing.ring(radius=a, length=2.0, thickness=b - a, n_around=24, n_axial=20, n_layers=1)
wall = core.Wall(core.NeoHookean(E, nu))
model = core.build_model(mesh, {}, wall=wall, wall_element="quadratic")

# %% Equilibrium with a pressure that follows the wall
loads = core.Loads((core.pressure_load(mesh, "interface", p, model),))
found = core.equilibrium(model, loads, core.static_factor(model))
print(f"{found.n_newton} Newton steps, {found.n_gmres} iterations of GMRES")

# %% Widening in the middle; Lamé with the axial strain that clamped ends leave
x, d = np.asarray(model.x[:, : model.n_vertices]), np.asarray(found.d[:, : model.n_vertices])
r = np.hypot(x[0], x[1])
inside = (np.abs(r - a) < 1e-6) & (np.abs(x[2] - 1.0) < 0.06)
widening = np.mean((x[0] * d[0] + x[1] * d[1])[inside] / a)
near = (np.abs(r - a) < 1e-6) & (np.abs(x[2] - 1.0) < 0.26)
strain = np.polyfit(x[2, near], d[2, near], 1)[0]
lame = p * a**2 * (1 + nu) / (E * (b**2 - a**2)) * ((1 - 2 * nu) * a + b**2 / a) - nu * strain * a
print(f"radius grows by {1e4 * widening:.2f} um, by Lamé {1e4 * lame:.2f} um")
assert abs(widening / lame - 1.0) < 0.03
