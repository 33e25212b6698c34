"""Anatomies from images, surfaces, published cohorts and parameters."""
