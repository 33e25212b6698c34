"""A pipe that carries a pressure without having moved: its prestress against Lamé's stresses.

With radii a, b, pressure p inside and an axial strain ε in the middle::

    σ_θ, σ_r = p a²/(b² − a²) (1 ± b²/r²),   σ_z = ν (σ_θ + σ_r) + E ε

The strain is that of the displacement whose stress the prestress is. Both ends are held: near them
the pipe could not widen and would be longer, so its middle would be shorter. A thin shell of mean
radius R, thickness h and length l, whose hoop strain in the middle is ε_θ, has

    ε = −2 ν ε_θ/(β l),   β = (3 (1 − ν²))^¼/√(R h)

The wall pushes at a stress that is in balance with the pressure, whatever the elements; linear ones
and one layer of wedges give its mean, quadratic ones its course. Between the two points of a wedge
the radial stress does not vary, so that its hoop stress varies twice as much as it should.

Source: Timoshenko & Goodier 1951, eq. 46; Timoshenko & Woinowsky-Krieger 1959, Theory of Plates and
Shells, section 114; mesh and constants are those of the case pipe_prestress of the tests of
svMultiPhysics.
"""

from collections.abc import Iterator
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxfsi.core.elements.bending import BendingElement
from jaxfsi.core.elements.linear import corners, geometry, total
from jaxfsi.core.elements.quadratic import FAR, NEAR
from jaxfsi.core.elements.wall import AbstractWallElement
from jaxfsi.core.laws.materials import NeoHookean
from jaxfsi.core.laws.solid import Wall, cauchy_stress
from jaxfsi.core.laws.wedge_solid import wedge_stress_and_strain
from jaxfsi.core.statics.equilibrium import equilibrium, static_factor
from jaxfsi.core.statics.loads import Loads, pressure_load
from jaxfsi.core.statics.prestress import prestressed
from jaxfsi.core.step.model import Model, WallElement, build_model
from jaxfsi.mesh import INTERFACE, Mesh
from jaxfsi.meshing import ring
from jaxfsi.verification.figures import Figure, figure
from jaxfsi.verification.walls import axial_strain

E, NU, PRESSURE = 4e6, 0.49, 80_607.0
"""Young's modulus [dyn/cm²], Poisson's ratio and the pressure that was imaged [dyn/cm²]."""

RADIUS, THICKNESS, LENGTH = 2.0, 0.2, 30.0
"""Inner radius, wall thickness and length of the pipe [cm]."""


def lame_stress(
    r: Float[np.ndarray, " points"], inner: float, outer: float
) -> Float[np.ndarray, "3 points"]:
    """Hoop, radial and axial stress at radii r, without axial strain [dyn/cm²]."""
    level = PRESSURE * inner**2 / (outer**2 - inner**2)
    spread = level * outer**2 / r**2
    hoop, radial = level + spread, level - spread
    return np.stack([hoop, radial, NU * (hoop + radial)])


def shell_strain(inner: float, outer: float, length: float) -> float:
    """Axial strain in the middle of a thin shell that is held at both ends."""
    middle, thickness = (inner + outer) / 2.0, outer - inner
    hoop, radial, axial = lame_stress(np.array([middle]), inner, outer)[:, 0]
    widening = (hoop - NU * (radial + axial)) / E
    beta = (3.0 * (1.0 - NU**2)) ** 0.25 / np.sqrt(middle * thickness)
    return float(-2.0 * NU * widening / (beta * length))


def pipe_figures(mesh: Mesh, wall_element: WallElement) -> Iterator[Figure]:
    """Displacement that is left, and stresses in the middle half of a pipe along z.

    Args:
        mesh: the wall of the pipe.
        wall_element: which element.
    """
    wall = Wall(NeoHookean(E, NU), rho_s=1.1)
    model = build_model(mesh, {}, wall=wall, wall_element=wall_element)
    loads = Loads((pressure_load(mesh, INTERFACE, PRESSURE, model),))
    factor = static_factor(model)
    found = prestressed(model, loads, factor, tolerance=1e-8)
    d = equilibrium(found.model, loads, factor, tolerance=1e-8).d
    radius = np.hypot(*mesh.points[:, :2].T)
    inner, outer = float(np.mean(radius[mesh.labelled(INTERFACE)])), float(np.max(radius))
    name = f"pipe_prestress, {wall_element} elements"
    left = float(jnp.max(jnp.abs(d)))
    yield figure(name, "displacement that is left, of the radius", left / inner, 0.0, 1e-4)
    r, share, stress = _middle(d, found.model, mesh)
    exact = lame_stress(r, inner, outer)
    low, high = float(np.min(mesh.points[:, 2])), float(np.max(mesh.points[:, 2]))
    strain = axial_strain(mesh, found.e, (low + high) / 2.0, (high - low) / 2.0)
    shell = shell_strain(inner, outer, high - low)
    yield figure(name, "axial strain, and that of a thin shell", strain, shell, 0.1)
    exact[2] += E * strain
    for label, computed, right in zip(
        ("hoop", "axial"), stress[[0, 2]], exact[[0, 2]], strict=True
    ):
        mean, due = (float(np.average(each, weights=share)) for each in (computed, right))
        yield figure(name, f"{label} stress, mean [dyn/cm²]", mean, due, 0.01)
    if wall_element == "quadratic":
        ends = np.array([inner, outer])
        line = np.polynomial.Polynomial.fit(r, stress[0], 1, w=np.sqrt(share))
        for place, value, right in zip(
            ("inside", "outside"), line(ends), lame_stress(ends, inner, outer)[0], strict=True
        ):
            yield figure(name, f"hoop stress {place} [dyn/cm²]", float(value), float(right), 0.01)


