"""What is asked of a mesh, checked before any work: request, openings, bounds, values."""

from typing import NamedTuple

import numpy as np

from jaxfsi.anatomy import Anatomy, Opening
from jaxfsi.mesh import INTERFACE, OUTER_WALL, RING_SUFFIX
from jaxfsi.meshing.presets import PRESETS
from jaxfsi.meshing.volume.fill import backend_named

_MOST_ACROSS = 24
_MOST_LAYERS = 8
_MOST_WEDGE_LAYERS = 4
_LARGEST_CM = 100.0


class MeshRequest(NamedTuple):
    """What is asked of a mesh.

    Attributes:
        preset: name of a preset.
        elements_across: least number of elements across the lumen, or None.
        wall_layers: layers through the wall.
        wedge_layers: layers of wedges through the wall; 0 for tetrahedra alone.
        backend: name of a backend.
    """

    preset: str
    elements_across: int | None
    wall_layers: int
    wedge_layers: int
    backend: str


def check_demands(anatomy: Anatomy, request: MeshRequest, *, smallest: float) -> None:
    """Refuse a request or an anatomy that cannot be meshed, naming all faults.

    Args:
        anatomy: what is to be meshed.
        request: what is asked for.
        smallest: element size below which surfaces are not resolved [cm].

    Raises:
        ValueError: lists what is wrong, each with a cure.
    """
    preset, elements_across, wall_layers, wedge_layers, backend = request
    backend_named(backend)
    faults = []
    if preset not in PRESETS:
        faults.append(f"there is no preset {preset!r}; choose one of {', '.join(PRESETS)}")
    if elements_across is not None and not 2 <= elements_across <= _MOST_ACROSS:
        faults.append(f"elements_across is {elements_across}; choose 2 to {_MOST_ACROSS}")
    for name, layers, least, most in (
        ("wall_layers", wall_layers, 1, _MOST_LAYERS),
        ("wedge_layers", wedge_layers, 0, _MOST_WEDGE_LAYERS),
    ):
        if layers != int(layers) or not least <= layers <= most:
            faults.append(f"{name} is {layers}; choose {least} to {most}, a whole number")
    faults += _bounds_faults(anatomy)
    if not anatomy.openings:
        faults.append("there is no opening; cut at least one inlet and one outlet")
    for opening in anatomy.openings:
        faults += _opening_faults(anatomy, opening)
    faults += _width_faults(anatomy, smallest)
    names = [opening.name for opening in anatomy.openings]
    if len(set(names)) != len(names):
        faults.append(f"the openings are named {', '.join(names)}; give each its own name")
    if faults:
        raise ValueError(
            f"{anatomy.name!r} cannot be meshed as asked:\n"
            + "\n".join(f"  {fault}" for fault in faults)
        )


def _bounds_faults(anatomy: Anatomy) -> list[str]:
    bounds = np.asarray(anatomy.bounds, dtype=float)
    size = bounds[1] - bounds[0]
    if not np.all(np.isfinite(bounds)) or np.any(size <= 0.0):
        return [f"its bounds {bounds.tolist()} hold nothing; give lower and upper corner in cm"]
    if size.max() > _LARGEST_CM:
        return [
            f"its bounds are {size.max():.3g} cm long; lengths are in cm, so multiply lengths in"
            " mm by 0.1"
        ]
    return []


def _width_faults(anatomy: Anatomy, smallest: float) -> list[str]:
    faults = []
    for name, line in anatomy.centerlines.items():
        radius = np.asarray(anatomy.local_radius(np.asarray(line.points, dtype=float)))
        narrowest = int(np.argmin(radius))
        if radius[narrowest] < smallest:
            faults.append(
                f"the lumen of {name!r} is {2.0 * radius[narrowest]:.3g} cm wide at"
                f" s = {line.s[narrowest]:.3g} cm, thinner than two of the smallest elements"
                f" ({smallest:.3g} cm); check units, or widen the lumen there"
            )
    return faults


def _opening_faults(anatomy: Anatomy, opening: Opening) -> list[str]:
    faults = []
    name = opening.name
    if name in (INTERFACE, OUTER_WALL) or name.endswith(RING_SUFFIX):
        faults.append(f"opening {name!r} bears the name of a wall label; rename it")
    if abs(np.linalg.norm(opening.normal) - 1.0) > 1e-6:
        faults.append(f"the normal of opening {name!r} is no unit vector; divide it by its length")
    if not opening.radius > 0.0:
        faults.append(f"opening {name!r} has radius {opening.radius}; give one beyond its wall")
    values = [
        float(np.asarray(f(np.asarray(opening.centre)[None]))[0])
        for f in (anatomy.lumen, anatomy.wall)
    ]
    if not np.all(np.isfinite(values)):
        faults.append(f"lumen or wall are not finite at opening {name!r}; check the anatomy")
    elif values[0] >= 0.0:
        faults.append(
            f"the centre of opening {name!r} lies {values[0]:.3g} cm outside the lumen, so its"
            " plane misses the vessel; move the centre onto the vessel's axis"
        )
    elif values[1] >= values[0]:
        faults.append(
            f"the wall function is not below the lumen function at opening {name!r}; the wall"
            " must enclose the lumen (W < L)"
        )
    return faults
