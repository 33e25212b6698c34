"""Default numbers of blood, wall and solver, without JAX: case files have them as defaults."""

BLOOD_DENSITY = 1.06
"""Density of blood [g/cm³]."""

BLOOD_VISCOSITY = 0.04
"""Viscosity of Newtonian blood [poise]."""

CHO_KENSEY = {
    "mu_zero": 0.56,
    "mu_infinite": 0.0345,
    "relaxation_time": 1.902,
    "exponent": 0.22,
    "transition": 1.25,
}
"""Shear-thinning blood of Cho & Kensey 1991 (Biorheology 28:241), CGS."""

WALL_DENSITY = 1.0
"""Density of the wall [g/cm³]."""

MAX_HALVINGS = 4
"""How often a step that fails may be halved."""

MAX_ITERATIONS = 60
"""Iterations of GMRES in a linear system at most."""

MAX_SYSTEMS = 16
"""Linear systems in a step at most. A step in which a slit snaps shut takes up to twelve."""

CHECKPOINT_EVERY = 100
"""Whole steps between two checkpoints."""
