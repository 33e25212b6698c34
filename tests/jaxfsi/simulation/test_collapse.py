"""What counts as a collapse of the lumen, and what is said of it."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxfsi.simulation.collapse import COLLAPSED, collapse, snapping


def _pressed(model, state, share):
    """The state with the blood half-way along pressed flat to a share of its height."""
    x = model.x
    near = jnp.exp(-(((x[2] - 0.6) / 0.2) ** 2))
    d = jnp.stack([0.0 * x[0], -(1.0 - share) * near * x[1], 0.0 * x[2]])
    return state._replace(
        d_mesh=jnp.where(model.in_fluid, d, 0.0), d=jnp.where(model.in_solid, d, 0.0)
    )


def test_blood_without_room_is_a_collapse_at_its_place(tube_model):
    _, model, state = tube_model
    found = collapse(model, _pressed(model, state._replace(t=jnp.asarray(0.25)), 0.05))
    assert found is not None
    assert found.t == 0.25
    assert found.volume_ratio < COLLAPSED
    # the elements along the tube are 0.3 cm long
    assert found.place[2] == pytest.approx(0.6, abs=0.2)
    assert np.hypot(*(found.point - found.place)[[0, 2]]) == pytest.approx(0.0, abs=1e-12)
    assert found.d.shape == (model.n_vertices, 3)
    assert found.sentence.startswith("The lumen collapsed at t = 0.25 s, at (")


def test_blood_with_room_is_none(tube_model):
    _, model, state = tube_model
    assert collapse(model, _pressed(model, state, 0.6)) is None


def test_inverted_blood_kept_nothing(tube_model):
    _, model, state = tube_model
    found = collapse(model, _pressed(model, state, -0.2))
    assert found is not None
    assert found.volume_ratio == 0.0


def test_wall_that_snaps_is_named_with_its_place(tube_model):
    _, model, state = tube_model
    nodes = np.flatnonzero(np.asarray(model.in_solid))
    fast = state._replace(u=state.u.at[1, nodes[3]].set(-30.0))
    said = snapping(model, fast)
    at = ", ".join(f"{10.0 * x:.1f}" for x in np.asarray(model.x)[:, nodes[3]])
    assert f"The wall moves at 30 cm/s at ({at}) mm" in said
    assert "viscosity" in said
    slow = state._replace(u=state.u.at[1, nodes[3]].set(-3.0))
    assert snapping(model, slow) == ""
    in_blood = np.flatnonzero(~np.asarray(model.in_solid))[0]
    assert snapping(model, state._replace(u=state.u.at[1, in_blood].set(300.0))) == ""
