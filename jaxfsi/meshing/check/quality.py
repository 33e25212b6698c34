"""Quality of a mesh in a table: shape of elements, layers through the wall, thickness, volumes."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxfsi.faces import boundary_of, find_rows, tet_edges, triangle_edges, unique_rows
from jaxfsi.measures import edge_lengths, triangle_areas
from jaxfsi.mesh import INTERFACE, RING_SUFFIX, Mesh, Region, tet_volumes
from jaxfsi.meshing.check.tet_quality import tet_quality
from jaxfsi.meshing.check.thickness import wall_thickness
from jaxfsi.meshing.check.wedge_quality import wedge_quality


class Distribution(NamedTuple):
    """How a measure is distributed over elements or places."""

    minimum: float
    p1: float
    median: float
    p99: float
    maximum: float


class ThroughEdges(NamedTuple):
    """Edges that cross a region in one go, where a single layer of elements fills it.

    Attributes:
        wall: edges through the solid from the interface to its outside.
        septum: edges through the solid from the interface to the interface.
        lumen: edges through the fluid from the interface to the interface.
        single_layer_tets: solid tetrahedra with all four nodes on the interface or the outside.
    """

    wall: int
    septum: int
    lumen: int
    single_layer_tets: int


class Wedges(NamedTuple):
    """Wedges of the wall.

    Attributes:
        number: of wedges.
        volume_share: part of the volume of the wall that they fill.
        min_dihedral_deg: smallest angle between two faces of each [degrees].
        scaled_jacobian: least of the six corners of each; 1 for an upright wedge on an
            equilateral triangle.
    """

    number: int
    volume_share: float
    min_dihedral_deg: Distribution
    scaled_jacobian: Distribution

    def to_dict(self) -> dict[str, object]:
        """Plain values for a JSON file."""
        return {
            "number": self.number,
            "volume_share": self.volume_share,
            "min_dihedral_deg": self.min_dihedral_deg._asdict(),
            "scaled_jacobian": self.scaled_jacobian._asdict(),
        }


@dataclasses.dataclass(frozen=True)
class Quality:
    """Quality of a mesh.

    Attributes:
        n_nodes: nodes.
        n_tets: tetrahedra of each region.
        volume_cm3: volume of each region.
        area_cm2: area under each label.
        measures: spread of each measure by region: ``min_dihedral_deg``, ``max_dihedral_deg``,
            ``aspect_ratio``, ``scaled_jacobian``, ``edge_cm``.
        wall_thickness_cm: thickness between interface and outer wall; None without a wall.
        septum_thickness_cm: thickness between two parts of the lumen; None where there is none.
        through_edges: edges that cross wall, septum or lumen in one go.
        wedges: those of the wall; None where tetrahedra alone fill it.
    """

    n_nodes: int
    n_tets: dict[str, int]
    volume_cm3: dict[str, float]
    area_cm2: dict[str, float]
    measures: dict[str, dict[str, Distribution]]
    wall_thickness_cm: Distribution | None
    septum_thickness_cm: Distribution | None
    through_edges: ThroughEdges
    wedges: Wedges | None = None

    @property
    def min_dihedral_deg(self) -> float:
        """Smallest dihedral angle of the whole mesh [degrees]."""
        return min(rows["min_dihedral_deg"].minimum for rows in self.measures.values())

    def to_dict(self) -> dict[str, object]:
        """Plain values for a JSON file."""

        def plain(spread: Distribution | None) -> dict[str, float] | None:
            return None if spread is None else spread._asdict()

        return {
            "n_nodes": self.n_nodes,
            "n_tets": self.n_tets,
            "volume_cm3": self.volume_cm3,
            "area_cm2": self.area_cm2,
            "measures": {
                region: {name: plain(spread) for name, spread in rows.items()}
                for region, rows in self.measures.items()
            },
            "wall_thickness_cm": plain(self.wall_thickness_cm),
            "septum_thickness_cm": plain(self.septum_thickness_cm),
            "through_edges": self.through_edges._asdict(),
            "wedges": None if self.wedges is None else self.wedges.to_dict(),
        }

    def table(self) -> str:
        """The spreads as text, one measure a line."""
        rows = [
            (f"{region} {name}", spread)
            for region, spreads in self.measures.items()
            for name, spread in spreads.items()
        ]
        rows += [
            (name, spread)
            for name, spread in (
                ("wall thickness_cm", self.wall_thickness_cm),
                ("septum thickness_cm", self.septum_thickness_cm),
            )
            if spread is not None
        ]
        head = f"{'measure':26}" + "".join(f"{column:>11}" for column in Distribution._fields)
        lines = [f"{name:26}" + "".join(f"{value:11.4g}" for value in row) for name, row in rows]
        return "\n".join([head, *lines])


def spread_of(values: Float[np.ndarray, " values"]) -> Distribution:
    """Minimum, 1st percentile, median, 99th percentile and maximum."""
    if len(values) == 0:
        raise ValueError("no values to summarise. Ask only for measures that the mesh has.")
    return Distribution(
        *(float(value) for value in np.percentile(values, [0.0, 1.0, 50.0, 99.0, 100.0]))
    )


def mesh_quality(mesh: Mesh) -> Quality:
    """Quality of a labelled mesh.

    Args:
        mesh: mesh with labels.

    Returns:
        Spreads over the elements of each region, counts of edges that cross a region in one go,
        thickness of wall and septum as rays measure it, volumes and areas.
    """
    regions = [region for region in Region if np.any(mesh.region == region)]
    volumes = tet_volumes(mesh.points, mesh.tets)
    wall, septum = _thicknesses(mesh, regions)
    return Quality(
        n_nodes=len(mesh.points),
        n_tets={region.name.lower(): int(np.sum(mesh.region == region)) for region in regions},
        volume_cm3={
            region.name.lower(): float(np.sum(volumes[mesh.region == region])) for region in regions
        },
        area_cm2={
            name: float(np.sum(triangle_areas(mesh.points, mesh.labelled(name))))
            for name in mesh.label_names
        },
        measures={region.name.lower(): _measures(mesh, region) for region in regions},
        wall_thickness_cm=wall,
        septum_thickness_cm=septum,
        through_edges=through_edges(mesh),
        wedges=_wedges(mesh, volumes) if len(mesh.wedges) else None,
    )


def _wedges(mesh: Mesh, volumes: Float[np.ndarray, " tets"]) -> Wedges:
    shape = wedge_quality(mesh.points, mesh.wedges)
    filled = volumes[mesh.wedge_tets].sum()
    return Wedges(
        number=len(mesh.wedges),
        volume_share=float(filled / volumes[mesh.region == Region.SOLID].sum()),
        min_dihedral_deg=spread_of(shape.min_dihedral_deg),
        scaled_jacobian=spread_of(shape.scaled_jacobian),
    )


def _measures(mesh: Mesh, region: Region) -> dict[str, Distribution]:
    tets = mesh.tets_of(region)
    shape = tet_quality(mesh.points, tets)
    measures = {name: spread_of(values) for name, values in shape._asdict().items()}
    return measures | {"edge_cm": spread_of(edge_lengths(mesh.points, tet_edges(tets)))}


def _thicknesses(
    mesh: Mesh, regions: list[Region]
) -> tuple[Distribution | None, Distribution | None]:
    if Region.SOLID not in regions or INTERFACE not in mesh.label_names:
        return None, None
    measured = wall_thickness(mesh)
    wall, septum = measured.of_wall, measured.of_septum
    return (
        spread_of(wall) if len(wall) else None,
        spread_of(septum) if len(septum) else None,
    )


def _inner_edges(
    tets: Int[np.ndarray, "tets 4"], boundary: Int[np.ndarray, "faces 3"]
) -> Int[np.ndarray, "edges 2"]:
    """Edges with both ends on the boundary that do not lie in it."""
    edges = tet_edges(tets)
    on_boundary = np.zeros(int(tets.max()) + 1, dtype=bool)
    on_boundary[boundary] = True
    edges = edges[np.all(on_boundary[edges], axis=1)]
    in_boundary, _ = unique_rows(np.sort(triangle_edges(boundary).reshape(-1, 2), axis=1))
    return edges[find_rows(edges, in_boundary) < 0]


def through_edges(mesh: Mesh) -> ThroughEdges:
    """Edges that cross wall, septum or lumen in one go.

    An edge counts if both its ends lie on walls of its region but the edge itself not on its
    boundary: it has no node between the two surfaces, so that one linear element spans the gap.
    Edges in the cut ends do not count, nor do those of wedges, which bend in one layer.
    """
    on_interface, on_outside = _wall_nodes(mesh)
    wall = septum = lumen = single = 0
    beside = mesh.region == Region.SOLID
    if len(mesh.wedges):
        beside[mesh.wedge_tets] = False
    solid = mesh.tets[beside]
    if len(solid):
        inner = _inner_edges(solid, boundary_of(solid))
        ends = on_interface[inner].sum(axis=1)
        wall = int(np.sum((ends == 1) & np.any((on_outside & ~on_interface)[inner], axis=1)))
        septum = int(np.sum(ends == 2))
        single = int(np.sum(np.all((on_interface | on_outside)[solid], axis=1)))
    fluid = mesh.tets_of(Region.FLUID)
    if len(fluid):
        inner = _inner_edges(fluid, boundary_of(fluid))
        lumen = int(np.sum(np.all(on_interface[inner], axis=1)))
    return ThroughEdges(wall, septum, lumen, single)


def _wall_nodes(
    mesh: Mesh,
) -> tuple[Bool[np.ndarray, " nodes"], Bool[np.ndarray, " nodes"]]:
    """Which nodes lie on the interface and which on the outside of the wall, rims included."""
    on_interface = np.zeros(len(mesh.points), dtype=bool)
    on_outside = np.zeros(len(mesh.points), dtype=bool)
    for name in mesh.label_names:
        if name == INTERFACE:
            on_interface[mesh.labelled(name)] = True
        elif name not in mesh.openings and not name.endswith(RING_SUFFIX):
            on_outside[mesh.labelled(name)] = True
    return on_interface, on_outside
