"""Parameters of a synthetic anatomy: an aorta with one anomalous and one normal coronary.

Lengths in cm, angles in rad, cross-sections as areas and ratios of full widths. Adult sizes of the
aortic root belong to a body surface area of 1.9 m²; `scaled_anatomy` turns an adult into a child.
"""

import dataclasses
import math
from collections.abc import Iterator
from typing import Any, Literal, NamedTuple

from lumped.units import MM

Side = Literal["left", "right"]
Number = Any
"""A float, or an array where a result is differentiated by it; this module does without JAX."""

ADULT_SURFACE_AREA_M2 = 1.9

# The arc that leads into the wall must be wider than the lumen that follows it.
_BEND_PER_HALF_WIDTH = 1.6
_LEAST_BEND = 0.1  # [cm]


@dataclasses.dataclass(frozen=True)
class SyntheticParameters:
    """An aortic root with a normal and an anomalous coronary artery.

    The anomalous artery of side ``right`` (a right coronary) springs from the left sinus near its
    border to the right one, that of side ``left`` the other way round; it runs between aorta and
    pulmonary artery inside the aortic wall, then leaves it. Heights are measured along the aortic
    axis from the annulus. Every field may be varied; ``side`` is a choice.

    Attributes:
        side: which coronary artery is anomalous.
        annulus_radius: of the aortic lumen at the annulus and in the outflow tract [cm].
        sinus_radius: mean radius at the widest place of the sinuses [cm].
        junction_radius: at the sinotubular junction [cm].
        tube_radius: of the ascending aorta [cm].
        sinus_height: height of the widest place of the sinuses [cm].
        junction_height: height of the sinotubular junction [cm].
        aorta_length: from annulus to aortic outlet [cm].
        inflow_length: of outflow tract below the annulus [cm].
        lobe_depth: amplitude of the three sinus lobes over the radius there.
        bend_angle: by which the ascending aorta turns from the annulus to the outlet [rad].
        ostium_height: of the anomalous ostium [cm].
        ostium_angle: between the anomalous ostium and the border of the sinuses, about the aortic
            axis [rad].
        take_off_angle: between the artery's axis and the aortic wall at the ostium [rad].
        course_angle: by which the intramural course descends from the horizontal [rad].
        intramural_length: from the ostium to where the artery starts to leave the wall [cm].
        septum: least thickness of tissue between the two lumens along the intramural course [cm].
        ostium_major: width of the anomalous ostium along the wall, across the artery [cm].
        ostium_minor: width of the anomalous ostium across the wall [cm].
        hypoplasia: area of the intramural lumen over the distal reference area.
        ellipticity: major over minor width of the intramural lumen.
        reference_radius: of the anomalous artery beyond its intramural course [cm].
        distal_length: from the end of the intramural course to the anomalous outlet [cm].
        normal_radius: of the normal coronary artery [cm].
        normal_height: of its ostium [cm].
        normal_angle: between its ostium and the border of the sinuses [rad].
        normal_length: from its ostium to its outlet [cm].
        thickness_per_radius: wall thickness over radius, within the two limits.
        thickness_minimum: least wall thickness [cm].
        thickness_maximum: greatest wall thickness [cm].
    """

    side: Side = "right"
    annulus_radius: float = 1.05
    sinus_radius: float = 1.32
    junction_radius: float = 1.12
    tube_radius: float = 1.20
    sinus_height: float = 0.9
    junction_height: float = 1.8
    aorta_length: float = 4.5
    inflow_length: float = 0.6
    lobe_depth: float = 0.06
    bend_angle: float = 0.5
    ostium_height: float = 1.9
    ostium_angle: float = 0.35
    take_off_angle: float = math.radians(25.0)
    course_angle: float = 0.15
    intramural_length: float = 1.0
    septum: float = 0.06
    ostium_major: float = 0.46
    ostium_minor: float = 0.17
    hypoplasia: float = 0.5
    ellipticity: float = 2.4
    reference_radius: float = 0.19
    distal_length: float = 1.6
    normal_radius: float = 0.19
    normal_height: float = 1.3
    normal_angle: float = 1.25
    normal_length: float = 1.5
    thickness_per_radius: float = 0.125
    thickness_minimum: float = 0.05
    thickness_maximum: float = 0.15

    @property
    def reference_area(self) -> float:
        """Area of the anomalous artery beyond its intramural course [cm²]."""
        return math.pi * self.reference_radius**2

    @property
    def intramural_area(self) -> float:
        """Area of the intramural lumen [cm²]."""
        return self.hypoplasia * self.reference_area

    @property
    def intramural_half_axes(self) -> tuple[float, float]:
        """Half axes of the intramural lumen along and across the wall [cm]."""
        minor = math.sqrt(self.intramural_area / (math.pi * self.ellipticity))
        return self.ellipticity * minor, minor


