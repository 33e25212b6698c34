"""A sinusoidal pressure wave in an elastic tube: its complex wave number.

Between the ends the pressure is a wave that leaves and one that returns, whatever the ends are
like, p(z) = A e^(−ikz) + B e^(ikz), so that for any distance s::

    p(z + s) + p(z − s) = 2 cos(ks) p(z)

The least-squares solution for cos(ks) over all sections gives k, to be compared with
`womersley.wave_number`. The wave is small, so that convection plays no part.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from jaxfsi.core.laws.fluid import Blood
from jaxfsi.core.laws.materials import LinearElastic
from jaxfsi.core.laws.solid import Wall
from jaxfsi.core.laws.viscosity import Newtonian
from jaxfsi.core.ports.block import BlockPort
from jaxfsi.core.ports.pressure import PressurePort
from jaxfsi.core.step.march import march
from jaxfsi.core.step.model import Model, WallElement, build_model
from jaxfsi.core.step.state import State, initial_state
from jaxfsi.core.step.stepper import prepare
from jaxfsi.mesh import Mesh
from jaxfsi.verification.round_tube import round_tube
from jaxfsi.verification.womersley import wave_number
from lumped.blocks import Resistance
from lumped.waveforms import Sinusoid


class ElasticTube(NamedTuple):
    """An elastic tube with ν = 0 and the pressure at its inlet.

    Attributes:
        radius: of the lumen [cm].
        thickness: of the wall [cm].
        length: of the tube [cm], about half a wave.
        E: Young's modulus [dyn/cm²].
        rho_s: density of the wall [g/cm³].
        rho_f: density of the blood [g/cm³].
        mu: viscosity of the blood [g/(cm·s)].
        amplitude: of the pressure [dyn/cm²].
        period: of the wave [s].
    """

    radius: float = 0.5
    thickness: float = 0.05
    length: float = 10.0
    E: float = 3.4e6
    rho_s: float = 1.1
    rho_f: float = 1.0
    mu: float = 0.3
    amplitude: float = 100.0
    period: float = 0.05

    @property
    def exact_wave_number(self) -> complex:
        """K by theory [1/cm]."""
        return wave_number(
            2.0 * np.pi / self.period,
            radius=self.radius,
            thickness=self.thickness,
            E=self.E,
            rho_s=self.rho_s,
            rho_f=self.rho_f,
            mu=self.mu,
        )


def elastic_tube_model(
    mesh: Mesh, problem: ElasticTube, *, wall_element: WallElement = "linear"
) -> Model:
    """The problem on a mesh of `round_tube`; a resistance swallows most of the wave."""
    speed = 2.0 * np.pi / problem.period / problem.exact_wave_number.real
    resistance = problem.rho_f * speed / (np.pi * problem.radius**2)
    return build_model(
        mesh,
        {
            "inlet": PressurePort(Sinusoid(0.0, problem.amplitude, problem.period, -np.pi / 2.0)),
            "outlet": BlockPort(Resistance(resistance)),
        },
        blood=Blood(problem.rho_f, Newtonian(problem.mu)),
        wall=Wall(LinearElastic(problem.E, 0.0), problem.rho_s),
        wall_element=wall_element,
    )


def section_pressures(state: State, model: Model) -> Float[np.ndarray, " sections"]:
    """Mean pressure of the nodes of each cross-section, along the tube [dyn/cm²]."""
    wet = np.asarray(model.in_fluid)
    z, section = np.unique(np.round(np.asarray(model.x)[2, wet], 9), return_inverse=True)
    p = np.asarray(state.p)[wet]
    return np.bincount(section, p, len(z)) / np.bincount(section, minlength=len(z))


def measured_wave_number(
    p: Complex[np.ndarray, " sections"], spacing: float, *, margin: int, reach: int
) -> complex:
    """K of the pressures of equally spaced sections [1/cm].

    Args:
        p: complex amplitude in each section.
        spacing: of the sections [cm].
        margin: sections to leave out at each end.
        reach: s in sections.
    """
    inner = p[margin : len(p) - margin]
    middle = inner[reach:-reach]
    around = inner[2 * reach :] + inner[: -2 * reach]
    cosine = np.vdot(middle, around) / (2.0 * np.vdot(middle, middle))
    k = np.arccos(cosine) / (reach * spacing)
    return complex(k if k.real > 0.0 else -k)


class WaveErrors(NamedTuple):
    """Errors of a measured wave number.

    Attributes:
        speed: ω/Re k [cm/s].
        exact_speed: by theory [cm/s].
        attenuation: −Im k [1/cm].
        exact_attenuation: by theory [1/cm].
    """

    speed: float
    exact_speed: float
    attenuation: float
    exact_attenuation: float


def wave_speed(
    mesh: Mesh,
    problem: ElasticTube,
    *,
    n_quarter: int,
    n_quarters: int,
    wall_element: WallElement = "linear",
) -> WaveErrors:
    """March from rest until the wave is periodic, and measure it.

    Args:
        mesh: the tube, with equally spaced sections.
        problem: the tube.
        n_quarter: steps in a quarter of a period.
        n_quarters: quarters to march.
        wall_element: which element the wall has.
    """
    model = elastic_tube_model(mesh, problem, wall_element=wall_element)
    stepper = prepare(problem.period / (4 * n_quarter), model)
    state, pressures = initial_state(model), []
    for _ in range(n_quarters):
        state = march(model, state, stepper, n_quarter).state
        pressures.append(section_pressures(state, model))
    # Re(A e^(iωt)) now, and Im(A e^(iωt)) a quarter before: the common phase does not matter.
    p = pressures[-1] + 1j * pressures[-2]
    n = len(p) - 1
    k = measured_wave_number(p, problem.length / n, margin=n // 8, reach=n // 5)
    exact, omega = problem.exact_wave_number, 2.0 * np.pi / problem.period
    return WaveErrors(omega / k.real, omega / exact.real, -k.imag, -exact.imag)


def elastic_mesh(problem: ElasticTube, *, n_around: int = 20, columns: bool = False) -> Mesh:
    """A mesh on which the speed is right to about half a percent; its wall in columns or not."""
    return round_tube(
        radius=problem.radius,
        length=problem.length,
        thickness=problem.thickness,
        n_around=n_around,
        n_axial=40,
        n_rings=n_around // 4,
        n_layers=1,
        columns=columns,
    )
