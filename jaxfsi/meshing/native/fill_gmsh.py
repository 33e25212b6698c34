"""Adapter of gmsh (GPL, installed by choice): fills a closed surface with tetrahedra."""

import gmsh  # pyright: ignore[reportMissingImports]
import numpy as np


def run(arrays, options):
    """``points, triangles`` (closed, normals outwards) -> ``points, tets``; input nodes first."""
    points, triangles = arrays["points"], arrays["triangles"]
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.Algorithm3D", int(options.get("algorithm", 1)))
        gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 1)
        gmsh.option.setNumber("Mesh.Optimize", 1)
        gmsh.model.add("region")
        surface = gmsh.model.addDiscreteEntity(2)
        node_tags = np.arange(1, len(points) + 1)
        gmsh.model.mesh.addNodes(2, surface, node_tags, points.ravel())
        gmsh.model.mesh.addElementsByType(surface, 2, [], (triangles + 1).ravel())
        volume = gmsh.model.addDiscreteEntity(3, boundary=[surface])
        gmsh.model.mesh.generate(3)
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        _, nodes = gmsh.model.mesh.getElementsByType(4, volume)
    finally:
        gmsh.finalize()
    order = np.argsort(tags)
    tets = np.searchsorted(tags[order], nodes.reshape(-1, 4))
    return {"points": coordinates.reshape(-1, 3)[order], "tets": tets.astype(np.int64)}