_LENGTH = "cm"
PARAMETER_RANGES: dict[str, tuple[float, float, str]] = {
    "annulus_radius": (0.3, 2.5, _LENGTH),
    "sinus_radius": (0.35, 3.0, _LENGTH),
    "junction_radius": (0.3, 2.6, _LENGTH),
    "tube_radius": (0.3, 3.0, _LENGTH),
    "sinus_height": (0.2, 2.5, _LENGTH),
    "junction_height": (0.4, 4.0, _LENGTH),
    "aorta_length": (1.5, 12.0, _LENGTH),
    "inflow_length": (0.1, 3.0, _LENGTH),
    "lobe_depth": (0.0, 0.15, ""),
    "bend_angle": (0.0, 1.2, "rad"),
    "ostium_height": (0.3, 6.0, _LENGTH),
    "ostium_angle": (-0.5, 1.2, "rad"),
    "take_off_angle": (math.radians(14.9), math.radians(80.0), "rad"),
    "course_angle": (-0.6, 0.6, "rad"),
    "intramural_length": (0.15, 3.0, _LENGTH),
    "septum": (0.025, 0.2, _LENGTH),
    "ostium_major": (0.06, 0.9, _LENGTH),
    "ostium_minor": (0.05, 0.5, _LENGTH),
    "hypoplasia": (0.08, 1.2, ""),
    "ellipticity": (1.0, 5.5, ""),
    "reference_radius": (0.06, 0.35, _LENGTH),
    "distal_length": (0.8, 5.0, _LENGTH),
    "normal_radius": (0.06, 0.35, _LENGTH),
    "normal_height": (0.3, 6.0, _LENGTH),
    "normal_angle": (0.6, 1.8, "rad"),
    "normal_length": (0.5, 5.0, _LENGTH),
    "thickness_per_radius": (0.03, 0.5, ""),
    "thickness_minimum": (0.02, 0.15, _LENGTH),
    "thickness_maximum": (0.04, 0.4, _LENGTH),
}
"""Least and greatest value of each parameter, and its unit."""


class ParameterFault(NamedTuple):
    """One thing wrong with the parameters of an anatomy.

    Attributes:
        name: of the parameter.
        value: that it has.
        allowed: what it may be.
        cure: what to change.
    """

    name: str
    value: object
    allowed: str
    cure: str

    def __str__(self) -> str:
        value = f"{self.value:.4g}" if isinstance(self.value, float) else repr(self.value)
        return f"{self.name} = {value}, allowed {self.allowed}: {self.cure}"


class Approach(NamedTuple):
    """How the axis of the anomalous artery gets from the ostium to its depth in the wall.

    Attributes:
        bend: radius of the arc that turns it parallel to the wall [cm].
        s_arc: arc length from the ostium at which the arc begins [cm]; negative where the ostium
            lies on the arc.
        s_parallel: arc length at which it runs parallel to the wall [cm].
    """

    bend: float
    s_arc: float
    s_parallel: float


