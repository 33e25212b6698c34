"""Tetrahedra of blood and wall, and their assembly."""
