"""Columns of wedges from the lumen's triangles to the outer surface of the wall."""
