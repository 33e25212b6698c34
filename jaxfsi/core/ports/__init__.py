"""Boundary conditions of the 3D domain, one class in one file each; `port` is the interface."""
