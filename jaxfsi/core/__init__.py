"""Finite elements of blood and wall on tetrahedra, and the coupled step in time."""
