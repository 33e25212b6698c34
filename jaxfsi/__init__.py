"""Anatomy, and the fluid-structure core that shares the boundary blocks of `lumped`."""

from jaxfsi.contours import read_ivus_contours
from jaxfsi.lumen import Calipers, EllipseAxes, Lumen
