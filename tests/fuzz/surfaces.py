# ruff: noqa: E501  tables of damage read best in long rows
"""A small good surface of a lumen in many formats, contours, and geometric damage to both."""

import functools
import random
from collections.abc import Callable

import numpy as np

from tests.fuzz.shapes import (
    centre_line,
    contour_files,
    contour_rows,
    contour_text,
    frame_table,
    ply_ascii,
    stl_ascii,
    stl_binary,
    vtp_ascii,
)
from tests.fuzz.trial import Expected, Files

STEP = 1.0
WRITERS = {
    "stl ascii": ("lumen.stl", stl_ascii),
    "stl binary": ("lumen.stl", stl_binary),
    "vtp": ("lumen.vtp", vtp_ascii),
    "ply": ("lumen.ply", ply_ascii),
}
INDEXED = ("vtp", "ply")


@functools.cache
def good_surface() -> tuple[np.ndarray, np.ndarray]:
    """An open aorta along z with a branch along x [mm]."""
    import skimage.measure
    import trimesh

    low, high = np.array([-13.0, -13.0, -23.0]), np.array([25.0, 13.0, 23.0])
    axes = [np.arange(a, b, STEP) for a, b in zip(low, high, strict=True)]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    aorta = np.hypot(x[..., 0], x[..., 1]) - 10.0
    branch = np.maximum(np.hypot(x[..., 1], x[..., 2]) - 2.5, -x[..., 0])
    points, faces, _, _ = skimage.measure.marching_cubes(
        np.minimum(aorta, branch), 0.0, spacing=(STEP,) * 3
    )
    points, faces = points + low, faces[:, ::-1].astype(np.int64)
    for normal, origin in (
        ([0, 0, 1], [0, 0, -20]),
        ([0, 0, -1], [0, 0, 20]),
        ([-1, 0, 0], [22, 0, 0]),
    ):
        points, faces = trimesh.intersections.slice_faces_plane(
            points, faces, np.array(normal, float), np.array(origin, float)
        )[:2]
    return np.asarray(points, float), np.asarray(faces)


Lumen = tuple[np.ndarray, np.ndarray, Expected]
Damage = Callable[[random.Random, np.ndarray, np.ndarray], Lumen]


def nothing(_: random.Random, points: np.ndarray, faces: np.ndarray) -> Lumen:
    return points, faces, "either"


def bad_coordinate(rng: random.Random, points: np.ndarray, faces: np.ndarray) -> Lumen:
    points[faces[rng.randrange(len(faces)), 0], rng.randrange(3)] = rng.choice(
        [np.nan, np.inf, 1e30, 1e9, -1e6, 1e4]
    )
    return points, faces, "refused"


def a_point(_: random.Random, points: np.ndarray, faces: np.ndarray) -> Lumen:
    return 0.0 * points + 1.0, faces, "refused"


def flat(_: random.Random, points: np.ndarray, faces: np.ndarray) -> Lumen:
    points[:, 1] = 0.0
    return points, faces, "refused"


def hole(rng: random.Random, points: np.ndarray, faces: np.ndarray) -> Lumen:
    middle = points[faces].mean(axis=1)
    wall = np.flatnonzero((np.abs(middle[:, 2]) < 15.0) & (middle[:, 0] < 0.0))
    centre = middle[rng.choice(wall.tolist())]
    return points, faces[np.linalg.norm(middle - centre, axis=1) > 4.0], "refused"


def triangle_missing(rng: random.Random, points: np.ndarray, faces: np.ndarray) -> Lumen:
    return points, np.delete(faces, rng.randrange(len(faces)), axis=0), "either"


def triangle_flipped(rng: random.Random, points: np.ndarray, faces: np.ndarray) -> Lumen:
    k = rng.randrange(len(faces))
    faces[k] = faces[k, ::-1]
    return points, faces, "either"


def triangle_doubled(rng: random.Random, points: np.ndarray, faces: np.ndarray) -> Lumen:
    return points, np.concatenate([faces, faces[[rng.randrange(len(faces))]]]), "either"


def triangle_degenerate(rng: random.Random, points: np.ndarray, faces: np.ndarray) -> Lumen:
    a, b, _ = faces[rng.randrange(len(faces))]
    return points, np.concatenate([faces, [[a, b, b]]]), "either"


def inside_out(_: random.Random, points: np.ndarray, faces: np.ndarray) -> Lumen:
    return points, faces[:, ::-1].copy(), "either"


def two_parts(rng: random.Random, points: np.ndarray, faces: np.ndarray) -> Lumen:
    by = rng.choice([60.0, 100.0])
    both = np.concatenate([points, points + np.array([0.0, by, 0.0])])
    return both, np.concatenate([faces, faces + len(points)]), "refused"


