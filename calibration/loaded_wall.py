"""A wall that carries the pressure of an image, and what its lumen does under other pressures.

The shape of the image carries the pressure of the image by prestress. Another state is the
equilibrium of that wall with other pressures in its lumens, and with the tissue outside::

    image:  ∫ S₀ : ∇v dV = loads(P_image)
    state:  ∫ (P(F) + F S₀) : ∇v dV + support = loads(P_state)

Young's modulus has one value in each region. Any S₀ that balances the image's pressure does so
whatever the moduli: that of the model stays, but where the thickness varies, which moves nodes, it
is found anew. The equilibrium is differentiated by the implicit function theorem.

The motion is quasi-static: inertia, wall viscosity and the flow's own part of the pressure are left
out. Pressure loads all lumens; nothing here stretches, twists or contracts the vessel.
"""

from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxfsi.core.elements.bending import BendingPrestress
from jaxfsi.core.laws.materials import LinearElastic
from jaxfsi.core.laws.wall_balance import second_stress, wall_geometry
from jaxfsi.core.solve.wall_factor import WallFactor
from jaxfsi.core.statics.equilibrium import RESULTS, equilibrium, static_factor
from jaxfsi.core.statics.loads import Loads, PressureLoad, load_forces, pressure_load
from jaxfsi.core.step.model import Model
from jaxfsi.fields.lumen_rings import LumenRings
from jaxfsi.mesh import INTERFACE, OUTER_WALL, Mesh
from lumped.parameters import Parameter, Range, check_range, parameter

_TOLERANCE, _REDUCTION, _DERIVATIVE = 1e-6, 1e-2, 1e-6
"""Forces out of balance over loads, and how far the systems of equilibrium and its derivative are
solved: a thousandth of what contours tell."""

_LINEAR, _NEWTON = 150, 15
"""Iterations of GMRES and systems of Newton's method at most. With the factor of their own moduli
equilibria of a patient take 10 to 35 iterations a system and 4 to 12 systems."""


class WallStiffness(eqx.Module):
    """How stiff the parts of a wall are.

    Attributes:
        aorta: Young's modulus of the aorta [dyn/cm²].
        coronary: of the coronary [dyn/cm²].
        septum: of what lies between their lumens [dyn/cm²].
        support: of the tissue outside, traction per displacement [dyn/cm³].
        thickness: of the wall over that of the mesh.
    """

    ranges: ClassVar[Range] = Range(
        above=("aorta", "coronary", "septum", "thickness"), least=("support",)
    )
    aorta: Parameter = parameter()
    coronary: Parameter = parameter()
    septum: Parameter = parameter()
    support: Parameter = parameter()
    thickness: Parameter = parameter(default=1.0)

    def __check_init__(self):
        """Refuse numbers that are not positive; traced ones pass.

        Raises:
            ValueError: a concrete number is out of its range.
        """
        check_range(self)


class Motion(NamedTuple):
    """Lumen of a state over that of the image.

    Attributes:
        area: ratio of the areas in each ring.
        minor: ratio of the minor axes.
    """

    area: Float[Array, " rings"]
    minor: Float[Array, " rings"]


