"""Balances and constitutive laws: blood, wall, boundaries, motion of the mesh."""
