"""Whether each mesher works: a cube, in a process of its own."""

import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from jaxfsi.meshing.isolate import (
    Arrays,
    MeshingError,
    NotInstalledError,
    native_call,
    run_isolated,
)
from study.run.health import Finding

_SECONDS = 120.0


class _Mesher(NamedTuple):
    """A mesher.

    Attributes:
        adapter: its file in `jaxfsi.meshing.native`.
        package: that holds it.
        needed: whether meshing needs it.
    """

    adapter: str
    package: str
    needed: bool


_MESHERS = {
    "Netgen (tetrahedra)": _Mesher("fill_netgen", "netgen-mesher", True),
    "Mmg (surfaces)": _Mesher("mmg_surface", "mmgpy", True),
    "Gmsh (tetrahedra)": _Mesher("fill_gmsh", "gmsh", False),
    "TetGen (tetrahedra)": _Mesher("fill_tetgen", "tetgen", False),
}


def meshers() -> Iterator[Finding]:
    """Mesh a small cube with each mesher, as meshing does."""
    for name, mesher in _MESHERS.items():
        yield _tried(name, mesher)


def _tried(name: str, mesher: _Mesher) -> Finding:
    cure = f"pip install --force-reinstall {mesher.package}"
    start = time.perf_counter()
    try:
        out = run_isolated(native_call(mesher.adapter, *_task(mesher.adapter), timeout=_SECONDS))
    except NotInstalledError as error:
        if not mesher.needed:
            return Finding(name, "not installed; not needed")
        return Finding(name, "", _short(error), f"pip install {mesher.package}")
    except MeshingError as error:
        return Finding(name, "", _short(error), cure)
    what = "tets" if "tets" in out else "triangles"
    words = f"{len(out[what])} {what} in {time.perf_counter() - start:.2g} s"
    if not len(out[what]):
        return Finding(name, words, "made nothing of a cube", cure)
    return Finding(name, words)


def _task(adapter: str) -> tuple[Arrays, dict[str, object]]:
    """Surface of the unit cube, and settings of the mesher."""
    points = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    squares = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in squares for t in ((a, b, c), (a, c, d))]
    arrays = {"points": points, "triangles": np.array(triangles)}
    if adapter == "mmg_surface":
        return {**arrays, "size": np.full(len(points), 0.4)}, {"hgrad": 1.3}
    if adapter == "fill_gmsh":
        return arrays, {"algorithm": 1}
    return arrays, {"switches": "pq1.4/12YQ"} if adapter == "fill_tetgen" else {}


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:300] or type(error).__name__