class LoadedWall(eqx.Module):
    """A wall that carries the pressure of the image, and the rings in which it is measured.

    Make it with `loaded_wall`.

    Attributes:
        model: the prestressed model; its moduli and support are replaced.
        factor: of its stiffness.
        region: `WallRegion` of each tetrahedron of the wall.
        rings: of the lumen.
        inside: the lumen's faces, under no pressure.
        outside: the outer faces, pulled by the pressure of the image.
        thickening: displacement of the nodes that doubles the thickness [cm]; None: it is fixed.
    """

    model: Model
    factor: WallFactor
    region: Int[Array, " solid_tets"]
    rings: LumenRings
    inside: PressureLoad
    outside: PressureLoad
    thickening: Float[Array, "3 nodes"] | None

    def factored(self, stiffness: WallStiffness) -> "LoadedWall":
        """The wall with the factor of a concrete stiffness; the factor has the thickness of 1."""
        model = _stiffened(self.model, stiffness, self.region)
        return eqx.tree_at(lambda wall: wall.factor, self, static_factor(model))

    def with_stiffness(self, stiffness: WallStiffness) -> Model:
        """The model with given stiffness."""
        model = _stiffened(self.model, stiffness, self.region)
        if self.thickening is None:
            return model
        x = model.x + (stiffness.thickness - 1.0) * self.thickening
        model = eqx.tree_at(lambda m: m.x, model, x)
        return eqx.tree_at(lambda m: m.prestress, model, self._image_stress(model))

    def _image_stress(self, model: Model) -> BendingPrestress | Float[Array, "3 3 points tets"]:
        """Hookean stress of the wall under the pressure of the image, see `prestressed`."""
        assert model.wall is not None
        hooke = LinearElastic.of_moduli(*model.wall.material.moduli)
        small = eqx.tree_at(
            lambda m: (m.wall.material, m.wall.support_stiffness, m.prestress),
            model,
            (hooke, 0.0, None),
            is_leaf=lambda leaf: leaf is None,
        )
        dead = load_forces(Loads((self.outside,)), jnp.zeros_like(model.x), model)
        e = _found(small, Loads(force=dead), self.factor, jnp.zeros_like(model.x))
        return second_stress(e, hooke, model.element, wall_geometry(model.x, model.element))

    def state(
        self,
        stiffness: WallStiffness,
        P: Float[Array, " nodes"],
        start: Float[Array, "3 nodes"],
    ) -> tuple[Motion, Float[Array, "3 nodes"]]:
        """Lumen in one state, and the displacement of the wall [cm]; nan where not found.

        Args:
            stiffness: of the wall.
            P: pressure in the lumens less that of the image, at all nodes [dyn/cm²].
            start: displacement from which the search sets out [cm].
        """
        model = self.with_stiffness(stiffness)
        image = self.rings.size(model.x)
        loads = Loads((self.outside, self.inside._replace(p=P)))
        d = _found(model, loads, self.factor, start)
        size = self.rings.size(model.x + d)
        return Motion(size.area / image.area, size.minor / image.minor), d

    def motion(
        self, stiffness: WallStiffness, P: Float[Array, "states nodes"]
    ) -> tuple[Motion, Float[Array, "states 3 nodes"]]:
        """Lumen in several states, each from the image under its whole load; see `state`."""
        return jax.lax.map(lambda p: self.state(stiffness, p, jnp.zeros_like(self.model.x)), P)


def _stiffened(model: Model, stiffness: WallStiffness, region: Int[Array, " solid_tets"]) -> Model:
    """A model with the moduli of its regions and the support."""
    moduli = jnp.stack([stiffness.aorta, stiffness.coronary, stiffness.septum])
    return eqx.tree_at(
        lambda m: (m.wall.material.E, m.wall.support_stiffness),
        model,
        (moduli[region], stiffness.support),
    )


def _found(
    model: Model, loads: Loads, factor: WallFactor, start: Float[Array, "3 nodes"]
) -> Float[Array, "3 nodes"]:
    """Displacement in equilibrium, nan where none was found."""
    end = equilibrium(
        model,
        loads,
        factor,
        tolerance=_TOLERANCE,
        max_systems=_NEWTON,
        max_iterations=_LINEAR,
        reduction=_REDUCTION,
        derivative=_DERIVATIVE,
        start=start,
        throw=False,
    )
    return jnp.where(end.result == RESULTS.successful, end.d, jnp.nan)


def loaded_wall(
    model: Model,
    mesh: Mesh,
    region: Int[np.ndarray, " solid_tets"],
    rings: LumenRings,
    P_image: float,
    start: WallStiffness,
    *,
    thickening: Float[np.ndarray, "nodes 3"] | None = None,
) -> LoadedWall:
    """A wall whose stiffness can be fitted.

    Args:
        model: a model of the wall, with or without its blood, prestressed by the pressure of the
            image.
        mesh: its mesh.
        region: of each tetrahedron of the wall, see `jaxfsi.fields.wall_regions`.
        rings: of the lumen.
        P_image: pressure in the lumens at which the mesh has its shape [dyn/cm²].
        start: stiffness at which the preconditioner is factored.
        thickening: see `jaxfsi.adjoint.lumen_shape.thickness_field`; None: the thickness stays.

    Raises:
        ValueError: the model has no wall or no prestress, or regions do not fit it.
    """
    n = model.solid_tets.shape[1]
    if model.prestress is None:
        raise ValueError(
            "the wall has no prestress, but its shape is that of an image under pressure. Prestress"
            " it with jaxfsi.core.statics.prestress.prestressed."
        )
    if np.shape(region) != (n,):
        raise ValueError(
            f"{np.size(region)} regions are given for a wall of {n} tetrahedra. Give one each."
        )
    outside = pressure_load(mesh, OUTER_WALL, -P_image, model)
    inside = pressure_load(mesh, INTERFACE, 0.0, model)
    moved = None
    if thickening is not None:
        moved = jnp.pad(jnp.asarray(thickening.T), ((0, 0), (0, model.n_nodes - len(mesh.points))))
    initial = _stiffened(model, start, jnp.asarray(region))
    return LoadedWall(
        initial, static_factor(initial), jnp.asarray(region), rings, inside, outside, moved
    )
