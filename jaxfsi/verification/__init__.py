"""Problems with exact or published solutions, shared by tests, benchmarks and documentation.

The exact solutions are written out by hand from the equations and share no code with the core.

| module | problem | exact |
|---|---|---|
| `elasticity` | stresses of the materials | derivatives of stored energies |
| `ethier_steinman` | unsteady flow in a box | Ethier & Steinman 1994 |
| `developed_flow` | developed flow in ellipse and rectangle | White 2006 |
| `rigid_tube` | steady and oscillating flow | Poiseuille, `womersley` |
| `channel_cylinder` | steady flow past a cylinder | drag of DFG 3D-1Z |
| `nozzle` | a nozzle and a sudden expansion | loss measured by the FDA's laboratories |
| `windkessel_tube` | a rigid tube into a Windkessel | closed form; histories of other codes |
| `elastic_tube` | sinusoidal wave in an elastic tube | `womersley.wave_number` |
| `tube_wave` | a pulse in an elastic tube | fields and displacement of other codes |
| `walls` | bending strip, squeezed ring, thick tube, slit | converged solutions, Lame |
| `shells` | thin shells in large rotations | Sze, Liu & Lo 2004 |
| `prestressed_pipe` | a pipe that carries a pressure undeformed | Lamé |
| `closing_slit` | a slit whose area halves | none: elements stay valid |
| `coupled_tube` | a small tube with everything | `volume_balance`, `derivatives` |
"""

from jaxfsi.verification.closing_slit import SlitShape, slit_mesh, slit_model, slit_shape
from jaxfsi.verification.coupled_tube import (
    TubeParameters,
    coupled_mesh,
    coupled_model,
    outlet_pressure,
    outlet_pressure_gradient,
    outlet_pressure_slope,
    with_parameters,
)
from jaxfsi.verification.derivatives import compare_along, compare_each
from jaxfsi.verification.developed_flow import (
    StraightLumen,
    developed_flow,
    elliptic_lumen,
    rectangular_lumen,
    uneven,
)
from jaxfsi.verification.elastic_tube import ElasticTube, elastic_mesh, wave_speed
from jaxfsi.verification.elasticity import ENERGIES, MATERIALS, VOLUME_ENERGIES
from jaxfsi.verification.ethier_steinman import EthierSteinman, decay_error
from jaxfsi.verification.figures import Figure, figure, in_band, observed_orders, order_figure
from jaxfsi.verification.rigid_tube import RigidTube, oscillating_errors, steady_errors
from jaxfsi.verification.round_tube import round_tube
from jaxfsi.verification.tube_wave import (
    PULSE_TUBE,
    TUBE_WAVE,
    largest_displacement,
    wave_figures,
    wave_model,
)
from jaxfsi.verification.volume_balance import keep_books, volume_errors, wet_wall
from jaxfsi.verification.walls import (
    RING_WORK,
    SLIT_WIDENING,
    STRIP_WORK,
    WallProblem,
    axial_strain,
    clamped_strip,
    lame_displacement,
    pressurised_slit,
    radial_displacement,
    slit_widening,
    squeezed_ring,
    thick_tube,
    work,
)
from jaxfsi.verification.windkessel_tube import (
    LONG_TUBE,
    SHORT_OPENINGS,
    SHORT_TUBE,
    windkessel_figures,
)