def crossing(_: random.Random, points: np.ndarray, faces: np.ndarray) -> Lumen:
    """A part of the wall pushed through the one opposite."""
    dent = np.exp(-((points[:, 2] + 8.0) ** 2 + points[:, 1] ** 2) / 8.0) * (points[:, 0] < 0.0)
    points[:, 0] += 24.0 * dent
    return points, faces, "refused"


def wrong_unit(rng: random.Random, points: np.ndarray, faces: np.ndarray) -> Lumen:
    return points * rng.choice([100.0, 1000.0, 1e-2, 1e-3]), faces, "refused"


def bad_index(rng: random.Random, points: np.ndarray, faces: np.ndarray) -> Lumen:
    faces[rng.randrange(len(faces)), 0] = rng.choice([-1, len(points), 10**7, 2**31 - 1])
    return points, faces, "refused"


def no_triangles(_: random.Random, points: np.ndarray, faces: np.ndarray) -> Lumen:
    return points, faces[:0], "refused"


def few_triangles(_: random.Random, points: np.ndarray, faces: np.ndarray) -> Lumen:
    return points, faces[:3], "refused"


def closed_ends(_: random.Random, points: np.ndarray, faces: np.ndarray) -> Lumen:
    """Nothing but a closed ball: no opening at all."""
    centre = points.mean(axis=0)
    from tests.fuzz.shapes import lumen

    ball, triangles = lumen()
    ball = ball / np.maximum(np.linalg.norm(ball, axis=1, keepdims=True), 1e-9) * 10.0
    return ball + centre, triangles, "refused"


SURFACE_DAMAGE: dict[str, Damage] = {
    damage.__name__.replace("_", " "): damage
    for damage in (
        nothing, bad_coordinate, a_point, flat, hole, triangle_missing, triangle_flipped,
        triangle_doubled, triangle_degenerate, inside_out, two_parts, crossing, wrong_unit,
        bad_index, no_triangles, few_triangles, closed_ends,
    )
}  # fmt: skip


def damaged_surface(rng: random.Random, form: str, name: str) -> tuple[Files, Expected] | None:
    """The file of a surface with some damage; None where the format cannot hold it."""
    if name == "bad index" and form not in INDEXED:
        return None
    points, faces = (array.copy() for array in good_surface())
    points, faces, expected = SURFACE_DAMAGE[name](rng, points, faces)
    file, write = WRITERS[form]
    with np.errstate(all="ignore"):
        return {file: write(points, faces)}, expected


CONTOUR_DAMAGE = (
    "frame table in cm", "contours in cm", "contours in m", "centre line in cm", "centre line in m",
    "reference nan", "reference 1e300", "reference in cm", "reference two rows", "reference text",
    "nan in contours", "1e300 in contours", "one point a frame", "one frame", "frame doubled",
    "flat contours", "frames in another order", "centre line one point", "centre line turned",
    "nan in centre line", "centre line a point", "frame table of another", "tissue 1e300",
    "tissue negative", "tissue nan", "position nan", "position equal", "commas for tabs", "crlf",
    "spaces for tabs", "two columns", "five columns", "header in contours", "decimal commas",
    "contours turned inside", "self-crossing frame", "spike", "frames not whole", "millions of rows",
    "long lines", "frame of zero size", "swapped files", "points shuffled",
)  # fmt: skip


def damaged_contours(rng: random.Random, name: str) -> tuple[Files, Expected, str]:
    """The files of contours with some damage, what must become of them, the file to blame."""
    files = contour_files()
    expected, blame, change = _contour_changes(rng)[name]
    files.update(change())
    return files, expected, blame


