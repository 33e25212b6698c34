import numpy as np
import pytest

from jaxfsi.anatomy import Opening
from jaxfsi.measures import triangle_normals
from jaxfsi.meshing.isolate import MeshingError
from jaxfsi.meshing.surface.caps import annulus, disc
from jaxfsi.meshing.surface.projection import triangle_qualities
from jaxfsi.meshing.surface.sizes import SizeField, grown_field

NORMAL = np.array([1.0, 2.0, 2.0]) / 3.0
OPENING = Opening("outlet", np.array([0.3, -0.2, 0.1]), NORMAL, 1.0)


def loop(radius: float, n: int, *, squash: float = 1.0) -> np.ndarray:
    first = np.cross(NORMAL, [1.0, 0.0, 0.0])
    first /= np.linalg.norm(first)
    angle = 2.0 * np.pi * np.arange(n) / n
    plane = radius * np.stack([np.cos(angle), squash * np.sin(angle)])
    return OPENING.centre + plane.T @ np.stack([first, np.cross(NORMAL, first)])


def uniform(size: float) -> SizeField:
    return grown_field(OPENING.centre[None], np.array([size]))


def ellipse_polygon_area(radius: float, n: int, squash: float) -> float:
    return 0.5 * n * radius**2 * squash * np.sin(2.0 * np.pi / n)


@pytest.mark.parametrize("squash", [1.0, 0.4])
def test_disc_fills_its_border_in_the_plane(squash):
    border = loop(0.5, 40, squash=squash)
    cap = disc(border, OPENING, uniform(0.08))
    points = np.concatenate([border, cap.added])
    normals = triangle_normals(points, cap.triangles)
    np.testing.assert_allclose(
        0.5 * normals @ NORMAL, 0.5 * np.linalg.norm(normals, axis=1), rtol=1e-9
    )  # round-off: all triangles look along the normal
    area = 0.5 * np.linalg.norm(normals, axis=1).sum()
    np.testing.assert_allclose(area, ellipse_polygon_area(0.5, 40, squash), rtol=1e-9)  # round-off
    np.testing.assert_allclose((points - OPENING.centre) @ NORMAL, 0.0, atol=1e-12)
    assert triangle_qualities(points, cap.triangles).min() > 0.5


def test_disc_is_graded_where_the_size_grows():
    border = loop(0.5, 80)
    field = grown_field(border, np.full(80, 0.04), growth=0.35)._replace(largest=0.2)
    graded = disc(border, OPENING, field)
    fine = disc(border, OPENING, uniform(0.04))
    assert 0 < len(graded.added) < 0.7 * len(fine.added)
    points = np.concatenate([border, graded.added])
    assert triangle_qualities(points, graded.triangles).min() > 0.3


@pytest.mark.parametrize("layers", [1, 2, 3])
def test_annulus_fills_the_wall_in_layers(layers):
    inner, outer = loop(0.5, 40), loop(0.6, 48)
    cap = annulus(inner, outer, OPENING, uniform(0.08), layers=layers)
    points = np.concatenate([inner, outer, cap.added])
    area = 0.5 * np.linalg.norm(triangle_normals(points, cap.triangles), axis=1).sum()
    wanted = ellipse_polygon_area(0.6, 48, 1.0) - ellipse_polygon_area(0.5, 40, 1.0)
    np.testing.assert_allclose(area, wanted, rtol=1e-9)  # round-off
    edges = cap.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    inside, outside = edges < 40, (edges >= 40) & (edges < 88)
    through = inside.any(axis=1) & outside.any(axis=1)
    assert bool(through.any()) == (layers == 1)
    assert triangle_qualities(points, cap.triangles).min() > 0.2


def test_border_that_leaves_the_wall_is_refused():
    shifted = loop(0.5, 40) + 0.2 * (loop(1.0, 4)[0] - OPENING.centre)
    with pytest.raises(MeshingError, match="lumen leaves the wall at opening 'outlet'"):
        annulus(shifted, loop(0.6, 48), OPENING, uniform(0.08), layers=2)


def test_border_that_crosses_itself_is_refused():
    border = loop(0.5, 40)
    border[[3, 20]] = border[[20, 3]]
    with pytest.raises(MeshingError, match="does not fill its border"):
        disc(border, OPENING, uniform(0.08))
