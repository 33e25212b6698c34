"""Native meshers in child processes, filling, and layers."""

import importlib.util

import numpy as np
import pytest

from jaxfsi.faces import boundary_of
from jaxfsi.measures import enclosed_volume
from jaxfsi.mesh import Region, tet_volumes
from jaxfsi.meshing import BACKENDS, MeshingError, Surface, fill_surfaces, tube
from jaxfsi.meshing.isolate import NativeCall, native_call, run_all_isolated, run_isolated
from jaxfsi.meshing.volume.layers import split_spanning_edges

INSTALLED = {name for name in BACKENDS if importlib.util.find_spec(name) is not None}


def cylinder() -> Surface:
    """Closed surface of a bare tube."""
    mesh = tube(radius=0.5, length=1.5, thickness=0.1, n_around=16, n_axial=8, n_layers=0)
    faces = boundary_of(mesh.tets)
    nodes, back = np.unique(faces, return_inverse=True)
    return Surface(mesh.points[nodes], back.reshape(-1, 3))


def adapter(tmp_path, body: str) -> NativeCall:
    path = tmp_path / "faulty.py"
    path.write_text(
        f"import os, time\nimport numpy as np\n\n\ndef run(arrays, options):\n    {body}\n"
    )
    return NativeCall(path, {"x": np.arange(3)}, {"factor": 2}, timeout=20.0)


def test_arrays_and_options_pass_through_a_child(tmp_path):
    call = adapter(tmp_path, "return {'y': options['factor'] * arrays['x']}")
    np.testing.assert_array_equal(run_isolated(call)["y"], [0, 2, 4])
    outs = run_all_isolated([call, call._replace(options={"factor": 3})])
    np.testing.assert_array_equal([out["y"][2] for out in outs], [4, 6])


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("os.abort()", "faulty crashed with SIGABRT.*finer preset"),
        ("os._exit(7)", "faulty ended with exit status 7"),
        ("raise RuntimeError('Remeshing failed')", "RuntimeError: Remeshing failed.*Try"),
        ("import no_such_mesher", "no_such_mesher is not installed.*pip install"),
    ],
)
def test_failures_of_a_child_are_told_with_a_cure(tmp_path, body, message):
    with pytest.raises(MeshingError, match=message):
        run_isolated(adapter(tmp_path, body))


def test_child_that_hangs_is_ended(tmp_path):
    call = adapter(tmp_path, "time.sleep(60)")._replace(timeout=1.0)
    with pytest.raises(MeshingError, match=r"ended after 1 s.*coarser preset"):
        run_isolated(call)


@pytest.mark.parametrize("backend", sorted(INSTALLED))
def test_backend_fills_a_surface_and_keeps_it(backend):
    surface = cylinder()
    (filled,) = fill_surfaces([surface], backend)
    volumes = tet_volumes(filled.points, filled.tets)
    assert volumes.min() > 0.0
    # Sum over tetrahedra against the divergence theorem on the same surface: round-off.
    np.testing.assert_allclose(volumes.sum(), enclosed_volume(*surface), rtol=1e-12)
    wanted = np.unique(np.sort(surface.triangles, axis=1), axis=0)
    found = np.unique(np.sort(boundary_of(filled.tets), axis=1), axis=0)
    np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize("backend", sorted(set(BACKENDS) - INSTALLED))
def test_backend_that_is_not_installed_says_how_to_get_it(backend):
    with pytest.raises(MeshingError, match=f"{backend} is not installed.*pip install {backend}"):
        fill_surfaces([cylinder()], backend)


def test_unknown_backend_is_refused():
    with pytest.raises(ValueError, match=r"no meshing backend 'cgal'.*netgen"):
        fill_surfaces([cylinder()], "cgal")


def test_surface_with_a_hole_cannot_be_filled():
    surface = cylinder()
    with pytest.raises(MeshingError, match="netgen"):
        fill_surfaces([Surface(surface.points, surface.triangles[5:])])


def test_netgen_options_are_known_to_the_adapter():
    out = run_isolated(native_call("fill_netgen", cylinder()._asdict(), {"grading": 0.2}))
    assert set(out) == {"points", "tets"}


def test_spanning_edges_are_split_without_touching_the_surface():
    # One layer of tetrahedra through the wall: every one of them spans it.
    mesh = tube(radius=0.5, length=1.0, thickness=0.1, n_around=12, n_axial=5, n_layers=1)
    solid = mesh.tets_of(Region.SOLID)
    nodes, back = np.unique(solid, return_inverse=True)
    points, tets = mesh.points[nodes], back.reshape(-1, 4)
    new_points, new_tets = split_spanning_edges(points, tets)
    np.testing.assert_array_equal(new_points[: len(points)], points)
    volumes = tet_volumes(new_points, new_tets)
    assert volumes.min() > 0.0
    np.testing.assert_allclose(volumes.sum(), tet_volumes(points, tets).sum(), rtol=1e-13)
    before, after = (np.unique(np.sort(boundary_of(t), axis=1), axis=0) for t in (tets, new_tets))
    np.testing.assert_array_equal(after, before)
    on_surface = np.isin(np.arange(len(new_points)), before)
    assert not np.any(on_surface[new_tets].all(axis=1))
    again, _ = split_spanning_edges(new_points, new_tets)
    assert len(again) == len(new_points)