def _contour_changes(
    rng: random.Random,
) -> dict[str, tuple[Expected, str, Callable[[], Files]]]:
    rows, line, table = contour_rows(), centre_line(), frame_table()
    k = rng.randrange(5, len(rows) - 5)
    odd = float("nan")

    def contours(changed: np.ndarray) -> Files:
        return {"contours.csv": contour_text(changed).encode()}

    def centre(changed: np.ndarray) -> Files:
        return {
            "centerline.csv": "".join(
                ",".join(f"{x:.6g}" for x in r) + "\n" for r in changed
            ).encode()
        }

    def reference(text: str) -> Files:
        return {"reference.csv": text.encode()}

    def frames(change: Callable[[list[str]], list[str]]) -> Files:
        head, *body = table.strip().split("\n")
        return {
            "frames.csv": "\n".join(
                [head, *(",".join(change(r.split(","))) for r in body)]
            ).encode()
        }

    def put(value: float, column: int = 1) -> np.ndarray:
        changed = rows.copy()
        changed[k, column] = value
        return changed

    def scaled(by: float) -> np.ndarray:
        return rows * [1.0, by, by, by]

    def of_frame(change: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        frame = rng.randrange(3, 12)
        changed = rows.copy()
        own = changed[:, 0] == frame
        changed[own, 1:3] = change(changed[own, 1:3])
        return changed

    c, f, r, z = "contours.csv", "frames.csv", "reference.csv", "centerline.csv"
    order = np.array(rng.sample(range(len(rows)), len(rows)))
    inner = 0.0 * line[:1]
    text = files_text = contour_text(rows)
    del files_text
    return {
        "frame table in cm": ("refused", f, lambda: frames(lambda x: [x[0], f"{float(x[1]) / 10:.4f}", *(f"{float(v) / 10:.4f}" if v else "" for v in x[2:])])),
        "contours in cm": ("refused", c, lambda: contours(scaled(0.1))),
        "contours in m": ("refused", c, lambda: contours(scaled(0.001))),
        "centre line in cm": ("refused", z, lambda: centre(0.1 * line)),
        "centre line in m": ("refused", z, lambda: centre(0.001 * line)),
        "reference nan": ("refused", r, lambda: reference("14\t4.0\tnan\t18.0\n")),
        "reference 1e300": ("refused", r, lambda: reference("14\t4.0\t1e300\t18.0\n")),
        "reference in cm": ("either", r, lambda: reference("14\t0.4\t1.2\t1.8\n")),
        "reference two rows": ("either", r, lambda: reference("14\t4.0\t12.0\t18.0\n1\t4.0\t-12.0\t0.0\n")),
        "reference text": ("refused", r, lambda: reference("the aorta is above\n")),
        "nan in contours": ("refused", c, lambda: contours(put(odd))),
        "1e300 in contours": ("refused", c, lambda: contours(put(rng.choice([1e300, 1e9, float("inf")])))),
        "one point a frame": ("refused", c, lambda: contours(rows[::48])),
        "one frame": ("refused", c, lambda: contours(rows[:48])),
        "frame doubled": ("either", c, lambda: contours(np.concatenate([rows, rows[:48]]))),
        "flat contours": ("refused", c, lambda: contours(rows * [1.0, 1.0, 0.0, 1.0])),
        "frames in another order": ("either", c, lambda: contours(np.concatenate([rows[240:], rows[:240]]))),
        "points shuffled": ("either", c, lambda: contours(rows[order])),
        "centre line one point": ("refused", z, lambda: centre(line[:1])),
        "centre line turned": ("either", z, lambda: centre(line[::-1])),
        "nan in centre line": ("refused", z, lambda: centre(np.concatenate([line[:9], odd * line[:1], line[9:]]))),
        "centre line a point": ("refused", z, lambda: centre(np.repeat(line[:1] + inner, 50, axis=0))),
        "frame table of another": ("refused", f, lambda: frames(lambda x: [str(int(x[0]) + 5000), *x[1:]])),
        "tissue 1e300": ("refused", f, lambda: frames(lambda x: [*x[:2], "1e300" if x[2] else ""])),
        "tissue negative": ("refused", f, lambda: frames(lambda x: [*x[:2], "-" + x[2] if x[2] else ""])),
        "tissue nan": ("either", f, lambda: frames(lambda x: [*x[:2], "nan" if x[2] else ""])),
        "position nan": ("refused", f, lambda: frames(lambda x: [x[0], "nan", x[2]])),
        "position equal": ("refused", f, lambda: frames(lambda x: [x[0], "5.0", x[2]])),
        "commas for tabs": ("either", c, lambda: {c: contour_text(rows, ",").encode()}),
        "spaces for tabs": ("either", c, lambda: {c: contour_text(rows, " ").encode()}),
        "crlf": ("either", c, lambda: {c: text.replace("\n", "\r\n").encode()}),
        "two columns": ("refused", c, lambda: {c: "".join("\t".join(x.split("\t")[:2]) + "\n" for x in text.splitlines()).encode()}),
        "five columns": ("refused", c, lambda: {c: "".join(x + "\t7\n" for x in text.splitlines()).encode()}),
        "header in contours": ("either", c, lambda: {c: ("frame\tx\ty\tz\n" + text).encode()}),
        "decimal commas": ("refused", c, lambda: {c: text.replace(".", ",").encode()}),
        "contours turned inside": ("either", c, lambda: contours(of_frame(lambda xy: xy[::-1]))),
        "self-crossing frame": ("refused", c, lambda: contours(of_frame(lambda xy: np.concatenate([xy[:24:2], xy[24:][::-1], xy[1:24:2]])))),
        "spike": ("refused", c, lambda: contours(put(400.0))),
        "frames not whole": ("refused", c, lambda: contours(put(3.5, 0))),
        "millions of rows": ("refused", c, lambda: {c: (text * 500).encode()}),
        "long lines": ("refused", c, lambda: {c: text.replace("\n", "\t").encode()}),
        "frame of zero size": ("refused", c, lambda: contours(of_frame(lambda xy: 0.0 * xy + 4.0))),
        "swapped files": ("refused", "", lambda: {c: contour_files()[z], z: contour_files()[c]}),
    }  # fmt: skip
