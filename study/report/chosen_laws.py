"""What a page says of laws of blood, wall and tissue that a case chooses beyond the usual ones."""

import math
from collections.abc import Iterator

from jaxfsi.mesh import Mesh
from lumped.units import MM
from study.case.laws import CARREAU_YASUDA, FIBRES
from study.case.model import Case
from study.case.parameters import WallParameters


def chosen_laws(case: Case, *, rigid: bool = False) -> Iterator[str]:
    """A sentence for each law of the 3D model that acts in this case and by default does not."""
    blood, wall = case.blood, case.wall
    if blood.law == CARREAU_YASUDA:
        yield (
            f"the blood thins with the shear rate (Carreau-Yasuda), from {blood.mu_zero:g} to"
            f" {blood.mu_infinite:g} poise"
        )
    if rigid:
        return
    if wall.material == FIBRES:
        yield (
            f"the wall has collagen fibres ({wall.material}) at"
            f" {math.degrees(wall.fibre_angle):g}° to the circumference, with k1"
            f" {wall.k1:g} dyn/cm², k2 {wall.k2:g} and dispersion {wall.dispersion:g}"
        )
    elif wall.material != WallParameters.material:
        yield f"the elastic law of the wall is {wall.material}"
    for part, E in (("coronary", wall.E_coronary), ("septum", wall.E_septum)):
        if E is not None:
            yield f"the {part} has a Young's modulus of {E:.3g} dyn/cm², the wall {wall.E:.3g}"
    if wall.damping:
        yield f"the wall is viscoelastic (Kelvin-Voigt), with {wall.damping:g} poise"
    if wall.volumetric_penalty:
        penalty = f"{wall.volumetric_penalty:g} dyn/cm²"
        yield f"a penalty of {penalty} resists changes of the wall's volume"
    if wall.tissue.stiffness or wall.tissue.damping:
        yield (
            f"tissue outside holds the wall: {wall.tissue.stiffness:g} dyn/cm³ and"
            f" {wall.tissue.damping:g} dyn·s/cm³"
        )
    if wall.minimum_gap:
        yield f"sides of the lumen repel each other below a gap of {wall.minimum_gap / MM:g} mm"


def wall_without_columns(case: Case, mesh: Mesh) -> Iterator[str]:
    """A sentence where a wall is to bend and the mesh has no wedges for it."""
    if case.wall.element == "bending" and not len(mesh.wedges):
        yield (
            "the mesh has no columns of wedges: its wall is of quadratic tetrahedra, and steps take"
            ' four to five times those with [wall] element = "linear", whose wall hardly bends'
        )
