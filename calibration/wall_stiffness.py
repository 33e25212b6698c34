"""Stiffness of a wall round an anomalous coronary, found from the measured motion of its lumen.

The shape of the image carries the pressure of the image by prestress. Another state is the
equilibrium of that wall with other pressures in its lumens, and with the tissue outside::

    image:  ∫ S₀ : ∇v dV = loads(P_image)
    state:  ∫ (P(F) + F S₀) : ∇v dV + support = loads(P_state)

Young's modulus has one value in each region. Any S₀ that balances the image's pressure does so
whatever the moduli: that of the model stays, but where the thickness varies, which moves nodes, it
is found anew. Predicted are area and minor axis of the lumen over those of the image, measured are
the same ratios of the contours. The equilibrium is differentiated by the implicit function theorem.

The motion is quasi-static: inertia, wall viscosity and the flow's own part of the pressure are left
out. Pressure loads all lumens; nothing here stretches, twists or contracts the vessel.
"""

from collections.abc import Callable, Sequence
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float, Int

from calibration.fit import fit
from calibration.free_parameter import FreeParameter, as_free, coordinates, read, write
from calibration.gauss_newton import DampedGaussNewton
from calibration.lumen_record import LumenChange
from calibration.optimum import Fit
from jaxfsi.core.elements.bending import BendingPrestress
from jaxfsi.core.laws.materials import LinearElastic
from jaxfsi.core.laws.wall_balance import second_stress, wall_geometry
from jaxfsi.core.solve.wall_factor import WallFactor
from jaxfsi.core.statics.equilibrium import (
    RESULTS,
    Loads,
    PressureLoad,
    equilibrium,
    load_forces,
    pressure_load,
    static_factor,
)
from jaxfsi.core.step.model import Model
from jaxfsi.fields.lumen_rings import LumenRings
from jaxfsi.mesh import INTERFACE, OUTER_WALL, Mesh
from lumped.parameters import Parameter, Range, check_range, parameter

STIFFNESS_BOUNDS = (2e5, 2e8)
"""Young's moduli that a fit may reach [dyn/cm²]: 20 kPa to 20 MPa."""

SUPPORT_BOUNDS = (1e2, 1e7)
"""Support stiffness that a fit may reach [dyn/cm³]."""

THICKNESS_BOUNDS = (0.5, 2.0)
"""Thickness over that of the mesh that a fit may reach."""

_TOLERANCE, _REDUCTION, _DERIVATIVE = 1e-6, 1e-2, 1e-6
"""Forces out of balance over loads, and how far the systems of equilibrium and its derivative are
solved: a thousandth of what contours tell."""

_LINEAR = 200
"""Iterations of GMRES at most; moduli may lie far from those of the preconditioner."""

_NEWTON = 30
"""Systems of Newton's method at most."""

_NEAR = 1e-3
"""Distance from the optimum, in posterior standard deviations, that counts as none."""


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


FREE = ("aorta", "coronary", "septum", "support")
"""What is fitted unless asked otherwise."""


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

    def with_stiffness(self, stiffness: WallStiffness) -> Model:
        """The model with given stiffness."""
        moduli = jnp.stack([stiffness.aorta, stiffness.coronary, stiffness.septum])
        model = eqx.tree_at(
            lambda m: (m.wall.material.E, m.wall.support_stiffness),
            self.model,
            (moduli[self.region], stiffness.support),
        )
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
        e = _found(small, Loads(force=dead), self.factor)
        return second_stress(e, hooke, model.element, wall_geometry(model.x, model.element))

    def motion(
        self, stiffness: WallStiffness, P: Float[Array, "states nodes"]
    ) -> tuple[Motion, Float[Array, "states 3 nodes"]]:
        """Lumen in several states, and the displacement of the wall [cm]; nan where not found.

        Args:
            stiffness: of the wall.
            P: pressure in the lumens less that of the image, at all nodes [dyn/cm²].
        """
        model = self.with_stiffness(stiffness)
        image = self.rings.size(model.x)

        def one(p):
            loads = Loads((self.outside, self.inside._replace(p=p)))
            d = _found(model, loads, self.factor)
            size = self.rings.size(model.x + d)
            return Motion(size.area / image.area, size.minor / image.minor), d

        return jax.lax.map(one, P)


