"""What blood and wall share in a mesh."""

import numpy as np

from jaxfsi.faces import boundary_of
from jaxfsi.mesh import INTERFACE, Mesh, Region


def assert_interface_is_shared(mesh: Mesh) -> None:
    """The interface is one set of triangles in blood and wall; they share its nodes alone."""

    def keys(faces: np.ndarray) -> set[tuple[int, ...]]:
        return set(map(tuple, np.sort(faces, axis=1).tolist()))

    blood, wall = (keys(boundary_of(mesh.tets_of(region))) for region in Region)
    assert blood & wall == keys(mesh.labelled(INTERFACE))
    on_interface = np.unique(mesh.labelled(INTERFACE))
    shared = np.intersect1d(mesh.tets_of(Region.FLUID), mesh.tets_of(Region.SOLID))
    np.testing.assert_array_equal(shared, on_interface)
