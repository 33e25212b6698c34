"""Pressure waves in an elastic tube: two classical problems of fluid-structure interaction.

A pressure acts for 3 ms on the inlet of a tube whose ends are clamped and whose outlet is free.
Both tubes have R = 0.5 cm, h = 0.1 cm, L = 5 cm, E = 3·10⁶ dyn/cm² and ν = 0.3.

| problem | wall | reference |
|---|---|---|
| `TUBE_WAVE` | St. Venant-Kirchhoff with a penalty | fields of svMultiPhysics on one mesh |
| `PULSE_TUBE` | linear elastic | largest radial displacement of other codes |

Source: Gerbeau & Vidrascu 2003, ESAIM: M2AN 37:631, section 6; the values of `PULSE_DISPLACEMENT`
are those to which the second-order runs of solids4foam's case 3dTube tend.
"""

from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxfsi.core.laws.fluid import Blood
from jaxfsi.core.laws.materials import AbstractMaterial, LinearElastic, SaintVenantKirchhoff
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.laws.viscosity import Newtonian
from jaxfsi.core.ports.pressure import PressurePort
from jaxfsi.core.step.march import march
from jaxfsi.core.step.model import Model, WallElement, build_model
from jaxfsi.core.step.state import State, initial_state
from jaxfsi.core.step.stepper import prepare
from jaxfsi.mesh import Mesh
from jaxfsi.verification.figures import Figure, figure
from jaxfsi.verification.round_tube import round_tube
from lumped.parameters import Parameter, Range, check_range, parameter
from lumped.waveforms import AbstractWaveform, Constant

RADIUS, THICKNESS, LENGTH = 0.5, 0.1, 5.0
"""Inner radius, wall thickness and length of the tube [cm]."""

YOUNG, POISSON = 3e6, 0.3
"""Young's modulus [dyn/cm²] and Poisson's ratio of the wall."""

PULSE_DISPLACEMENT = (0.0155, 0.0159)
"""Largest radial displacement of the inner wall at mid-length of `PULSE_TUBE` [cm]."""


class Burst(AbstractWaveform):
    """A value until `t_end`, then 0; not periodic.

    Attributes:
        value: value at the start.
        t_end: last time with that value [s].
    """

    value: Parameter = parameter()
    t_end: Parameter = parameter()

    ranges: ClassVar[Range] = Range(above=("t_end",), finite=("value",))

    def __check_init__(self):
        check_range(self)

    def __call__(self, t: Parameter) -> Array:
        """Value at time t [s]."""
        return jnp.where(t <= self.t_end, self.value, 0.0)

    def repeats_after(self) -> Parameter | None:
        """Never."""
        return float("inf")

    def breakpoints(self) -> Float[Array, " 1"]:
        """Its end [s]."""
        return jnp.reshape(jnp.asarray(self.t_end, float), (1,))


class WaveProblem(NamedTuple):
    """A tube under a burst of pressure.

    Attributes:
        material: of the wall.
        rho_s: density of the wall [g/cm³].
        rho_f: density of the blood [g/cm³].
        mu: viscosity of the blood [g/(cm·s)].
        pressure: on the inlet [dyn/cm²].
        t_end: end of the burst [s].
        transient_continuity: see `Blood`.
    """

    material: AbstractMaterial
    rho_s: float = 1.2
    rho_f: float = 1.0
    mu: float = 0.03
    pressure: float = 1.333e4
    t_end: float = 3e-3
    transient_continuity: bool = False


TUBE_WAVE = WaveProblem(
    SaintVenantKirchhoff(YOUNG, POISSON, YOUNG / (3.0 * (1.0 - 2.0 * POISSON))),
    transient_continuity=True,
)
"""The wave of which fields are stored, with that program's stabilisation."""

PULSE_TUBE = WaveProblem(LinearElastic(YOUNG, POISSON), pressure=1.3333e4)
"""The tube of solids4foam's case 3dTube: 1333.3 Pa for 3 ms, to 20 ms."""


def wave_mesh(n_around: int, n_axial: int, n_layers: int, *, columns: bool = False) -> Mesh:
    """The tube with so many elements round, along and through its wall, in columns or not."""
    return round_tube(
        radius=RADIUS,
        length=LENGTH,
        thickness=THICKNESS,
        n_around=n_around,
        n_axial=n_axial,
        n_rings=n_around // 5,
        n_layers=n_layers,
        grading=0.0,
        columns=columns,
    )


