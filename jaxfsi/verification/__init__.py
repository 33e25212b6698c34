"""Problems with exact or published solutions, shared by tests, benchmarks and documentation.

The exact solutions are written out by hand from the equations and share no code with the core.
"""

from jaxfsi.verification.elasticity import ENERGIES, MATERIALS, VOLUME_ENERGIES
from jaxfsi.verification.walls import (
    RING_WORK,
    STRIP_WORK,
    WallProblem,
    clamped_strip,
    lame_displacement,
    radial_displacement,
    squeezed_ring,
    thick_tube,
    work,
)
