"""A small anatomy with exact shapes: a straight aorta and a tube that runs in its wall."""

import itertools

import numpy as np
from jaxtyping import Float

from jaxfsi.anatomy import Anatomy, Centerline, Opening

Points = Float[np.ndarray, "points 3"]
Values = Float[np.ndarray, " points"]


def from_segment(x: Points, a: np.ndarray, b: np.ndarray) -> Values:
    """Distance to the line segment ab."""
    side = b - a
    share = np.clip((x - a) @ side / (side @ side), 0.0, 1.0)
    return np.linalg.norm(x - a - share[:, None] * side, axis=1)


def smooth_min(a: Values, b: Values, radius: Values | float) -> Values:
    """Polynomial smooth minimum."""
    h = np.maximum(radius - np.abs(a - b), 0.0) / radius
    return np.minimum(a, b) - 0.25 * h * h * radius


def branched_tube(
    *,
    R: float = 1.0,
    r: float = 0.15,
    septum: float = 0.06,
    aorta_wall: float = 0.12,
    branch_wall: float = 0.06,
    half_length: float = 0.7,
    joined: bool = True,
) -> Anatomy:
    """Aorta of radius R along z; a branch that enters its wall, runs along it and leaves it [cm].

    The branch leaves the aorta at a right angle to its axis through its ostium, then runs parallel
    to the aorta behind a septum, then outwards.
    """
    beside = R + septum + r
    begin = R - 0.15 if joined else beside
    course = [
        np.array(p)
        for p in (
            [begin, 0.0, -0.35],
            [beside, 0.0, -0.15],
            [beside, 0.0, 0.25],
            [beside + 0.55, 0.0, 0.45],
        )
    ]
    direction = (course[3] - course[2]) / np.linalg.norm(course[3] - course[2])
    end = course[3] + 0.5 * direction
    far = 1.5 * half_length * np.array([0.0, 0.0, 1.0])
    tip = course[0] + 0.3 * (course[1] - course[0])

    def aorta(x: Points) -> Values:
        return from_segment(x, -far, far) - R

    def branch(x: Points) -> Values:
        parts = zip([*course[:3]], [*course[1:3], end], strict=True)
        return np.min([from_segment(x, a, b) for a, b in parts], axis=0) - r

    def lumen(x: Points) -> Values:
        near_tip = np.exp(-((np.linalg.norm(x - tip, axis=1) / 0.2) ** 2))
        return smooth_min(aorta(x), branch(x), 0.01 + 0.1 * near_tip)

    def wall(x: Points) -> Values:
        both = smooth_min(aorta(x) - aorta_wall, branch(x) - branch_wall, 0.1)
        return np.minimum(both, lumen(x) - 0.6 * branch_wall)

    def near_branch(x: Points) -> np.ndarray:
        return branch(x) < aorta(x)

    z = np.linspace(-half_length, half_length, 21)
    axis = np.stack([0.0 * z, 0.0 * z, z], axis=1)
    steps = np.array([np.linalg.norm(b - a) for a, b in itertools.pairwise(course)])
    up = np.array([0.0, 0.0, 1.0])
    ball = 1.2 * (R + aorta_wall)
    return Anatomy(
        name="branched tube",
        lumen=lumen,
        wall=wall,
        local_radius=lambda x: np.where(near_branch(x), r, R),
        thickness=lambda x: np.where(near_branch(x), branch_wall, aorta_wall),
        openings=(
            Opening("aorta_inlet", -half_length * up, -up, ball),
            Opening("aorta_outlet", half_length * up, up, ball),
            Opening("anomalous_outlet", course[3], direction, 2.0 * (r + branch_wall)),
        ),
        bounds=np.array(
            [
                [-R - aorta_wall, -R - aorta_wall, -half_length - 0.1],
                [beside + 0.9, R + aorta_wall, half_length + 0.1],
            ]
        ),
        centerlines={
            "aorta": Centerline(axis, z + half_length),
            "branch": Centerline(np.stack(course), np.concatenate([[0.0], np.cumsum(steps)])),
        },
        meta={"septum_cm": septum},
    )
