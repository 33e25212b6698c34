"""A mesh that cuts too much off the septum is made again with a closer fit, and only then."""

import types

import pytest

from jaxfsi.meshing import build
from jaxfsi.meshing.isolate import MeshingError

REQUEST = build.MeshRequest("medium", None, 2, 1, "netgen")


def _attempts(monkeypatch, found):
    """Attempts that keep these shares of the septum, one after the other; None fails."""
    tried = []

    def attempted(anatomy, attempt, request, stages):
        tried.append(attempt.deviation)
        kept = found[len(tried) - 1]
        if kept is None:
            raise MeshingError("no mesh")
        ratio = None if kept == "none" else types.SimpleNamespace(p1=kept)
        return (f"mesh {kept}", None, None, types.SimpleNamespace(septum_ratio=ratio)), []

    monkeypatch.setattr(build, "_attempted", attempted)
    made, notes = build._fitting(None, build.ATTEMPTS[0], REQUEST, None)
    return made[0], notes, tried


@pytest.mark.parametrize(
    ("found", "taken", "tried", "noted"),
    [
        ([0.98], "mesh 0.98", [1.0], False),
        (["none"], "mesh none", [1.0], False),
        ([0.6, 0.99], "mesh 0.99", [1.0, 0.5], False),
        ([0.4, 0.6], "mesh 0.6", [1.0, 0.5], True),
        ([0.6, 0.4], "mesh 0.6", [1.0, 0.5], True),
        ([0.6, None], "mesh 0.6", [1.0, 0.5], True),
    ],
)
def test_the_better_of_two_fits_is_taken(found, taken, tried, noted, monkeypatch):
    mesh, notes, deviations = _attempts(monkeypatch, found)
    assert mesh == taken
    assert deviations == tried
    assert bool(notes) == noted
    if noted:
        assert "keeps 60% of its thickness" in notes[0]
