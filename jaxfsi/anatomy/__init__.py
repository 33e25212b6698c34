"""Anatomies: the lumen and the wall of the vessels as implicit functions with named openings."""

from jaxfsi.anatomy.anatomy import Anatomy, Centerline, Opening
