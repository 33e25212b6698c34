"""What documents hold of meshes, as plain classes; it is kept with each mesh in the cache."""

import dataclasses

from study.store.json_form import ABSENT, Absent


@dataclasses.dataclass(frozen=True)
class MeshNote:
    """A remark on a mesh.

    Attributes:
        level: `warning` where the mesh misses what was asked for, else `info`.
        text: the remark.
    """

    level: str
    text: str


@dataclasses.dataclass(frozen=True)
class MeshSettings:
    """What was asked of a mesh.

    Attributes:
        preset: its size, `coarse`, `medium` or `fine`.
        elements_across: least number of elements across the lumen; None: as the preset gives.
        wall_layers: layers of elements through the wall.
        backend: mesher of the volumes.
        wedge_layers: layers of wedges through the wall; 0 for tetrahedra alone.
    """

    preset: str
    elements_across: int | None
    wall_layers: int
    backend: str
    wedge_layers: int | Absent = ABSENT


@dataclasses.dataclass(frozen=True)
class MeshFault:
    """One thing wrong with a mesh.

    Attributes:
        what: what is wrong.
        where: the surface or region, and a position if there is one.
        cure: what to try.
    """

    what: str
    where: str
    cure: str


@dataclasses.dataclass(frozen=True)
class Topology:
    """Topology of a mesh.

    Attributes:
        euler: Euler characteristic of the boundary of the `lumen`, the `wall`, and both (`outer`).
        n_components: pieces of each region.
        volume_cm3: volume of each region from its tetrahedra.
        volume_from_faces_cm3: the same from its labelled faces.
        faults: all that is wrong.
    """

    euler: dict[str, int]
    n_components: dict[str, int]
    volume_cm3: dict[str, float]
    volume_from_faces_cm3: dict[str, float]
    faults: list[MeshFault]


@dataclasses.dataclass(frozen=True)
class MeasureSpread:
    """How a measure is distributed over elements or places, in the unit of its key.

    Attributes:
        minimum: least value.
        p1: 1st percentile.
        median: the median.
        p99: 99th percentile.
        maximum: largest value.
    """

    minimum: float
    p1: float
    median: float
    p99: float
    maximum: float


@dataclasses.dataclass(frozen=True)
class CrossingEdges:
    """Edges that cross a region in one go.

    Attributes:
        wall: through the wall from the lumen to the outside.
        septum: through the wall from lumen to lumen.
        lumen: through the blood from wall to wall.
        single_layer_tets: tetrahedra of the wall with all nodes on its surfaces.
    """

    wall: int
    septum: int
    lumen: int
    single_layer_tets: int


@dataclasses.dataclass(frozen=True)
class MeshWedges:
    """Wedges of the wall.

    Attributes:
        number: of wedges.
        volume_share: part of the volume of the wall that they fill [-].
        min_dihedral_deg: smallest angle between two faces of each.
        scaled_jacobian: least of the six corners of each [-].
    """

    number: int
    volume_share: float
    min_dihedral_deg: MeasureSpread
    scaled_jacobian: MeasureSpread


@dataclasses.dataclass(frozen=True)
class MeshQuality:
    """Size of a mesh and shape of its elements.

    Attributes:
        n_nodes: number of nodes.
        n_tets: tetrahedra of each region.
        volume_cm3: volume of each region.
        area_cm2: area under each label.
        measures: spread of each measure by region: `min_dihedral_deg`, `max_dihedral_deg`,
            `aspect_ratio`, `scaled_jacobian`, `edge_cm`.
        wall_thickness_cm: thickness between lumen and outside; None without a wall.
        septum_thickness_cm: thickness between two parts of the lumen; None where there is none.
        through_edges: edges that cross a region in one go.
        wedges: those of the wall; None where tetrahedra alone fill it.
    """

    n_nodes: int
    n_tets: dict[str, int]
    volume_cm3: dict[str, float]
    area_cm2: dict[str, float]
    measures: dict[str, dict[str, MeasureSpread]]
    wall_thickness_cm: MeasureSpread | None
    septum_thickness_cm: MeasureSpread | None
    through_edges: CrossingEdges
    wedges: MeshWedges | Absent | None = ABSENT


