"""Static equilibrium of the wall, and prestress."""
