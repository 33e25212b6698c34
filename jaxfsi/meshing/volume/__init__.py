"""Tetrahedra between surfaces."""
