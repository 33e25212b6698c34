"""Presets of a mesh: how many tetrahedra it aims at, and how many at least cross the lumen."""

from typing import NamedTuple


class Preset(NamedTuple):
    """How fine a mesh is.

    Attributes:
        tets: tetrahedra that it aims at; narrow lumens may add to them.
        across: least number of elements across the width of the lumen; None: two to three.
    """

    tets: int
    across: int | None


PRESETS = {
    "coarse": Preset(30_000, None),
    "medium": Preset(150_000, 6),
    "fine": Preset(500_000, 8),
}
"""Presets by name."""
