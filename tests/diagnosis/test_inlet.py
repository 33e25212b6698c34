from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from diagnosis import CATALOGUE, diagnose, find_effect, measured, stacked
from diagnosis.circuit import FORCED
from diagnosis.engine import base_start
from diagnosis.fit import Fitted
from diagnosis.forcing import FORCING_HARMONICS
from diagnosis.inlet import (
    SQUEEZE,
    inlet_rms,
    leads,
    recorded_waveform,
    with_free_inlet,
    with_inlet,
    with_inlet_mean,
)
from diagnosis.measured import weights, whitener_of
from diagnosis.own_inlet import needs_own_inlet
from diagnosis.prediction import OWN, SQUEEZE_SD, base_circuit, condition_settings
from diagnosis.resolution import HARMONICS
from diagnosis.result import Diagnosis
from diagnosis.shrink import held_out_gap
from diagnosis.spectra import FROM_SAMPLES, PHASE, TO_SAMPLES
from lumped import MMHG
from tests.diagnosis.records import synthetic

INLET = 2 * FORCING_HARMONICS + 1

# a late second peak and a slower fall, 5 mmHg: no bell of the catalogue has this shape
OTHER = 5.0 * MMHG * (np.sin(4.0 * np.pi * PHASE + 0.4) + 0.6 * np.cos(6.0 * np.pi * PHASE))


def freed(record, later=0.0):
    batch = with_inlet(stacked([measured(record)]))
    x = base_start(batch)
    x[:, SQUEEZE] = later / SQUEEZE_SD
    return with_free_inlet(batch, jnp.asarray(x))


def test_free_inlet_is_the_recorded_less_the_assumed_pressure():
    plain, other = synthetic({}, seed=4), synthetic({}, seed=4, inlet=OTHER)
    difference = np.asarray(freed(other).inlet - freed(plain).inlet)[0]
    # both records have the same unknowns and noise
    assert np.abs(difference - OTHER).max() < 1e-6 * MMHG


def test_modes_hold_what_the_inlet_does_to_both_traces():
    batch = freed(synthetic({}, seed=4, inlet=OTHER))
    record = jax.tree.map(lambda leaf: leaf[0], batch)
    pair = [synthetic({}, seed=4, inlet=scale * OTHER) for scale in (1.0, 1.1)]
    waves = [measured(one).waves for one in pair]
    change = np.asarray(waves[1] - waves[0]) @ FROM_SAMPLES.T
    flat = np.concatenate([change.reshape(4, -1), np.zeros((4, 4))], axis=1)
    seen = np.linalg.norm(np.asarray(whitener_of(record)(jnp.asarray(flat))), axis=1)
    plain = whitener_of(record)._replace(modes=None, lessened=None)
    alone = np.linalg.norm(np.asarray(plain(jnp.asarray(flat))), axis=1)
    # free to vary by itself, a tenth more of it is worth next to nothing
    assert np.all(seen < 0.15 * alone)


def test_the_width_of_a_free_inlet_follows_how_far_it_is_from_the_assumed_one():
    """OTHER has 5 mmHg in harmonic two and 3 in harmonic three."""
    aortic = slice(0, 2 * HARMONICS + 1)
    widths = []
    for inlet in (0.1 * OTHER, OTHER):
        modes = np.asarray(freed(synthetic({}, seed=4, inlet=inlet)).modes)[0]
        columns = modes[:, aortic, -INLET - 1 : -1]
        assert np.all(np.isfinite(columns))
        widths.append(np.linalg.norm(columns[0, :, 2]) / MMHG)
    assert 0.1 < widths[0] < 0.5 * widths[1] < 5.0


def test_a_free_inlet_holds_a_notch_too_sharp_for_its_modes_and_less_noise_than_the_trace():
    k = FORCING_HARMONICS + 4
    notch = 2.0 * MMHG * np.cos(2.0 * np.pi * k * (PHASE - 0.3))
    record = synthetic({}, seed=4, inlet=notch)
    found = np.asarray(freed(record).inlet)[0] @ FROM_SAMPLES.T
    np.testing.assert_allclose(found[:, k], (notch @ FROM_SAMPLES.T)[k], rtol=0.2)
    noise = np.arange(FORCING_HARMONICS + 6, HARMONICS - 10)
    recorded = np.asarray(measured(record).waves)[:, 0] @ FROM_SAMPLES.T
    assert np.linalg.norm(found[:, noise]) < 0.5 * np.linalg.norm(recorded[:, noise])


