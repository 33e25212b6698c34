"""Anatomy, and the fluid-structure core that shares the boundary blocks of `lumped`."""
