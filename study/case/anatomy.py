"""The anatomy of a case, as its file describes it: four kinds, one of which a case may have."""

import dataclasses
import functools
import math
import pathlib
from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic.dataclasses import dataclass

from jaxfsi.anatomy.sources.parameters import PARAMETER_RANGES
from jaxfsi.anatomy.sources.parameters import SyntheticParameters as Drawn
from lumped.units import MM
from study.case.schema import Key, Location, Number, Quantity, Word, keys_of

FIRST_STATE = "rest_diastole"
"""State of contours that stand directly below [anatomy]."""

Unit = Literal["mm", "cm"]
LengthUnit = Annotated[Unit, Word(text="length unit of its coordinates")]
Point = tuple[float, float, float]

_SIZED_LINE = "CT centre line with radii: x, y, z, radius in mm as text, or VTP"


@dataclass(frozen=True)
class IvusState:
    """Files of one ultrasound pullback in one phase of the heart cycle."""

    contours: Annotated[
        pathlib.Path,
        Location(
            described="file of frame, x, y, z in mm", text="beside this file",
            example="contours.csv",
        ),
    ]  # fmt: skip
    frame_table: Annotated[
        pathlib.Path | None,
        Location(
            described="CSV file with frame, position (mm) and measurement_1 (mm)",
            text="order of the frames, and the measured tissue between aorta and coronary",
            example="frames.csv",
        ),
    ] = None
    reference_point: Annotated[
        pathlib.Path | None,
        Location(
            described="file with one line: frame, x, y, z in mm",
            text="a point on the aortic side of a frame", example="reference.csv",
        ),
    ] = None  # fmt: skip

    external_contours: Annotated[
        pathlib.Path | None,
        Location(
            described="file of frame, x, y, z in mm",
            text="external elastic membrane; the artery's wall is then as thick as measured",
            example="eem_contours.csv",
        ),
    ] = None

    @property
    def files(self) -> list[pathlib.Path]:
        """The files that are there."""
        files = (self.contours, self.frame_table, self.reference_point, self.external_contours)
        return [file for file in files if file is not None]


@dataclass(frozen=True)
class IvusAnatomy:
    """Lumen contours from intravascular ultrasound, with the centre line of the vessel from CT.

    Further pullbacks stand in tables [anatomy.states.NAME], named CONDITION_diastole or
    CONDITION_systole; one that stands directly below [anatomy] is rest_diastole.
    """

    states: Mapping[str, IvusState]
    centerline: Annotated[
        pathlib.Path | None,
        Location(
            described="CT centre line: x, y, z in mm as text, VTP with radii, or .mrk.json",
            text="a mesh needs it", example="centerline.csv",
        ),
    ] = None  # fmt: skip
    aorta_centerline: Annotated[
        pathlib.Path | None,
        Location(
            described=_SIZED_LINE,
            text="the aorta's own course and size; needs centerline",
            example="aorta_centerline.csv",
        ),
    ] = None
    aorta_radius: Annotated[
        Number | None,
        Quantity(
            "length", "mm", 3.0, 30.0, example=14.0,
            text="of a straight aorta, in place of aorta_centerline; a mesh needs either",
        ),
    ] = None  # fmt: skip
    normal_centerline: Annotated[
        pathlib.Path | None,
        Location(
            described=_SIZED_LINE,
            text="stem of the normal coronary; needs aorta_centerline",
            example="left_centerline.csv",
        ),
    ] = None
    normal_length: Annotated[
        Number | None,
        Quantity(
            "length", "mm", 3.0, 60.0, text="of that stem, from the aorta to its cut", example=10.0
        ),
    ] = None  # fmt: skip
    septum: Annotated[
        Number | None,
        Quantity(
            "length", "mm", 0.1, 10.0, example=0.8,
            text="tissue between aorta and artery, where no frame table gives it",
        ),
    ] = None  # fmt: skip
    take_off_angle: Annotated[
        Number | None,
        Quantity(
            "angle", "deg", 10.0, 90.0, example=40.0,
            text="between artery and aortic wall at the ostium",
        ),
    ] = None  # fmt: skip
    aorta_below: Annotated[
        Number | None,
        Quantity("length", "mm", 5.0, 100.0, text="aorta upstream of the ostium", example=20.0),
    ] = None
    aorta_above: Annotated[
        Number | None,
        Quantity("length", "mm", 5.0, 100.0, text="aorta downstream of the ostium", example=20.0),
    ] = None
    distal_extension: Annotated[
        Number | None,
        Quantity("length", "mm", 0.0, 50.0, text="added beyond the distal frame", example=5.0),
    ] = None
    fillet: Annotated[
        Number | None,
        Quantity("length", "mm", 0.0, 3.0, text="blend radius of the ostium's edge", example=0.6),
    ] = None
    ostium_end: Annotated[
        Literal["auto", "first", "last"] | None,
        Word(text="end of the centre line that is the ostium", example="auto"),
    ] = None
    kind: Literal["ivus"] = "ivus"

    @property
    def first(self) -> IvusState:
        """The state at rest in diastole, or the first one of the file."""
        return next(iter(self.states.values()))

    @property
    def lines(self) -> list[pathlib.Path]:
        """The files of centre lines that are there."""
        lines = (self.centerline, self.aorta_centerline, self.normal_centerline)
        return [line for line in lines if line is not None]

    @property
    def contours(self) -> pathlib.Path:
        """Contours of that state."""
        return self.first.contours