class _Middle(NamedTuple):
    """Quadrature points of the middle half: radius, volume and hoop, radial, axial stress."""

    r: Float[np.ndarray, " points"]
    volume: Float[np.ndarray, " points"]
    stress: Float[np.ndarray, "3 points"]


def pipe_mesh(n_around: int, n_axial: int) -> Mesh:
    """The wall of the pipe in columns of one wedge, with the areas of round pipes."""
    angle = 2.0 * np.pi / n_around
    scale = float(np.sqrt(angle / np.sin(angle)))
    return ring(
        radius=scale * RADIUS,
        length=LENGTH,
        thickness=scale * THICKNESS,
        n_around=n_around,
        n_axial=n_axial,
        n_layers=1,
        columns=True,
    )


class _Points(NamedTuple):
    """Quadrature points: positions, Cauchy stress, and the volume of their elements."""

    x: Float[np.ndarray, "3 points elements"]
    stress: Float[np.ndarray, "3 3 points elements"]
    volume: Float[np.ndarray, " elements"]


def _wedge_points(d: Float[Array, "3 nodes"], model: Model) -> _Points:
    """Those of wedges, which make up the whole wall."""
    element, wall = model.element, model.wall
    assert wall is not None
    assert isinstance(element, BendingElement)
    wedges = element.wedges
    shape = element.geometry(model.x).wedges
    S = None if model.prestress is None else model.prestress.of_wedges
    zero = jnp.zeros_like(d)
    found = wedge_stress_and_strain(zero, d, element.in_wedges(wall), wedges, shape, S)
    nodes = np.asarray(model.x)[:, np.asarray(wedges.nodes)]
    inside, outside = np.mean(nodes[:, :3], axis=1), np.mean(nodes[:, 3:], axis=1)
    middle, half = (inside + outside) / 2.0, (outside - inside) / 2.0
    x = np.stack([middle - half / 3.0**0.5, middle + half / 3.0**0.5], axis=1)
    return _Points(x, np.asarray(found.sigma), np.asarray(shape.volume))


def _tet_points(d: Float[Array, "3 nodes"], model: Model) -> _Points:
    assert model.wall is not None
    assert isinstance(model.element, AbstractWallElement)
    shape = geometry(model.x, model.solid_tets)
    stress = np.asarray(cauchy_stress(d, model.wall, model.element, shape, model.prestress))
    places = []
    for x in model.x:
        corner = corners(x, model.solid_tets)
        whole = np.asarray(total(corner))
        if stress.shape[2] == 1:
            places.append([whole / 4.0])
        else:
            places.append([FAR * whole + (NEAR - FAR) * np.asarray(c) for c in corner])
    return _Points(np.array(places), stress, np.asarray(shape.volume))


def _middle(d: Float[Array, "3 nodes"], model: Model, mesh: Mesh) -> _Middle:
    points = _wedge_points if isinstance(model.element, BendingElement) else _tet_points
    (x, y, z), stress, volume = points(d, model)
    r = np.hypot(x, y)
    radial = np.stack([x / r, y / r])
    hoop = np.stack([-y / r, x / r])
    plane = stress[:2, :2]
    along = [np.einsum("igt,ijgt,jgt->gt", n, plane, n) for n in (hoop, radial)]
    along.append(stress[2, 2])
    low, high = np.quantile(mesh.points[:, 2], [0.25, 0.75])
    here = (z > low) & (z < high)
    volume = np.broadcast_to(volume, r.shape)
    return _Middle(r[here], volume[here], np.stack([component[here] for component in along]))
