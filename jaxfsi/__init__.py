"""Anatomy, and the fluid-structure finite-element core that shares the boundary blocks of `lumped`."""

from jaxfsi.contours import read_ivus_contours as read_ivus_contours
from jaxfsi.lumen import Calipers as Calipers
from jaxfsi.lumen import EllipseAxes as EllipseAxes
from jaxfsi.lumen import Lumen as Lumen