@dataclass(frozen=True)
class SyntheticAnatomy:
    """A drawn anatomy; every length and angle that is not given is the usual one of that body."""

    side: Annotated[Literal["left", "right"], Word(text="the anomalous artery")] = "right"
    body_surface_area_m2: Annotated[
        Number | None,
        Quantity(
            "body surface", "m2", 0.3, 2.8, name="body_surface_area",
            text="size of the body; absent: an adult of 1.9 m2", example=1.9,
        ),
    ] = None  # fmt: skip
    given: Mapping[str, float] = dataclasses.field(default_factory=dict)
    """Parameters of `jaxfsi.anatomy.SyntheticParameters` that are given, by name [cm, rad]."""
    kind: Literal["synthetic"] = "synthetic"


@dataclass(frozen=True)
class SurfaceCut:
    """A plane to cut a vessel that has no flat end, in the unit of the surface."""

    centre: Point
    normal: Point
    radius: float


@dataclass(frozen=True)
class SurfaceAnatomy:
    """A segmented surface of the lumen.

    The table [anatomy.openings] names vessel ends, each by a point near its middle: aorta_inlet =
    [x, y, z]; inlet and outlet (outlet_1, ...) are those of a coronary artery without the aorta,
    for simulate; one named anomalous_outlet has the pressure along its course written too. A table
    [anatomy.cuts.NAME] with centre, normal and radius cuts a vessel that has no flat end.
    """

    surface: Annotated[
        pathlib.Path,
        Location(described="STL, PLY, OBJ or VTP file of the lumen", example="lumen.stl"),
    ]
    unit: LengthUnit
    axes: Annotated[
        Literal["LPS", "RAS"] | None,
        Word(
            text="axes of the points in this file; a surface that says others is turned",
            example="LPS",
        ),
    ] = None
    openings_file: Annotated[
        pathlib.Path | None,
        Location(
            described="points of 3D Slicer (.mrk.json), one at each end, labelled with its name",
            text="in place of [anatomy.openings]", example="ends.mrk.json",
        ),
    ] = None  # fmt: skip
    smoothing_steps: Annotated[
        int | None,
        Quantity(
            "number", "", 0.0, 200.0, whole=True, text="absent: the usual number", example=10
        ),
    ] = None  # fmt: skip
    openings: Mapping[str, Point] = dataclasses.field(default_factory=dict)
    cuts: Mapping[str, SurfaceCut] = dataclasses.field(default_factory=dict)
    kind: Literal["surface"] = "surface"

    @property
    def files(self) -> list[pathlib.Path]:
        """The files that are there."""
        return [file for file in (self.surface, self.openings_file) if file is not None]


@dataclass(frozen=True)
class MeshAnatomy:
    """A finished mesh: one file or folder, or a mesh-complete folder for each region.

    The table [anatomy.labels] renames openings and surfaces: OLD = "NEW".
    """

    unit: LengthUnit
    path: Annotated[
        pathlib.Path | None,
        Location(
            folder=True, described="mesh folder, .vtu, .msh or .xdmf file", example="mesh.vtu",
            text="a folder holds fluid and solid, or is the mesh-complete folder of the blood",
        ),
    ] = None  # fmt: skip
    fluid: Annotated[
        pathlib.Path | None,
        Location(
            folder=True, described="mesh-complete folder of the blood", text="in place of path",
            example="fluid",
        ),
    ] = None  # fmt: skip
    solid: Annotated[
        pathlib.Path | None,
        Location(
            folder=True, described="mesh-complete folder of the wall", text="beside fluid",
            example="solid",
        ),
    ] = None  # fmt: skip
    labels: Mapping[str, str] = dataclasses.field(default_factory=dict)
    kind: Literal["mesh"] = "mesh"

    @property
    def places(self) -> list[pathlib.Path]:
        """The files and folders that are named."""
        return [place for place in (self.path, self.fluid, self.solid) if place is not None]


Anatomy = IvusAnatomy | SyntheticAnatomy | SurfaceAnatomy | MeshAnatomy

_UNITS = {"cm": ("length", "mm", 1.0 / MM), "rad": ("angle", "deg", 180.0 / math.pi)}


def _parameter(name: str, low: float, high: float, unit: str) -> Quantity:
    """Key of a parameter of the synthetic anatomy, in clinical units."""
    dimension, clinical, factor = _UNITS.get(unit, ("number", "", 1.0))
    if factor != 1.0:
        low, high = round(low * factor, 6), round(high * factor, 6)
    return Quantity(
        dimension, clinical, low, high, name=name, field=name, required=False,
        text=_described().get(name, ""),
    )  # fmt: skip


@functools.cache
def _described() -> dict[str, str]:
    """What `jaxfsi.anatomy.SyntheticParameters` says of each of its parameters."""
    found, name = {}, ""
    for line in (Drawn.__doc__ or "").partition("Attributes:")[2].splitlines():
        start, colon, text = line.strip().partition(": ")
        if colon and start.isidentifier():
            name, found[start] = start, text
        elif name:
            found[name] += " " + line.strip()
    return {name: text.partition(" [")[0].strip().rstrip(".") for name, text in found.items()}


STATE = keys_of(IvusState)
KINDS: dict[str, tuple[Key, ...]] = {
    "ivus": (
        *(dataclasses.replace(key, required=False) for key in STATE),
        *keys_of(IvusAnatomy),
    ),
    "synthetic": (
        *keys_of(SyntheticAnatomy),
        *(
            _parameter(name, *limits)
            for name, limits in PARAMETER_RANGES.items()
            if not name.startswith("thickness")
        ),
    ),
    "surface": keys_of(SurfaceAnatomy),
    "mesh": keys_of(MeshAnatomy),
}
"""Keys of each kind, besides its sub-tables."""

MODELS = {
    "ivus": IvusAnatomy,
    "synthetic": SyntheticAnatomy,
    "surface": SurfaceAnatomy,
    "mesh": MeshAnatomy,
}
"""The class of each kind; its docstring introduces it."""
