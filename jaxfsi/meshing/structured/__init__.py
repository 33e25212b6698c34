"""Meshes of tubes and strips from prisms."""