def _found(model: Model, loads: Loads, factor: WallFactor) -> Float[Array, "3 nodes"]:
    """Displacement in equilibrium, nan where none was found."""
    end = equilibrium(
        model,
        loads,
        factor,
        tolerance=_TOLERANCE,
        max_newton=_NEWTON,
        max_linear=_LINEAR,
        reduction=_REDUCTION,
        derivative=_DERIVATIVE,
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
    moduli = jnp.stack([start.aorta, start.coronary, start.septum])
    initial = eqx.tree_at(
        lambda m: (m.wall.material.E, m.wall.support_stiffness),
        model,
        (moduli[region], start.support),
    )
    return LoadedWall(
        initial, static_factor(initial), jnp.asarray(region), rings, inside, outside, moved
    )


class MotionData(eqx.Module):
    """Measured motion of the lumen in several states as data of a fit.

    Attributes:
        wall: the wall.
        P: pressure less that of the image in each state, at all nodes [dyn/cm²].
        change: what was measured in each state, arrays stacked.
    """

    wall: LoadedWall
    P: Float[Array, "states nodes"]
    change: LumenChange

    def __call__(self, stiffness: WallStiffness) -> Float[Array, " k"]:
        """Residuals of the logarithms of both ratios, in units of their standard deviation."""
        motion, _ = self.wall.motion(stiffness, self.P)
        return jnp.concatenate(
            [
                jnp.ravel((jnp.log(motion.area) - self.change.log_area) / self.change.sd_area),
                jnp.ravel((jnp.log(motion.minor) - self.change.log_minor) / self.change.sd_minor),
            ]
        )


def free_stiffness(names: Sequence[str] = FREE) -> tuple[FreeParameter, ...]:
    """Free parameters by name, within bounds that no tissue leaves.

    Raises:
        ValueError: a name is not one of `WallStiffness`.
    """
    known = ("aorta", "coronary", "septum", "support", "thickness")
    if unknown := [name for name in names if name not in known]:
        raise ValueError(f"{', '.join(unknown)} cannot be fitted; take some of {', '.join(known)}.")
    bounds = {"support": SUPPORT_BOUNDS, "thickness": THICKNESS_BOUNDS}
    return tuple(
        FreeParameter(name, lower=low, upper=high)
        for name in names
        for low, high in [bounds.get(name, STIFFNESS_BOUNDS)]
    )


class LinearMotion(eqx.Module):
    """Residuals of a `MotionData` to first order about one stiffness.

    Attributes:
        u: logarithms of the free parameters there.
        residual: residuals there.
        jacobian: their derivative by the logarithms.
        free: the free parameters.
    """

    u: Float[Array, " n"]
    residual: Float[Array, " k"]
    jacobian: Float[Array, "k n"]
    free: tuple[FreeParameter, ...]

    def __call__(self, stiffness: WallStiffness) -> Float[Array, " k"]:
        """Residuals of another stiffness."""
        return self.residual + self.jacobian @ (jnp.log(read(stiffness, self.free)) - self.u)


@eqx.filter_jit
def linear_motion(
    data: MotionData,
    stiffness: WallStiffness,
    free: tuple[FreeParameter, ...],
    u: Float[Array, " n"],
) -> LinearMotion:
    """Residuals and their derivatives at logarithms u of the free parameters."""

    def residual(v):
        return data(write(stiffness, free, jnp.exp(v)))

    r, along = jax.linearize(residual, u)
    # One after the other: GMRES of several right-hand sides at once copies all its vectors.
    columns = jax.lax.map(along, jnp.eye(len(free)))
    return LinearMotion(u, r, columns.T, free)


def fit_stiffness(
    data: MotionData,
    start: WallStiffness,
    *,
    free: Sequence[FreeParameter | str] | None = None,
    max_steps: int = 40,
    told: Callable[[int, float], None] | None = None,
) -> Fit:
    """Find the stiffness of a wall that explains the measured motion of its lumen.

    The steps are those of `DampedGaussNewton`, taken one by one, so that equilibria and derivatives
    are compiled once. What is known of the optimum is that of `calibration.fit` on the motion to
    first order about it.

    Args:
        data: the states to fit.
        start: where the fit starts; what is not free stays there.
        free: what is fitted, on scale "log"; None: the moduli of all regions and the support.
        max_steps: evaluations of the motion allowed.
        told: called with the number of each evaluation and the cost so far.

    Raises:
        ValueError: a parameter does not exist, starts outside its bounds, or is the thickness of
            a wall that cannot change it.
        RuntimeError: the start has no equilibrium, or the evaluations did not suffice.
    """
    free = as_free(free_stiffness() if free is None else free)
    if any(p.name == "thickness" for p in free) and data.wall.thickening is None:
        raise ValueError(
            "the thickness is to be fitted, but the wall cannot change it. Give `thickening`."
        )
    near = _nearest(data, start, free, max_steps, told)
    at = write(start, free, jnp.exp(near.u))
    found = fit(at, free, near, solver=DampedGaussNewton(atol=_NEAR), max_steps=max_steps)
    return found


def _nearest(
    data: MotionData,
    start: WallStiffness,
    free: tuple[FreeParameter, ...],
    max_steps: int,
    told: Callable[[int, float], None] | None,
) -> LinearMotion:
    """The motion about the optimum."""
    axes = coordinates(start, free)
    solver, options = DampedGaussNewton(atol=_NEAR), {"bend": axes.bend}
    y = axes.unbounded(axes.u_start)
    state = solver.init(None, y, None, options, None, None, frozenset())
    best = None
    for k in range(max_steps):
        trial = state.trial
        here = linear_motion(data, start, free, axes.scaled(trial))

        def about(y, _, here=here):
            u = axes.scaled(y)
            own = here.residual + here.jacobian @ (u - here.u)
            return jnp.concatenate([own, axes.prior_residual(u)]), None

        y, state, _ = solver.step(about, y, None, options, state, frozenset())
        if state.result != optx.RESULTS.successful:
            raise RuntimeError(
                "the start has no equilibrium under the pressures of the states. Start from"
                " stiffer walls, and check pressures and units."
            )
        if bool(jnp.all(y == trial)):
            best = here
        if told is not None:
            told(k + 1, 2.0 * float(state.cost))
        if bool(state.done):
            assert best is not None, "the first trial is taken, or the result says why not"
            return best
    raise RuntimeError(
        f"the fit was not at its end after {max_steps} evaluations. Allow more, or hold what"
        " the motion does not determine."
    )


def misfit(found: Fit) -> float:
    """Root of χ² over its degrees of freedom, at least 1: by it the intervals are widened.

    Where the model does not explain the data, residuals are larger than the standard deviations
    that were assumed, and the covariance of the fit is too small by the square of this factor.
    """
    degrees = max(found.residual.shape[-1] - int(found.identifiability.rank), 1)
    return float(max(1.0, float(jnp.sqrt(found.chi2 / degrees))))


def stiffness_interval(found: Fit) -> Float[Array, "n 2"]:
    """Interval of 95 % of each free parameter, widened by `misfit`."""
    return found.interval(1.96 * misfit(found))
