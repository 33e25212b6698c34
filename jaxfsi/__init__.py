"""Anatomy, and the fluid-structure finite-element core that shares the boundary blocks of `lumped`."""
