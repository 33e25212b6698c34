"""What boundary parameters reach of a record, and the lumen whose loss it wants."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from calibration import lumen_law
from diagnosis import CATALOGUE, diagnose, find_effect, measured, stacked
from diagnosis.circuit import FORCED
from diagnosis.engine import base_start
from diagnosis.fit import Fitted
from diagnosis.inlet import EFFECT, with_free_inlet, with_inlet
from diagnosis.least_change import changed_lumen, least_change
from diagnosis.own_inlet import with_own_inlet
from diagnosis.prediction import n_unknowns
from diagnosis.reach import reach
from diagnosis.result import Diagnosis
from diagnosis.spectra import PHASE
from diagnosis.verdict import Judgement
from jaxfsi import Lumen
from lumped import MMHG
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


def _fitted(record, x, n_effects):
    """A fit that ended at x."""
    blank = Fitted(**dict.fromkeys(Fitted._fields))
    return blank._replace(
        x=x,
        kinds=np.array([1.0, 0.0, 0.0]),
        misfit=100.0,
        sizes=np.zeros(n_effects),
        size_sd=np.ones(2),
        waves=np.full((record.n_conditions, 3, 256), 1e5),
        sound=np.array(True),
    )


def test_loss_beside_the_recorded_aortic_waveform_is_that_of_the_model_that_was_fitted():
    """Two effects beside the free inlet, about which both were fitted."""
    other = 5.0 * MMHG * np.sin(4.0 * np.pi * PHASE + 0.4)
    batch = with_inlet(stacked([measured(synthetic({}, seed=1, inlet=other))]))
    freed = with_free_inlet(batch, jnp.asarray(base_start(batch)))
    records = [jax.tree.map(lambda leaf: leaf[0], one) for one in (batch, freed)]
    names = tuple(effect.id for effect in EFFECTS)
    k = n_unknowns(records[0])
    x = np.append(np.zeros(k), [0.4, 0.3])
    blank = dict.fromkeys(Diagnosis._fields) | {
        "effects": (*EFFECTS, find_effect(CATALOGUE, EFFECT)),
        "forcing": np.zeros((len(FORCED), 2)),
        "accompanied": {},
        "forms": {},
        "beside": {},
        "n_data": 600,
        "log_B": {(): 0.0, names: 5.0},
        "acting": {(): (), names: EFFECTS},
        "judgement": Judgement("named", names, {}, {}, (), names, closed=True),
    }
    assumed, own = (
        Diagnosis(**blank | {"record": one, "fits": {(): base, names: _fitted(one, x, 3)}})
        for one in records
        for base in [_fitted(one, np.zeros(k + 2), 3)]
    )
    both = with_own_inlet(assumed, own)
    assert both.judgement.best == (*names, EFFECT)
    found, wanted = reach(both), reach(own)
    assert found.hypothesis == (*names, EFFECT)
    assert found.log_factor == wanted.log_factor
    assert found.log_factor_sd == pytest.approx(wanted.log_factor_sd, rel=1e-12)
    # a free inlet hides part of what the traces tell of the loss
    assert found.log_factor_sd > 1.01 * reach(assumed).log_factor_sd
