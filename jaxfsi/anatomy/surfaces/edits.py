"""Changes to a triangulated surface: smoothing, splitting long edges, going on beyond open ends."""

import numpy as np
import scipy.sparse
from jaxtyping import Bool, Int

from jaxfsi.anatomy.surfaces.flat_ends import FlatEnd
from jaxfsi.anatomy.surfaces.triangles import Triangles, edges_of
from jaxfsi.measures import edge_lengths

_SHRINK = 0.5
_GROW = 0.51
_MAX_SPLITS = 30
_NONE = np.zeros(0, dtype=np.int64)


def mean_of_neighbours(
    surface: Triangles, fixed: Int[np.ndarray, " fixed"] = _NONE
) -> scipy.sparse.csr_array:
    """Matrix that replaces values at points by the mean over the points joined by an edge.

    Args:
        surface: any surface.
        fixed: points that keep their values.
    """
    ends = edges_of(surface.faces).ends
    n = len(surface.points)
    row, column = np.concatenate([ends, ends[:, ::-1]]).T
    moving = ~np.isin(row, fixed)
    row, column = (np.concatenate([x[moving], fixed]) for x in (row, column))
    joined = scipy.sparse.csr_array((np.ones(len(row)), (row, column)), shape=(n, n))
    count = np.maximum(joined.sum(axis=1), 1.0)
    return scipy.sparse.csr_array(scipy.sparse.diags_array(1.0 / count) @ joined)


def taubin_smoothed(
    surface: Triangles, steps: int, *, fixed: Int[np.ndarray, " fixed"]
) -> Triangles:
    """Smooth without shrinking: a step λ of the mean-value Laplacian, then a larger one back.

    p ← p + λ (Mp − p), p ← p + μ (Mp − p) with λ = 0.5, μ = −0.51: a low-pass filter whose gain,
    (1 − λk)(1 − μk), is within 1e-4 of one for k < 1/λ + 1/μ = 0.04 (Taubin 1995, SIGGRAPH,
    section 3), so that even a tube of 20 points round keeps its radius.

    Args:
        surface: any surface.
        steps: number of pairs of steps; 0 leaves the surface alone.
        fixed: points that stay.
    """
    import trimesh.smoothing  # a quarter of a second to import, for surfaces alone

    mesh = trimesh.Trimesh(surface.points, surface.faces, process=False)
    mean = mean_of_neighbours(surface, fixed)
    smooth = trimesh.smoothing.filter_taubin(mesh, _SHRINK, _GROW, 2 * steps, mean)
    return Triangles(np.asarray(smooth.vertices), surface.faces)


def _rolled(
    table: Int[np.ndarray, "faces 3"], first: Int[np.ndarray, " faces"]
) -> Int[np.ndarray, "faces 3"]:
    return np.take_along_axis(table, (first[:, None] + np.arange(3)) % 3, axis=1)


def _split_once(surface: Triangles, marked: Bool[np.ndarray, " edges"]) -> Triangles:
    """Bisect marked edges; every triangle is divided to match, so no gaps open."""
    edges = edges_of(surface.faces)
    middle = np.full(len(marked), -1)
    middle[marked] = len(surface.points) + np.arange(np.sum(marked))
    points = np.concatenate([surface.points, surface.points[edges.ends[marked]].mean(axis=1)])
    marks = marked[edges.of_face]
    count = marks.sum(axis=1)
    faces = [surface.faces[count == 0]]
    one = count == 1
    first = np.argmax(marks[one], axis=1)
    corner, mid = _rolled(surface.faces[one], first), _rolled(middle[edges.of_face[one]], first)
    a, b, c, m = corner[:, 0], corner[:, 1], corner[:, 2], mid[:, 0]
    faces += [np.stack(x, axis=1) for x in ((a, m, c), (m, b, c))]
    two = count == 2
    first = (np.argmin(marks[two], axis=1) + 1) % 3
    corner, mid = _rolled(surface.faces[two], first), _rolled(middle[edges.of_face[two]], first)
    a, b, c, m, n = corner[:, 0], corner[:, 1], corner[:, 2], mid[:, 0], mid[:, 1]
    faces += [np.stack(x, axis=1) for x in ((m, b, n), (a, m, n), (a, n, c))]
    corner, mid = surface.faces[count == 3], middle[edges.of_face[count == 3]]
    a, b, c = corner.T
    m, n, k = mid.T
    faces += [np.stack(x, axis=1) for x in ((a, m, k), (m, b, n), (n, c, k), (m, n, k))]
    return Triangles(points, np.concatenate(faces))


def refined(surface: Triangles, longest: float) -> Triangles:
    """The same surface with no edge longer than given; the points there were come first."""
    for _ in range(_MAX_SPLITS):
        marked = edge_lengths(surface.points, edges_of(surface.faces).ends) > longest
        if not np.any(marked):
            break
        surface = _split_once(surface, marked)
    return surface


def with_flat_loops(surface: Triangles, ends: list[FlatEnd]) -> Triangles:
    """The surface with the points of each loop moved into the plane of the loop."""
    points = surface.points.copy()
    for end in ends:
        height = (points[end.loop] - end.centre) @ end.normal
        points[end.loop] -= height[:, None] * end.normal
    return Triangles(points, surface.faces)


def extended_and_closed(
    surface: Triangles, ends: list[FlatEnd], length: float, *, step: float = np.inf
) -> Triangles:
    """Continue a vessel straight beyond its open ends and close it with flat faces there.

    Args:
        surface: open, wound outwards; its points keep their numbers.
        ends: all its open ends.
        length: of the continuation [cm].
        step: longest edge along it [cm].
    """
    points, faces = [surface.points], [surface.faces]
    n = len(surface.points)
    for end in ends:
        ring = surface.points[end.loop]
        n_layers = max(int(np.ceil(length / step)), 1)
        lower = end.loop
        for layer in range(1, n_layers + 1):
            points.append(ring + length * layer / n_layers * end.normal)
            upper = n + np.arange(len(ring))
            n += len(ring)
            lower_next, upper_next = np.roll(lower, -1), np.roll(upper, -1)
            faces.append(np.stack([lower_next, lower, upper], axis=1))
            faces.append(np.stack([lower_next, upper, upper_next], axis=1))
            lower = upper
        points.append((end.centre + length * end.normal)[None])
        faces.append(np.stack([np.roll(lower, -1), lower, np.full(len(lower), n)], axis=1))
        n += 1
    return Triangles(np.concatenate(points), np.concatenate(faces))
