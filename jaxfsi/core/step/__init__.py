"""The coupled step in time: its unknowns, its equations, and the march."""
