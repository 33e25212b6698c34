"""From an anatomy to a labelled, conforming mesh of blood and wall."""

from typing import TYPE_CHECKING

from lumped.lazy_package import import_on_first_use

if TYPE_CHECKING:
    from jaxfsi.measures import enclosed_volume
    from jaxfsi.meshing.build import MeshReport, MeshResult, build_mesh
    from jaxfsi.meshing.check.fidelity import Fidelity, elements_across, mesh_fidelity
    from jaxfsi.meshing.check.quality import (
        Distribution,
        Quality,
        ThroughEdges,
        mesh_quality,
        through_edges,
    )
    from jaxfsi.meshing.check.tet_quality import TetQuality, tet_quality
    from jaxfsi.meshing.check.thickness import Exit, WallThickness, wall_thickness
    from jaxfsi.meshing.check.topology import TopologyFault, TopologyReport, check_topology
    from jaxfsi.meshing.isolate import MeshingError
    from jaxfsi.meshing.labels import find_openings, label_faces, labelled_mesh, outward
    from jaxfsi.meshing.presets import PRESETS
    from jaxfsi.meshing.structured.strip import strip
    from jaxfsi.meshing.structured.tube import bent, elliptic, mapped, ring, tube
    from jaxfsi.meshing.surface.isosurface import Surface
    from jaxfsi.meshing.surface.topology import SurfaceTopology, surface_topology
    from jaxfsi.meshing.volume.fill import BACKENDS, Backend, Filling, fill_surfaces

__all__ = [
    "BACKENDS",
    "PRESETS",
    "Backend",
    "Distribution",
    "Exit",
    "Fidelity",
    "Filling",
    "MeshReport",
    "MeshResult",
    "MeshingError",
    "Quality",
    "Surface",
    "SurfaceTopology",
    "TetQuality",
    "ThroughEdges",
    "TopologyFault",
    "TopologyReport",
    "WallThickness",
    "bent",
    "build_mesh",
    "check_topology",
    "elements_across",
    "elliptic",
    "enclosed_volume",
    "fill_surfaces",
    "find_openings",
    "label_faces",
    "labelled_mesh",
    "mapped",
    "mesh_fidelity",
    "mesh_quality",
    "outward",
    "ring",
    "strip",
    "surface_topology",
    "tet_quality",
    "through_edges",
    "tube",
    "wall_thickness",
]

import_on_first_use(__name__)
