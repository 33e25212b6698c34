import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lumped import (
    Resistance,
    Vessel,
    connect,
    direct_current,
)
from lumped.verification import BLOCKS


@pytest.mark.parametrize("name", BLOCKS)
@pytest.mark.parametrize("bad", [-1.0, float("nan"), float("inf")])
def test_impossible_parameters_are_refused(name, bad):
    block = BLOCKS[name]
    values = {field.name: getattr(block, field.name) for field in dataclasses.fields(block)}
    for field in values:
        if field in ("P_im", "P_source") or (
            bad == -1.0 and field in ("P_ref", "P_venous", "G_bypass")
        ):
            continue
        with pytest.raises(ValueError, match=field):
            type(block)(**{**values, field: bad})


def test_zero_proximal_resistance_is_allowed():
    assert float(direct_current(0.0, Resistance(0.0))[0]) == 0.0
    network = connect(
        {
            "a": (Vessel(R_viscous=1.0), "in", "out"),
            "b": (Resistance(1), "in"),
            "c": (Resistance(np.float32(2)), "out"),
        }
    )
    assert all(leaf.dtype == jnp.float64 for leaf in jax.tree.leaves(network))
