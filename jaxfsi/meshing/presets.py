"""Presets of a mesh: how many tetrahedra it aims at."""

PRESETS = {"coarse": 30_000, "medium": 150_000, "fine": 500_000}
"""Tetrahedra by name."""