def approach(p: SyntheticParameters) -> Approach:
    """Straight rise at the take-off angle α and an arc of radius ρ to the depth D.

    Over the arc the depth grows by ρ (1 − cos α); the rest is straight, (D − ρ (1 − cos α))/sin α.
    """
    alpha, minor = p.take_off_angle, p.intramural_half_axes[1]
    level = p.septum + minor
    bend = max(_BEND_PER_HALF_WIDTH * max(minor, p.ostium_minor / 2.0), _LEAST_BEND)
    arc_depth = bend * (1.0 - math.cos(alpha))
    if arc_depth < level:
        s_arc = (level - arc_depth) / math.sin(alpha)
    else:
        s_arc = -bend * (alpha - math.acos(1.0 - level / bend))
    return Approach(bend, s_arc, s_arc + bend * alpha)


def shortest_intramural_length(p: SyntheticParameters) -> float:
    """Least intramural length [cm]: the approach to its depth, and half that depth of plateau."""
    return approach(p).s_parallel + 0.5 * (p.septum + p.intramural_half_axes[1])


def _range_faults(p: SyntheticParameters) -> Iterator[ParameterFault]:
    if p.side not in ("left", "right"):
        yield ParameterFault("side", p.side, "left or right", "name one of them")
    for name, (low, high, unit) in PARAMETER_RANGES.items():
        value = getattr(p, name)
        if not low <= value <= high:
            cure = "bring it into this range; lengths are in cm and angles in rad"
            yield ParameterFault(name, value, f"{low:.4g}..{high:.4g} {unit}".strip(), cure)


def _wall_faults(p: SyntheticParameters) -> Iterator[ParameterFault]:
    if p.thickness_minimum > p.thickness_maximum:
        yield ParameterFault(
            "thickness_minimum",
            p.thickness_minimum,
            f"at most thickness_maximum = {p.thickness_maximum:.4g} cm",
            "exchange the limits",
        )
    for name in ("reference_radius", "normal_radius"):
        radius = getattr(p, name)
        thickness = max(p.thickness_minimum, p.thickness_per_radius * radius)
        if thickness > radius:
            yield ParameterFault(
                "thickness_minimum",
                p.thickness_minimum,
                f"at most {name} = {radius:.4g} cm",
                "thin the wall or widen the vessel: a wall thicker than the radius is not meant",
            )


def _place_faults(p: SyntheticParameters) -> Iterator[ParameterFault]:
    if not p.sinus_height < p.junction_height < p.aorta_length - 0.5:
        yield ParameterFault(
            "junction_height",
            p.junction_height,
            f"between sinus_height = {p.sinus_height:.4g} and aorta_length - 0.5 ="
            f" {p.aorta_length - 0.5:.4g} cm",
            "order the heights from the annulus upwards",
        )
    for name, major in (("ostium_height", p.ostium_major), ("normal_height", p.normal_radius)):
        low, high = major, p.aorta_length - major
        if not low <= getattr(p, name) <= high:
            yield ParameterFault(
                name,
                getattr(p, name),
                f"{low:.4g}..{high:.4g} cm",
                "the artery would never touch the aorta; move its ostium or lengthen the aorta",
            )


def _course_faults(p: SyntheticParameters) -> Iterator[ParameterFault]:
    if p.ostium_major < p.ostium_minor:
        yield ParameterFault(
            "ostium_major",
            p.ostium_major,
            f"at least ostium_minor = {p.ostium_minor:.4g} cm",
            "exchange the two widths",
        )
    half_major, _ = p.intramural_half_axes
    if max(half_major, p.ostium_major / 2.0) > 0.45 * p.junction_radius:
        yield ParameterFault(
            "ellipticity",
            p.ellipticity,
            f"half widths up to 0.45 junction_radius = {0.45 * p.junction_radius:.4g} cm",
            "the slit is too wide for this aorta; lower the ellipticity or the ostium_major",
        )
    shortest = shortest_intramural_length(p)
    if p.intramural_length < shortest:
        yield ParameterFault(
            "intramural_length",
            p.intramural_length,
            f"at least {shortest:.4g} cm at this take-off angle, depth and septum",
            "the lumens would stay fused along the whole course; lengthen it, steepen the"
            " take-off or thin the septum",
        )
    sweep = p.intramural_length / p.junction_radius
    if sweep > math.pi:
        yield ParameterFault(
            "intramural_length",
            p.intramural_length,
            f"at most {math.pi * p.junction_radius:.4g} cm",
            "the course would run more than half way round the aorta",
        )


