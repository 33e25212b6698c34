"""What boundary parameters reach of a record, and the lumen whose loss it wants."""

import jax.numpy as jnp
import numpy as np
import pytest

from calibration import lumen_law
from diagnosis import CATALOGUE, diagnose, find_effect, measured, stacked
from diagnosis.least_change import changed_lumen, least_change
from diagnosis.reach import reach
from jaxfsi import Lumen
from tests.diagnosis.records import synthetic

BLOOD = {"mu": 0.04, "rho": 1.06}
S = np.linspace(0.0, 2.0, 21)
ANGLE = 2.0 * np.pi * np.arange(24) / 24
OUTLINE = np.stack([0.17 * np.cos(ANGLE), 0.12 * np.sin(ANGLE)], axis=-1)
LUMEN = Lumen(jnp.asarray(np.broadcast_to(OUTLINE, (S.size, 24, 2))), jnp.asarray(S))
EFFECTS = tuple(find_effect(CATALOGUE, name) for name in ("proximal_resistance", "inertance"))


def _reached(size, seed):
    """What is found, and the true ln factor: the size and the patient's own R0."""
    found = diagnose(
        stacked([measured(synthetic({EFFECTS[0].id: size}, seed=seed))]), effects=EFFECTS
    )
    own = 0.5 * 0.15 * np.random.default_rng(seed).standard_normal()
    return reach(found[0]), size + own


@pytest.mark.slow
def test_a_local_narrowing_is_found_by_its_loss():
    narrowed = changed_lumen(LUMEN, jnp.asarray(-0.04 * np.exp(-(((S - 0.7) / 0.25) ** 2))))
    size = float(jnp.log(lumen_law(narrowed, **BLOOD).R0 / lumen_law(LUMEN, **BLOOD).R0))
    found, true = _reached(size, 2)
    assert not found.boundary
    assert found.free
    assert abs(found.log_factor - true) < 3.0 * found.log_factor_sd
    assert found.log_factor_sd < 0.1
    change = least_change(LUMEN, np.exp(found.log_factor), sd=0.01, **BLOOD)
    R0 = lumen_law(change.lumen, **BLOOD).R0
    wanted = np.exp(found.log_factor) * lumen_law(LUMEN, **BLOOD).R0
    assert float(R0) == pytest.approx(float(wanted), rel=1e-8)
    assert np.all(np.asarray(change.delta_r)[3:-3] < 0.0)


@pytest.mark.slow
def test_a_record_of_the_base_model_is_reached_by_boundary_parameters():
    found, true = _reached(0.0, 1)
    assert found.boundary
    assert abs(found.log_factor - true) < 3.0 * found.log_factor_sd
