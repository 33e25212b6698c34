"""The anatomy of a case, as its file describes it: four kinds, one of which a case may have."""

import dataclasses
import pathlib
from collections.abc import Mapping
from typing import Literal

FIRST_STATE = "rest_diastole"
"""State of contours that stand directly below [anatomy]."""

Unit = Literal["mm", "cm"]
Point = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class IvusState:
    """Files of one ultrasound pullback in one phase of the heart cycle.

    Attributes:
        contours: tab-separated frame, x, y, z in mm.
        frame_table: order of the frames and measured tissue, if there is one.
        reference_point: a point on the aortic side of a frame, if there is one.
    """

    contours: pathlib.Path
    frame_table: pathlib.Path | None = None
    reference_point: pathlib.Path | None = None

    @property
    def files(self) -> list[pathlib.Path]:
        """The files that are there."""
        files = (self.contours, self.frame_table, self.reference_point)
        return [file for file in files if file is not None]


@dataclasses.dataclass(frozen=True)
class IvusAnatomy:
    """Lumen contours from intravascular ultrasound; None where a default is meant.

    Attributes:
        states: pullbacks by name of the state, the one at rest in diastole first.
        centerline: file of the centre line of the vessel from CT.
        aorta_radius: radius of the aorta at the ostium [cm].
        septum: tissue between the lumens [cm], where the frame table does not tell.
        take_off_angle: angle between artery and aortic wall at the ostium [rad].
        aorta_below: length of aorta upstream of the ostium [cm].
        aorta_above: length of aorta downstream of the ostium [cm].
        distal_extension: length added beyond the distal frame [cm].
        fillet: blend radius of the edge of the ostium [cm].
        ostium_end: which end of the centre line is the ostium.
    """

    states: Mapping[str, IvusState]
    centerline: pathlib.Path | None = None
    aorta_radius: float | None = None
    septum: float | None = None
    take_off_angle: float | None = None
    aorta_below: float | None = None
    aorta_above: float | None = None
    distal_extension: float | None = None
    fillet: float | None = None
    ostium_end: Literal["auto", "first", "last"] | None = None
    kind: Literal["ivus"] = "ivus"

    @property
    def first(self) -> IvusState:
        """The state at rest in diastole, or the first one of the file."""
        return next(iter(self.states.values()))

    @property
    def contours(self) -> pathlib.Path:
        """Contours of that state."""
        return self.first.contours


@dataclasses.dataclass(frozen=True)
class SyntheticAnatomy:
    """A drawn anatomy.

    Attributes:
        side: the anomalous artery.
        body_surface_area_m2: size of the body [m²]; None is an adult of 1.9 m².
        given: parameters of `jaxfsi.anatomy.SyntheticAnatomy` that differ from the usual ones of
            that body, by name [cm, rad].
    """

    side: Literal["left", "right"] = "right"
    body_surface_area_m2: float | None = None
    given: Mapping[str, float] = dataclasses.field(default_factory=dict)
    kind: Literal["synthetic"] = "synthetic"


@dataclasses.dataclass(frozen=True)
class SurfaceCut:
    """A plane to cut a vessel that has no flat end, in the unit of the surface."""

    centre: Point
    normal: Point
    radius: float


@dataclasses.dataclass(frozen=True)
class SurfaceAnatomy:
    """A segmented surface of the lumen.

    Attributes:
        surface: STL, PLY, OBJ or VTP file.
        unit: length unit of its coordinates.
        smoothing_steps: steps of smoothing; None: the usual number.
        openings: a point near the middle of each vessel end, by the name it shall have [unit].
        cuts: further openings, by name.
    """

    surface: pathlib.Path
    unit: Unit
    smoothing_steps: int | None = None
    openings: Mapping[str, Point] = dataclasses.field(default_factory=dict)
    cuts: Mapping[str, SurfaceCut] = dataclasses.field(default_factory=dict)
    kind: Literal["surface"] = "surface"


@dataclasses.dataclass(frozen=True)
class MeshAnatomy:
    """A finished mesh: one file or folder, or a mesh-complete folder for each region.

    Attributes:
        unit: length unit of its coordinates.
        path: vtu, msh or xdmf file; or a folder that holds ``fluid`` and ``solid``, or that is
            itself the mesh-complete folder of the blood.
        fluid: mesh-complete folder of the blood, in place of ``path``.
        solid: mesh-complete folder of the wall.
        labels: new label by name in the file: of an opening, a surface group or a surface file.
    """

    unit: Unit
    path: pathlib.Path | None = None
    fluid: pathlib.Path | None = None
    solid: pathlib.Path | None = None
    labels: Mapping[str, str] = dataclasses.field(default_factory=dict)
    kind: Literal["mesh"] = "mesh"

    @property
    def places(self) -> list[pathlib.Path]:
        """The files and folders that are named."""
        return [place for place in (self.path, self.fluid, self.solid) if place is not None]


Anatomy = IvusAnatomy | SyntheticAnatomy | SurfaceAnatomy | MeshAnatomy