@dataclasses.dataclass(frozen=True)
class MeshFidelity:
    """A mesh against the anatomy that it was made from.

    Attributes:
        wall_ratio: thickness of the wall over that of the anatomy [-]; None without a wall.
        septum_ratio: the same where the wall parts two lumens [-]; None where it never does.
        elements_across: local width of the lumen over the mean edge of the blood's elements [-].
    """

    wall_ratio: MeasureSpread | None
    septum_ratio: MeasureSpread | None
    elements_across: MeasureSpread


@dataclasses.dataclass(frozen=True)
class LabelFaces:
    """A label of the boundary.

    Attributes:
        faces: number of its faces.
        colour: its colour in the pictures.
    """

    faces: int
    colour: str


@dataclasses.dataclass(frozen=True)
class Outlines:
    """Outlines of the lumen at a place, turned so that the side away from the aorta is up.

    Attributes:
        s_mm: distance from the ostium.
        error: relative error of the area [-].
        asked_mm: outline asked for, straight pieces as x0, y0, x1, y1.
        meshed_mm: outline of the mesh, likewise.
    """

    s_mm: float
    error: float
    asked_mm: list[list[float]]
    meshed_mm: list[list[float]]


@dataclasses.dataclass(frozen=True)
class VesselAreas:
    """Areas of the lumen along a vessel.

    Attributes:
        vessel: name of the vessel.
        s_mm: distance from its start.
        asked_mm2: area asked for.
        meshed_mm2: area of the mesh.
        largest_error: largest relative error [-].
        open_places: number of planes that find no closed lumen.
        outlines: of the anomalous artery, at some places.
    """

    vessel: str
    s_mm: list[float]
    asked_mm2: list[float]
    meshed_mm2: list[float]
    largest_error: float
    open_places: int
    outlines: list[Outlines]


@dataclasses.dataclass(frozen=True)
class Histogram:
    """Counts of a measure.

    Attributes:
        edges: ends of the intervals, in the unit of the measure.
        counts: number of elements or places in each, by region or part.
    """

    edges: list[float]
    counts: dict[str, list[int]]


@dataclasses.dataclass(frozen=True)
class StateReport:
    """The mesh of a state of the anatomy.

    Attributes:
        state: name of the state.
        kind: kind of the anatomy.
        settings: what was asked for; None for a finished mesh.
        topology: its topology.
        quality: its size and the shape of its elements.
        fidelity: how it keeps to the anatomy; None for a finished mesh.
        wall_time_s: wall time of each stage.
        retries: why earlier attempts were given up.
        openings: names of the openings.
        labels: labels of the boundary by name.
        sections: areas of the lumen along each vessel.
        histograms: of `min_dihedral_deg`, and of `thickness_mm` where there is a wall.
        pictures: names of the pictures.
        picture_note: why there are none; None where there are.
        notes: what was asked for but could not be had.
    """

    state: str
    kind: str
    settings: MeshSettings | None
    topology: Topology
    quality: MeshQuality
    fidelity: MeshFidelity | None
    wall_time_s: dict[str, float]
    retries: list[str]
    openings: list[str]
    labels: dict[str, LabelFaces]
    sections: list[VesselAreas]
    histograms: dict[str, Histogram]
    pictures: list[str]
    picture_note: str | None
    notes: list[str] | Absent = ABSENT


@dataclasses.dataclass(frozen=True)
class MeshPart:
    """Meshes in the document of a command that makes them.

    Attributes:
        preset: size that was asked for.
        unit: unit of the lengths in the mesh files.
        notes: what looks wrong or needs care, warnings first.
        states: the mesh of each state.
    """

    preset: str
    unit: str
    notes: list[MeshNote]
    states: dict[str, StateReport]


@dataclasses.dataclass(frozen=True)
class MeshFailure:
    """A mesh that could not be made.

    Attributes:
        failure: why.
    """

    failure: str
