"""From a case and the conditions at its openings to a model, its wall prestressed.

The wall carries a pressure in the shape of the image, against no pressure outside, by prestress; a
case can have it free of stress there instead, with that pressure outside.
"""

from collections.abc import Callable, Mapping

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxfsi import OUTER_WALL, Mesh
from jaxfsi.core.elements.bending import BendingPrestress
from jaxfsi.core.laws.contact import LeastGap
from jaxfsi.core.laws.fibres import HolzapfelGasserOgden
from jaxfsi.core.laws.fluid import Blood
from jaxfsi.core.laws.materials import LinearElastic, NeoHookean, SaintVenantKirchhoff
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.laws.viscosity import CarreauYasuda, Newtonian
from jaxfsi.core.ports.port import AbstractPort
from jaxfsi.core.ports.pressure import PressurePort
from jaxfsi.core.statics.equilibrium import static_factor
from jaxfsi.core.statics.loads import Loads, pressure_load
from jaxfsi.core.statics.prestress import prestressed
from jaxfsi.core.step.model import Model, build_model
from jaxfsi.fields import wall_frame
from jaxfsi.fields.wall_regions import WallRegion, wall_regions
from lumped.parameters import Parameter
from lumped.waveforms import Constant
from study.case.blood import BloodParameters
from study.case.laws import FIBRES
from study.case.model import Case
from study.case.parameters import WallParameters
from study.run.anatomy_source import case_anatomy


def _with_fibres(wall: WallParameters, E: Parameter, mesh: Mesh) -> HolzapfelGasserOgden:
    """A wall with fibres in the directions of the lumen's frame."""
    frame = wall_frame(mesh)
    return HolzapfelGasserOgden(
        E,
        wall.nu,
        k1=wall.k1,
        k2=wall.k2,
        angle=wall.fibre_angle,
        circumference=jnp.asarray(frame.circumference),
        axis=jnp.asarray(frame.axis),
        dispersion=wall.dispersion,
    )


MATERIALS = {
    "linear": lambda wall, E, _: LinearElastic(E, wall.nu),
    "saint_venant_kirchhoff": lambda wall, E, _: SaintVenantKirchhoff(
        E, wall.nu, wall.volumetric_penalty
    ),
    "neo_hookean": lambda wall, E, _: NeoHookean(E, wall.nu),
    FIBRES: _with_fibres,
}
"""Elastic laws of the wall by name, from its parameters, Young's modulus and the mesh."""

VISCOSITIES = {
    "newtonian": lambda blood: Newtonian(blood.mu),
    "carreau_yasuda": lambda blood: CarreauYasuda(
        mu_zero=blood.mu_zero,
        mu_infinite=blood.mu_infinite,
        relaxation_time=blood.relaxation_time,
        exponent=blood.exponent,
        transition=blood.transition,
    ),
}
"""Viscosity laws of the blood by name, from its parameters."""


def blood_of(blood: BloodParameters) -> Blood:
    """The blood of a model."""
    return Blood(blood.rho_f, VISCOSITIES[blood.law](blood))


def wall_of(case: Case, mesh: Mesh) -> Wall:
    """The wall of a model, with the tissue outside; fibres follow the lumen of the mesh."""
    wall = case.wall
    return Wall(
        MATERIALS[wall.material](wall, young_modulus(case, mesh), mesh),
        rho_s=wall.rho_s,
        damping=wall.damping,
        support_stiffness=wall.tissue.stiffness,
        support_damping=wall.tissue.damping,
    )


def young_modulus(case: Case, mesh: Mesh) -> Parameter:
    """Young's modulus: one number, or one a tetrahedron of the wall where its parts differ.

    The parts are those of `wall_regions`, along the axes of the first state.
    """
    moduli = case.wall.part_moduli
    if case.wall.E_coronary is None and case.wall.E_septum is None:
        return case.wall.E
    of_region = np.empty(len(WallRegion))
    of_region[[WallRegion.AORTA, WallRegion.CORONARY, WallRegion.SEPTUM]] = moduli
    return jnp.asarray(of_region[wall_regions(mesh, case_anatomy(case))])


Stress = dict[str, np.ndarray]
"""Prestress of each part of the wall by name [dyn/cm²]."""

Keep = Callable[[float, Callable[[], Stress]], Stress]
"""Gives the prestress at a pressure [dyn/cm²]: one that it kept, or what the function finds."""


def case_model(
    case: Case,
    mesh: Mesh,
    ports: Mapping[str, AbstractPort],
    P_image: float,
    *,
    rigid: bool = False,
    keep: Keep | None = None,
) -> Model:
    """The model of a case with given ports, its wall prestressed as the case says.

    Args:
        case: the case.
        mesh: its mesh; blood alone where the wall is rigid.
        ports: condition of every opening.
        P_image: pressure of the blood in the image [dyn/cm²].
        rigid: whether the mesh has no wall.
        keep: hands a prestress out again that was found before, see `Keep`.

    Raises:
        RuntimeError: no prestress was found.
    """
    loaded = not rigid and case.wall.prestress == "diastole"
    outside = {OUTER_WALL: PressurePort(Constant(0.0))} if loaded else {}
    model = build_model(
        mesh,
        {**ports, **outside},
        blood=blood_of(case.blood),
        wall=None if rigid else wall_of(case, mesh),
        wall_element=case.wall.element,
        P_ambient=P_image,
        least_gap=LeastGap(case.wall.minimum_gap) if case.wall.minimum_gap else None,
    )
    if not loaded:
        return model

    def found() -> Stress:
        # from the ambient pressure the lumen is free of load, and the outside is pulled
        pull = pressure_load(mesh, OUTER_WALL, -P_image, model)
        S = prestressed(model, Loads((pull,)), static_factor(model)).model.prestress
        parts = S._asdict() if isinstance(S, BendingPrestress) else {"stress": S}
        return {name: np.asarray(part) for name, part in parts.items()}

    stress = found() if keep is None else keep(P_image, found)
    parts = {name: jnp.asarray(part) for name, part in stress.items()}
    S = parts["stress"] if "stress" in parts else BendingPrestress(**parts)
    return eqx.tree_at(lambda m: m.prestress, model, S, is_leaf=lambda leaf: leaf is None)
