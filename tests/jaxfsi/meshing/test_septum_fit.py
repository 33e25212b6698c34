"""A mesh that cuts too much off the septum is made again with a closer fit, and only then."""

import types

import pytest

from jaxfsi.meshing import build
from jaxfsi.meshing.isolate import MeshingError

REQUEST = build.MeshRequest("medium", None, 2, 1, "netgen")


def _attempts(monkeypatch, found):
    """Attempts that keep these shares of the septum, with as many wedges; errors are raised."""
    tried = []

    def attempted(anatomy, attempt, request, stages):
        tried.append(attempt.deviation)
        if isinstance(found[len(tried) - 1], Exception):
            raise found[len(tried) - 1]
        kept, wedges = found[len(tried) - 1]
        ratio = None if kept is None else types.SimpleNamespace(p1=kept)
        mesh = types.SimpleNamespace(kept=kept, wedges=range(wedges))
        return (mesh, None, None, types.SimpleNamespace(septum_ratio=ratio)), []

    monkeypatch.setattr(build, "_attempted", attempted)
    stages = build._Stages(None)
    made, notes, used = build._fitting(None, build.ATTEMPTS[0], REQUEST, stages)
    assert (used is stages) == (made[0].kept == found[0][0])
    return made[0].kept, notes, tried


@pytest.mark.parametrize(
    ("found", "taken", "tried", "noted"),
    [
        ([(0.98, 9)], 0.98, [1.0], False),
        ([(None, 9)], None, [1.0], False),
        ([(0.6, 9), (0.99, 0)], 0.99, [1.0, 0.5], False),
        ([(0.4, 9), (0.6, 9)], 0.6, [1.0, 0.5], True),
        ([(0.6, 9), (0.7, 0)], 0.6, [1.0, 0.5], True),
        ([(0.6, 9), (0.4, 9)], 0.6, [1.0, 0.5], True),
        ([(0.6, 9), MeshingError("no mesh")], 0.6, [1.0, 0.5], True),
        ([(0.6, 9), ValueError("two borders at an opening")], 0.6, [1.0, 0.5], True),
    ],
)
def test_the_better_of_two_fits_is_taken(found, taken, tried, noted, monkeypatch):
    mesh, notes, deviations = _attempts(monkeypatch, found)
    assert mesh == taken
    assert deviations == tried
    assert bool(notes) == noted
    if noted:
        assert "keeps 60% of its thickness" in notes[0]


def test_an_attempt_whose_anatomy_cannot_be_cut_is_refused_at_once(monkeypatch):
    with pytest.raises(ValueError, match="two borders"):
        _attempts(monkeypatch, [ValueError("two borders at an opening")])
