"""A pipe that carries a pressure without having moved: its prestress against Lamé's stresses.

With radii a, b, pressure p inside and an axial strain ε in the middle::

    σ_θ, σ_r = p a²/(b² − a²) (1 ± b²/r²),   σ_z = ν (σ_θ + σ_r) + E ε

The strain is that of the displacement whose stress the prestress is. Both ends are held: near them
the pipe could not widen and would be longer, so its middle would be shorter. A thin shell of mean
radius R, thickness h and length l, whose hoop strain in the middle is ε_θ, has

    ε = −2 ν ε_θ/(β l),   β = (3 (1 − ν²))^¼/√(R h)

The wall pushes at a stress that is in balance with the pressure, whatever the elements; linear ones
give its mean through a layer, quadratic ones its course.

Source: Timoshenko & Goodier 1951, eq. 46; Timoshenko & Woinowsky-Krieger 1959, Theory of Plates and
Shells, section 114; mesh and constants are those of the case pipe_prestress of the tests of
svMultiPhysics.
"""

from collections.abc import Iterator
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxfsi.core.elements.linear import corners, geometry, total
from jaxfsi.core.elements.quadratic import FAR, NEAR
from jaxfsi.core.elements.wall import AbstractWallElement
from jaxfsi.core.laws.materials import NeoHookean
from jaxfsi.core.laws.solid import Wall, cauchy_stress
from jaxfsi.core.statics.equilibrium import Loads, pressure_load, static_factor
from jaxfsi.core.statics.prestress import prestressed
from jaxfsi.core.step.model import Model, WallElement, build_model
from jaxfsi.mesh import INTERFACE, Mesh
from jaxfsi.verification.figures import Figure, figure
from jaxfsi.verification.walls import axial_strain

E, NU, PRESSURE = 4e6, 0.49, 80_607.0
"""Young's modulus [dyn/cm²], Poisson's ratio and the pressure that was imaged [dyn/cm²]."""


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
    found = prestressed(model, loads, static_factor(model), tolerance=1e-8)
    radius = np.hypot(*mesh.points[:, :2].T)
    inner, outer = float(np.mean(radius[mesh.labelled(INTERFACE)])), float(np.max(radius))
    name = f"pipe_prestress, {wall_element} elements"
    left = float(jnp.max(jnp.abs(found.d)))
    yield figure(name, "displacement that is left, of the radius", left / inner, 0.0, 1e-4)
    r, share, stress = _middle(found.d, found.model, mesh)
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


def _middle(d: Float[Array, "3 nodes"], model: Model, mesh: Mesh) -> _Middle:
    assert model.wall is not None
    assert isinstance(model.element, AbstractWallElement)
    shape = geometry(model.x, model.solid_tets)
    stress = np.asarray(cauchy_stress(d, model.wall, model.element, shape, model.prestress))
    n_points = stress.shape[2]
    places = []
    for x in model.x:
        corner = corners(x, model.solid_tets)
        whole = np.asarray(total(corner))
        if n_points == 1:
            places.append([whole / 4.0])
        else:
            places.append([FAR * whole + (NEAR - FAR) * np.asarray(c) for c in corner])
    x, y, z = np.array(places)
    r = np.hypot(x, y)
    radial = np.stack([x / r, y / r])
    hoop = np.stack([-y / r, x / r])
    plane = stress[:2, :2]
    along = [np.einsum("igt,ijgt,jgt->gt", n, plane, n) for n in (hoop, radial)]
    along.append(stress[2, 2])
    low, high = np.quantile(mesh.points[:, 2], [0.25, 0.75])
    here = (z > low) & (z < high)
    volume = np.broadcast_to(np.asarray(shape.volume), r.shape)
    return _Middle(r[here], volume[here], np.stack([component[here] for component in along]))