def parameter_faults(p: SyntheticParameters) -> list[ParameterFault]:
    """Everything that is wrong with a set of parameters; empty where it describes an anatomy."""
    faults = list(_range_faults(p))
    if faults:
        return faults
    return [*_wall_faults(p), *_place_faults(p), *_course_faults(p)]


def check_parameters(p: SyntheticParameters) -> None:
    """Refuse parameters that describe no anatomy.

    Raises:
        ValueError: one line for each fault: name, value, allowed range, cure.
    """
    faults = parameter_faults(p)
    if faults:
        lines = "\n".join(f"  {fault}" for fault in faults)
        raise ValueError(f"these parameters describe no anatomy:\n{lines}")


def adult_anatomy(side: Side = "right") -> SyntheticParameters:
    """A typical adult (body surface area 1.9 m²) with an anomalous artery of the given side."""
    return SyntheticParameters(side=side)


_AORTIC = (
    "annulus_radius sinus_radius junction_radius tube_radius sinus_height junction_height"
    " aorta_length inflow_length ostium_height normal_height"
).split()
_CORONARY = (
    "intramural_length ostium_major ostium_minor reference_radius distal_length normal_radius"
    " normal_length"
).split()
_LEAST_DISTAL_LENGTH = 1.2  # the reference area is taken 1 cm beyond the intramural course


def coronary_diameter(side: Side, body_surface_area_m2: Number) -> Number:
    """Normal diameter of a main coronary artery [cm] (Dallaire & Dahdah 2011, JASE 24:60).

    Left main: −0.182 + 2.924 √BSA mm; right: −0.304 + 2.752 √BSA mm, BSA in m².
    """
    root = body_surface_area_m2**0.5
    return (-0.182 + 2.924 * root if side == "left" else -0.304 + 2.752 * root) * MM


def coronary_diameter_sd(side: Side, body_surface_area_m2: Number) -> Number:
    """Standard deviation of that diameter [cm], from the same source.

    Left main: 0.180 + 0.253 √BSA mm; right: 0.163 + 0.288 √BSA mm.
    """
    root = body_surface_area_m2**0.5
    return (0.180 + 0.253 * root if side == "left" else 0.163 + 0.288 * root) * MM


def scaled_anatomy(p: SyntheticParameters, body_surface_area_m2: float) -> SyntheticParameters:
    """An adult's anatomy at another body size.

    The aorta scales with √(body surface area), the coronary arteries like the normal diameter of
    the anomalous one. Septum and wall limits shrink half as much (as the square root of the
    scale): small vessels have relatively thicker walls, and a mesh must still resolve them.

    Args:
        p: anatomy at the adult body surface area of 1.9 m².
        body_surface_area_m2: wanted body surface area [m²].

    Raises:
        ValueError: the body surface area lies outside 0.3..2.8 m².
    """
    if not 0.3 <= body_surface_area_m2 <= 2.8:
        raise ValueError(
            f"body surface area {body_surface_area_m2:g} m² lies outside 0.3..2.8. Give it in m²."
        )
    aortic = math.sqrt(body_surface_area_m2 / ADULT_SURFACE_AREA_M2)
    coronary = coronary_diameter(p.side, body_surface_area_m2) / coronary_diameter(
        p.side, ADULT_SURFACE_AREA_M2
    )
    changes = {name: getattr(p, name) * aortic for name in _AORTIC}
    changes |= {name: getattr(p, name) * coronary for name in _CORONARY}
    for name in ("thickness_minimum", "thickness_maximum", "septum"):
        changes[name] = getattr(p, name) * math.sqrt(coronary)
    changes["distal_length"] = max(changes["distal_length"], _LEAST_DISTAL_LENGTH)
    return dataclasses.replace(p, **changes)


def paediatric_anatomy(
    side: Side = "right", body_surface_area_m2: float = 1.2
) -> SyntheticParameters:
    """A child or adolescent of given body surface area [m²]; see `scaled_anatomy`."""
    return scaled_anatomy(SyntheticParameters(side=side), body_surface_area_m2)