def wave_model(mesh: Mesh, problem: WaveProblem, *, wall_element: WallElement = "linear") -> Model:
    """The problem on a mesh of the tube, whose inlet is the opening with the lowest z."""
    height = {name: np.mean(mesh.points[mesh.labelled(name), 2]) for name in mesh.openings}
    inlet, outlet = sorted(mesh.openings, key=lambda name: height[name])
    return build_model(
        mesh,
        {
            inlet: PressurePort(Burst(problem.pressure, problem.t_end)),
            outlet: PressurePort(Constant(0.0)),
        },
        blood=Blood(problem.rho_f, Newtonian(problem.mu), problem.transient_continuity),
        wall=Wall(problem.material, problem.rho_s),
        wall_element=wall_element,
    )


class StoredFields(NamedTuple):
    """Fields of another code at the nodes of a mesh.

    Attributes:
        p: pressure [dyn/cm²].
        d: displacement [cm].
    """

    p: Float[np.ndarray, " nodes"]
    d: Float[np.ndarray, "nodes 3"]


def field_errors(state: State, model: Model, stored: StoredFields) -> tuple[float, float]:
    """Relative L₂ differences of pressure and of the wall's displacement, over the nodes."""
    return (
        _difference(np.asarray(state.p), stored.p, np.asarray(model.in_fluid)),
        _difference(np.asarray(state.d).T, stored.d, np.asarray(model.in_solid)),
    )


def _difference(
    values: Float[np.ndarray, "nodes *_"],
    exact: Float[np.ndarray, "nodes *_"],
    where: Bool[np.ndarray, " nodes"],
) -> float:
    return float(np.linalg.norm((values - exact)[where]) / np.linalg.norm(exact[where]))


def radial_displacement(state: State, model: Model, *, z: float = LENGTH / 2.0) -> Float[Array, ""]:
    """Mean radial displacement [cm] of the nodes of the inner wall in the section at z [cm]."""
    radius = jnp.hypot(model.x[0], model.x[1])
    on_wall = model.in_fluid & model.in_solid
    away = jnp.where(on_wall, jnp.abs(model.x[2] - z), jnp.inf)
    here = away < jnp.min(away) + 1e-6
    outwards = (state.d[0] * model.x[0] + state.d[1] * model.x[1]) / jnp.maximum(radius, 1e-12)
    return jnp.mean(outwards, where=here)


def wave_figures(mesh: Mesh, stored: Mapping[int, StoredFields], *, dt: float) -> list[Figure]:
    """Differences from stored fields, and the iterations that a step takes.

    Args:
        mesh: mesh of the fields.
        stored: fields after so many steps; the numbers are multiples of their smallest.
        dt: length of a step [s].
    """
    model = wave_model(mesh, TUBE_WAVE)
    stepper, state = prepare(dt, model), initial_state(model)
    result, n_gmres, chunk = [], [], min(stored)
    for n in range(chunk, max(stored) + 1, chunk):
        end = march(model, state, stepper, chunk)
        state = end.state
        n_gmres.append(np.asarray(end.history.report.n_gmres))
        if n in stored:
            errors = field_errors(state, model, stored[n])
            result += [
                figure("tube wave", f"{name} at {1e3 * n * dt:g} ms, relative L2", error, 0.0, 0.03)
                for name, error in zip(("pressure", "displacement"), errors, strict=True)
            ]
    mean = float(np.mean(np.concatenate(n_gmres)))
    return [*result, figure("tube wave", "iterations a step", mean, 0.0, 20.0)]


def largest_displacement(
    mesh: Mesh, *, dt: float, t_end: float = 9e-3, wall_element: WallElement = "quadratic"
) -> float:
    """Largest radial displacement of the inner wall of `PULSE_TUBE` at mid-length [cm]."""
    model = wave_model(mesh, PULSE_TUBE, wall_element=wall_element)
    stepper, state = prepare(dt, model), initial_state(model)
    displacement = []
    for _ in range(round(t_end / dt)):
        state = march(model, state, stepper, 1).state
        displacement.append(float(radial_displacement(state, model)))
    return max(displacement)
