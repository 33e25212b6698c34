"""The names of the ends of a segmented vessel, given by points near them or by their size."""

from collections.abc import Mapping, Sequence

import numpy as np
import scipy.optimize

from jaxfsi.anatomy.surfaces.flat_ends import FlatEnd
from jaxfsi.opening import canonical_order

AORTA_INLET, AORTA_OUTLET = "aorta_inlet", "aorta_outlet"


def named_ends(
    ends: Sequence[FlatEnd], names: Mapping[str, Sequence[float]] | None, scale: float
) -> dict[str, FlatEnd]:
    """Ends by name, in the canonical order of the names.

    Args:
        ends: of the surface [cm].
        names: see `jaxfsi.anatomy.surface_anatomy`.
        scale: of the unit of these points [cm].

    Raises:
        ValueError: names and ends do not match.
    """
    named = _named_by_size(ends) if names is None else _named_by_user(ends, names, scale)
    return {name: named[name] for name in canonical_order(named)}


def _named_by_size(ends: Sequence[FlatEnd]) -> dict[str, FlatEnd]:
    ordered = sorted(ends, key=lambda end: -end.radius)
    aorta, others = ordered[:2], ordered[2:]
    if others:
        middle = np.mean([end.centre for end in others], axis=0)
        aorta.sort(key=lambda end: float(np.linalg.norm(end.centre - middle)))
    else:
        aorta.sort(key=lambda end: float(end.centre[2]))
    named = dict(zip((AORTA_INLET, AORTA_OUTLET), aorta, strict=False))
    if len(others) == 1:
        return named | {"anomalous_outlet": others[0]}
    return named | {f"coronary_outlet_{i}": end for i, end in enumerate(others, start=1)}


def _named_by_user(
    ends: Sequence[FlatEnd], names: Mapping[str, Sequence[float]], scale: float
) -> dict[str, FlatEnd]:
    if len(names) != len(ends):
        raise ValueError(
            f"{len(names)} names for {len(ends)} ends of the surface, {middles(ends, scale)}. Name"
            " every end once."
        )
    points = scale * np.array([names[name] for name in names], dtype=float)
    centres = np.array([end.centre for end in ends])
    distances = np.linalg.norm(points[:, None] - centres[None], axis=2)
    _, chosen = scipy.optimize.linear_sum_assignment(distances**2)
    for name, distance, k in zip(names, distances, chosen, strict=True):
        if distance[k] > 2.0 * ends[k].radius:
            if _fit_turned(points, centres, np.array([end.radius for end in ends])):
                raise ValueError(
                    "the points that name the ends fit the surface with the signs of x and y"
                    " changed: one is in LPS and the other in RAS. Change the signs, or give the"
                    " points as a mrk.json file of 3D Slicer and say axes."
                )
            raise ValueError(
                f"no end of the surface lies near the point given for {name!r}; they lie at"
                f" {middles(ends, scale)}. Give the middle of its end in the unit of the surface,"
                " each end under one name."
            )
    return {name: ends[k] for name, k in zip(names, chosen, strict=True)}


def middles(ends: Sequence[FlatEnd], scale: float) -> str:
    """Centres of ends as a case names them, in a unit of `scale` cm."""
    digits = 1 if scale < 1.0 else 2
    return " and ".join(
        f"[{', '.join(f'{x / scale:.{digits}f}' for x in end.centre)}]" for end in ends
    )


def _fit_turned(points: np.ndarray, centres: np.ndarray, radii: np.ndarray) -> bool:
    """Whether points name all ends once they are turned by half a turn about z."""
    distances = np.linalg.norm((points * [-1.0, -1.0, 1.0])[:, None] - centres[None], axis=2)
    rows, chosen = scipy.optimize.linear_sum_assignment(distances**2)
    return bool(np.all(distances[rows, chosen] <= 2.0 * radii[chosen]))


def inlet_of(named: Mapping[str, FlatEnd]) -> str:
    """Name of the end where blood comes in: ``aorta_inlet``, else one that says ``inlet``.

    Where no name says so, the end that would be ``aorta_inlet`` by its size.

    Args:
        named: at least one end, by name.
    """
    if AORTA_INLET in named:
        return AORTA_INLET
    found = [name for name in canonical_order(named) if "inlet" in name]
    if found:
        return found[0]
    by_size = _named_by_size([named[name] for name in canonical_order(named)])[AORTA_INLET]
    return next(name for name, end in named.items() if end is by_size)
