"""Published measurements whose missing effect is known; slow, and only where the data are."""

import json

import pytest

from benchmarks import published


@pytest.mark.slow
def test_withheld_effects_of_published_data_are_found(shared_data):
    assert shared_data == published.SHARED
    found = published.run()
    assert found["rows"]
    for row in found["rows"]:
        assert row["right"] or row["what"].startswith(published.SHOWN), row
    assert found["passed"]
    for artery in published.SHOWN:
        (_, best, *_) = [row for row in found["rows"] if row["what"].startswith(artery)]
        assert "wall" in best["what"], best
    assert json.loads(json.dumps(found)) == found  # as the command writes it


def test_resistance_of_the_nozzle_is_mostly_the_throat():
    throat = 8.0 * published.MU * 4.0 / (3.141592653589793 * published.NARROW**4) / published.MMHG
    # cone and wide tubes add a ninth
    assert published.poiseuille_resistance() == pytest.approx(throat, rel=0.15)


def test_missing_data_are_said(monkeypatch, tmp_path):
    monkeypatch.setattr(published, "SHARED", tmp_path)
    found = published.run()
    assert found["rows"] == []
    assert "not there" in found["notes"]