def test_signals_of_a_free_inlet_follow_what_it_explains_and_nothing_else():
    batch = freed(synthetic({}, seed=4, inlet=OTHER))
    record = jax.tree.map(lambda leaf: leaf[0], batch)
    n = record.n_sensors
    flow = jnp.broadcast_to(record.scalars[:, 3, None, None], (4, 1, PHASE.size))
    seen = jnp.concatenate([jnp.asarray(record.waves), flow], axis=1)[:, :3]
    np.testing.assert_allclose(with_inlet_mean(record, seen), seen, atol=1e-6 * MMHG)
    # one standard deviation of each harmonic of the inlet
    drawn = jnp.asarray(np.random.default_rng(2).standard_normal((4, INLET)))
    change = jnp.einsum("cdr,cr->cd", record.modes[..., -INLET - 1 : -1], drawn)
    change = change[:, :-4].reshape(4, n, -1) @ jnp.asarray(TO_SAMPLES.T)
    missed = seen.at[:, :n].add(-change)
    after = with_inlet_mean(record, missed)[:, :n] - seen[:, :n]
    assert jnp.linalg.norm(after) < 0.1 * jnp.linalg.norm(change)
    # a fast ripple of the distal pressure alone is no matter of the inlet
    ripple = jnp.tile(15.0 * MMHG * jnp.cos(2.0 * jnp.pi * 25 * jnp.asarray(PHASE)), (4, 1))
    moved = with_inlet_mean(record, seen.at[:, 1].add(ripple)) - seen
    assert jnp.linalg.norm(moved[:, 1] - ripple) < 0.2 * jnp.linalg.norm(ripple)


def test_a_place_for_the_inlet_changes_nothing():
    batch = stacked([measured(synthetic({}, seed=4))])
    given = with_inlet(batch)
    y = jnp.asarray(np.random.default_rng(1).standard_normal(given.modes.shape[1:3]))
    first, second = (
        whitener_of(jax.tree.map(lambda leaf: leaf[0], one))(y) for one in (batch, given)
    )
    np.testing.assert_allclose(second, first, atol=1e-9)


def test_the_form_recorded_gives_the_circuit_of_the_free_inlet():
    batch = freed(synthetic({}, seed=4, inlet=OTHER), later=0.02)
    record = jax.tree.map(lambda leaf: leaf[0], batch)
    effect = recorded_waveform(find_effect(CATALOGUE, "aortic_waveform"), record, 0.4)
    size = jnp.asarray(inlet_rms(record) / MMHG)
    own, cases = jnp.zeros(OWN).at[SQUEEZE].set(0.4), condition_settings(record)
    for c in range(4):
        case = jax.tree.map(lambda leaf, c=c: leaf[c], cases)
        free = base_circuit(case, own)
        assumed = base_circuit(case._replace(inlet=None, squeeze_delay=None), own)
        told = effect.change(assumed, size)
        np.testing.assert_allclose(told.P_inlet, free.P_inlet, rtol=1e-12)
        # one shifts the samples, the other 40 harmonics of them
        assert jnp.abs(told.P_LV - free.P_LV).max() < 0.02 * free.P_LV.max()
        none = effect.change(assumed, jnp.zeros(()))
        np.testing.assert_allclose(none.P_LV, assumed.P_LV, atol=1e-12 * free.P_LV.max())


def test_a_forcing_leads_at_the_inlet_alone_or_beside():
    nowhere, there = np.zeros((2, len(FORCED), 2, 2, 4))
    there[FORCED.index("inlet")] = 5.0
    assert leads(there, {})
    assert leads(nowhere, {("a",): there, ("b",): nowhere})
    assert not leads(nowhere, {("a",): there, ("b",): there[::-1] + 9.0})


@pytest.mark.parametrize(
    ("verdict", "misfit", "wanted"),
    [
        ("unknown", 2.0, True),
        ("unknown", 0.5, False),
        ("named", 2.0, False),
        ("no_gap", 2.0, False),
    ],
)
def test_the_inlet_is_freed_where_the_aortic_trace_misfits_and_nothing_explains_it(
    verdict, misfit, wanted
):
    record = measured(synthetic({}, seed=4))
    residual = np.full(np.asarray(weights(record)).shape, np.sqrt(misfit))
    scalar, row = np.zeros(()), np.zeros(2)
    waves = np.zeros((record.n_conditions, 3, 4))
    fit = Fitted(row, row, *[scalar] * 5, residual, row, row, waves, np.array(True))
    fields = dict.fromkeys(Diagnosis._fields)
    fields |= {
        "record": record,
        "effects": CATALOGUE,
        "judgement": SimpleNamespace(verdict=verdict, best=()),
        "fits": {(): fit},
        "forcing": np.zeros((len(FORCED), 1)),
        "accompanied": {},
    }
    assert needs_own_inlet(Diagnosis(**fields)) is wanted


@pytest.mark.slow
def test_effect_behind_another_aortic_waveform_is_named_with_its_size():
    sizes = ({"quadratic_loss": 6.0}, {"vasodilation": 0.6}, {"signal_delay": 0.02}, {})
    records = [synthetic(s, seed=k, inlet=OTHER) for k, s in enumerate(sizes)]
    for diagnosis, truth in zip(
        diagnose(stacked([measured(r) for r in records])), sizes, strict=True
    ):
        judgement = diagnosis.judgement
        assert judgement.verdict == "named"
        assert set(judgement.named) == {*truth, "aortic_waveform"}
        assert find_effect(diagnosis.acting[judgement.best], "aortic_waveform").form == "recorded"
        for name, size in truth.items():
            place = [e.id for e in diagnosis.effects].index(name)
            sd = float(diagnosis.best.size_sd[judgement.best.index(name)])
            assert abs(float(diagnosis.best.sizes[place]) - size) < 5.0 * sd
        (held,) = held_out_gap(diagnosis)
        assert held.P_distal_rms.after < 2.0 * held.P_distal_rms.noise_floor
