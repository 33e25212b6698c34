"""Length units of mesh files: declared by the caller, checked, never guessed."""

import numpy as np
from jaxtyping import Float

from jaxfsi.mesh_files.refusal import MeshFileError
from lumped.units import MM

Unit = str
"""Length unit of a file, a key of `UNITS_CM`."""

UNITS_CM: dict[str, float] = {"cm": 1.0, "mm": MM}
"""Length units of files [cm]."""

SMALLEST_VESSEL_CM = 0.3
LARGEST_VESSEL_CM = 40.0


def check_unit(unit: str) -> None:
    """Refuse a unit that is not known.

    Raises:
        MeshFileError: the unit is neither ``"cm"`` nor ``"mm"``.
    """
    if unit not in UNITS_CM:
        raise MeshFileError(f"lengths in {unit!r} are not known. Declare unit='cm' or unit='mm'.")


def check_stored_unit(unit: str, stored: object, path: object) -> None:
    """Refuse a declared unit that contradicts what the file says about itself.

    Raises:
        MeshFileError: the two differ.
    """
    if stored is not None and stored != unit:
        raise MeshFileError(
            f"{path} says that its lengths are in {stored}, but unit={unit!r} was declared."
            f" Declare unit={stored!r}."
        )


def check_extent(points: Float[np.ndarray, "nodes 3"], unit: str, path: object) -> None:
    """Refuse points whose extent cannot be that of a vessel in the declared unit.

    Args:
        points: positions in the unit of the file.
        unit: unit declared for the file.
        path: for the message.

    Raises:
        MeshFileError: coordinates that are no finite numbers, or the longest side of the bounding
            box is below 0.3 cm or above 40 cm.
    """
    if len(points) == 0:
        raise MeshFileError(f"{path} has no points. Write the mesh again.")
    bad = int(np.sum(~np.isfinite(points)))
    if bad:
        raise MeshFileError(
            f"{path} has coordinates that are not finite numbers, {bad} of {points.size}. Write the"
            " mesh again."
        )
    extent = float(np.max(np.ptp(points, axis=0)))
    if SMALLEST_VESSEL_CM <= extent * UNITS_CM[unit] <= LARGEST_VESSEL_CM:
        return
    readings = ", ".join(f"{extent * cm:.4g} cm if in {name}" for name, cm in UNITS_CM.items())
    raise MeshFileError(
        f"{path} spans {extent:.4g} {unit} as declared, that is {readings}; a vessel spans"
        f" {SMALLEST_VESSEL_CM} to {LARGEST_VESSEL_CM:g} cm. Declare the other unit, or scale"
        " the mesh."
    )
