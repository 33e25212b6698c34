"""Search for the lumen of a state: in steps, from nearby, and not at all."""

import types

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from calibration import found_motion as module
from calibration.found_motion import FoundMotion, found_motion
from calibration.loaded_wall import WallStiffness

STIFFNESS = WallStiffness(1.0, 1.0, 1.0, 1.0)


class _Wall(eqx.Module):
    """Stands for a wall of three unknowns."""

    model: types.SimpleNamespace = eqx.field(static=True)

    def factored(self, stiffness):
        return self


@pytest.fixture
def tried(monkeypatch):
    """Loads that were tried; those more than `reach` beyond the displacement are not found."""
    loads = []

    def attempted(wall, stiffness, free, P, start):
        loads.append(float(P[0]))
        good = float(P[0]) - float(start[0, 0]) <= wall.model.reach + 1e-12
        value = float(P[0]) if good else np.nan
        return FoundMotion(jnp.zeros((2, 1)), jnp.zeros((2, 1, 0)), jnp.full((3, 1), value))

    monkeypatch.setattr(module, "_attempted", attempted)
    return loads


def _wall(reach):
    return _Wall(types.SimpleNamespace(x=jnp.zeros((3, 1)), reach=reach))


def test_load_is_raised_in_steps_that_halve_and_double(tried):
    found = found_motion(_wall(0.5), STIFFNESS, (), jnp.ones(1))
    assert tried == [1.0, 0.5, 1.0]
    assert float(found.d[0, 0]) == 1.0


def test_what_is_nowhere_found_is_none_after_few_attempts(tried):
    assert found_motion(_wall(0.0), STIFFNESS, (), jnp.ones(1)) is None
    assert tried == [1.0, 0.5, 0.25, 0.125, 0.0625]


def test_from_nearby_the_whole_load_is_tried_once(tried):
    assert found_motion(_wall(0.5), STIFFNESS, (), jnp.ones(1), near=jnp.full((3, 1), 0.6))
    assert found_motion(_wall(0.5), STIFFNESS, (), jnp.ones(1), near=jnp.zeros((3, 1))) is None
    assert tried == [1.0, 1.0]
