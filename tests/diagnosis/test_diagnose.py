import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from diagnosis import CATALOGUE, diagnose, measured, stacked
from diagnosis.cohort import pool
from diagnosis.effects import all_forms
from diagnosis.engine import run_fits
from diagnosis.evidence import Whitened, log_size_factor, posterior
from diagnosis.hypothesis import numbers_of, uncertain_signals
from diagnosis.measured import whitener_of
from diagnosis.next_measurement import (
    FLOW_ERROR,
    aliases,
    flow_gains,
    isolability,
    next_measurements,
)
from diagnosis.scan import linearise, score_scan
from diagnosis.shrink import fitted_gap, held_out_gap
from diagnosis.singles import strained, worth_fitting
from diagnosis.where import forcing_shares, joint_map, place_probabilities, rest_map
from lumped import MMHG
from tests.diagnosis.records import NAMES, synthetic

CAUSES = (
    {"vasodilation": 0.5},
    {"quadratic_loss": 6.0},
    {"signal_delay": 0.02},
    {},
    {"sensor_height": -5.0, "intramyocardial_pump": 0.7},
    {"distal_damping": 0.02},
)


@pytest.fixture(scope="module")
def found():
    records = [synthetic(sizes, seed=k) for k, sizes in enumerate(CAUSES)]
    return diagnose(stacked([measured(record) for record in records]))


def _is_strained(diagnosis):
    """Whether its fits have several starts, see `diagnosis.singles`."""
    return bool(strained(jax.tree.map(lambda leaf: np.asarray(leaf)[None], diagnosis.base))[0])


@pytest.mark.slow
def test_single_causes_are_named_with_their_sizes(found):
    for diagnosis, sizes in zip(found[:3], CAUSES[:3], strict=True):
        (name, size) = next(iter(sizes.items()))
        assert diagnosis.judgement.verdict == "named"
        assert diagnosis.judgement.named == (name,)
        fitted = diagnosis.fits[(name,)]
        # five posterior standard deviations: one seed, three effects
        assert abs(float(fitted.sizes[NAMES.index(name)]) - size) < 5.0 * float(fitted.size_sd[0])


@pytest.mark.slow
def test_no_cause_is_no_gap(found):
    judgement = found[3].judgement
    assert judgement.verdict == "no_gap"
    assert sum(judgement.probabilities.values()) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.slow
def test_two_causes_are_both_found(found):
    inclusion = found[4].judgement.inclusion
    assert inclusion["intramyocardial_pump"] > 0.8
    assert inclusion["sensor_height"] + inclusion["aortic_zero_error"] > 0.8


@pytest.mark.slow
def test_a_patient_far_from_the_priors_hides_no_effect(found):
    """The base model makes up for a damped distal trace by an artery of many times its compliance,
    and fits that start there stay there."""
    assert _is_strained(found[5])
    assert found[5].judgement.named == ("distal_damping",)
    fitted = found[5].fits[("distal_damping",)]
    size, sd = float(fitted.sizes[NAMES.index("distal_damping")]), float(fitted.size_sd[0])
    assert abs(size - 0.02) < 5.0 * sd


def test_a_form_is_fitted_where_prediction_or_scan_come_near_the_best():
    #                    best   near  far    by its scan, weak or strong
    expected = np.array([[20.0, 10.0, 5.0, -9.0], [3000.0, 9.0, 9.0, 9.0], [-1.0, 0.4, -3.0, -3.0]])
    scanned = np.array(
        [[20.0, 1.0, 5.0, 9.0], [2700.0, 2650.0, 2000.0, 60.0], [-2.0, 0.4, 1.2, -0.1]]
    )
    wanted = [[True, True, False, True], [True, True, False, False], [False, True, True, False]]
    np.testing.assert_array_equal(worth_fitting(expected, scanned, np.zeros((3, 4))), wanted)
    # where its effect leads by far, or comes near, whatever the scan says
    first = np.array([[0.0] * 4, [3000.0, 3000.0, 2990.0, 2900.0], [20.0] * 4])
    wanted[1] = [True, True, True, False]
    np.testing.assert_array_equal(worth_fitting(expected, scanned, first), wanted)


@pytest.mark.slow
def test_the_held_out_gap_shrinks_to_the_noise(found):
    (held,) = held_out_gap(found[1])
    assert held.P_distal_rms is not None
    assert held.P_distal_rms.before > 2.0 * held.P_distal_rms.noise_floor
    # noise and the posterior of the fit: 0.5 to 1.2 mmHg over eight seeds, the floor is 0.7
    assert held.P_distal_rms.after < 2.0 * held.P_distal_rms.noise_floor
    assert fitted_gap(found[1]).after < 0.2 * fitted_gap(found[1]).before


@pytest.mark.slow
def test_no_fit_that_starts_there_ends_above_the_base_optimum(found):
    forms = all_forms(CATALOGUE)
    pairs = [(k, -1) for k, form in enumerate(forms) if not form.form]
    for diagnosis in found[:4]:
        batch, start = stacked([diagnosis.record]), np.asarray(diagnosis.base.optimum)
        starts = np.tile(start, (len(pairs), 1))
        fits = run_fits(batch, [0] * len(pairs), pairs, starts, numbers_of(forms), forms)
        assert np.all(fits.sound)
        # the cost of a one-sided size that went below zero is that of zero
        sided = np.array([forms[k].one_sided for k, _ in pairs])
        inside = ~sided | (fits.optimum[:, -2] >= 0.0)
        assert inside.sum() > 10
        assert np.all(fits.cost[inside] <= float(diagnosis.base.cost) + 1e-6)


@pytest.mark.slow
def test_maps_point_to_the_condition_and_to_the_model(found):
    after_rest = rest_map(found[0].record)
    assert after_rest is not None
    assert after_rest.blocks[0].condition in (1, 2)  # vasodilation acts under stress alone
    assert joint_map(found[3]).p_value > 0.01
    assert joint_map(found[1]).p_value < 0.01
    for diagnosis, place in zip(found[:3], ("microvasculature", "ostium", "sensor"), strict=True):
        at = place_probabilities(diagnosis)
        assert sum(at.values()) == pytest.approx(1.0, abs=1e-12)
        assert at[place] > 0.8
    assert sum(forcing_shares(found[2]).values()) == pytest.approx(1.0, abs=1e-12)


def test_a_flow_is_worth_what_its_dense_covariance_says():
    first, second = 2.0 + np.random.default_rng(4).random((2, 3, 256))
    n = 16
    sd = FLOW_ERROR * first.mean(axis=1)
    apart = (first - second)[:, ::16] / sd[:, None]
    both = np.eye(n) + np.ones((n, n))
    blind = np.eye(n) + 1e9 * np.ones((n, n))
    of_mean, of_wave = flow_gains(first, second, has_mean=False)
    expected = [0.5 * sum(d @ np.linalg.solve(R, d) for d in apart) for R in (both, blind)]
    assert of_wave == pytest.approx(expected[0], rel=1e-9)
    assert flow_gains(first, second, has_mean=True)[1] == pytest.approx(expected[1], rel=1e-6)
    means = (first - second).mean(axis=1) / sd
    assert of_mean == pytest.approx(0.5 * means @ means)


@pytest.mark.slow
def test_aliases_and_next_measurements_are_consistent(found):
    # nothing but the shape of a trace tells them apart (cosine near 1)
    assert ("vasodilation", "r1_r3_dilation") in aliases(found[4])
    for option in next_measurements(found[4]):
        assert option.expected_log_bayes_factor >= 1.0
    richer = isolability(found[3].record, CATALOGUE, 0.5 * MMHG)
    counts = [sum(v >= 3.0 for v in richer[name].values()) for name in ("means", "waveforms")]
    assert counts[1] > counts[0]


@pytest.mark.slow
def test_score_scan_agrees_with_the_exact_linear_evidence(found):
    diagnosis = found[0]
    numbers = numbers_of(CATALOGUE)
    zero = jnp.zeros(len(CATALOGUE))
    line = linearise(diagnosis.record, CATALOGUE, numbers, jnp.asarray(diagnosis.base.x), zero)
    scan = score_scan(line, numbers)
    (e, J), G = line.linear, line.effects
    alone = posterior(Whitened(e, J)).log_evidence
    names = ("inertance", "wire_drift", "aortic_zero_error")
    for chosen in (*itertools.combinations(names, 1), *itertools.combinations(names, 2)):
        added, n = [NAMES.index(name) for name in chosen], len(chosen)
        sided = jnp.zeros(J.shape[-1] + n).at[-n:].set(numbers.one_sided[jnp.array(added)])
        joined = Whitened(e, jnp.concatenate([J, G[..., added]], axis=-1))
        after = posterior(joined, None, sided)
        moments = log_size_factor(after.mean[-n:], jnp.diagonal(after.covariance)[-n:], sided[-n:])
        exact = after.log_evidence - alone + jnp.sum(moments)
        given = scan.log_B[added[0]] if n == 1 else scan.pair_log_B[added[0], added[1]]
        # the same linear-Gaussian integral done in two ways
        assert float(given) == pytest.approx(float(exact), rel=1e-6, abs=1e-6)


@pytest.mark.slow
def test_only_a_guessed_form_is_tolerated(found):
    """An effect whose form is exact keeps it when an effect with a guessed form joins."""
    numbers = numbers_of(CATALOGUE)
    record = found[0].record
    exact, guessed = NAMES.index("vasodilation"), NAMES.index("back_pressure")
    x = jnp.asarray(np.asarray(found[0].base.x))

    def columns(pair, sizes):
        x_ = x.at[-2:].set(jnp.array(sizes))
        own = uncertain_signals(record, CATALOGUE, numbers, jnp.array(pair), x_, nonlinear=False)
        return own.freedoms(whitener_of(record)).own[0]

    assert float(jnp.abs(columns((exact, -1), (1.0, 0.0))).max()) == 0.0
    assert float(jnp.abs(columns((exact, guessed), (1.0, 0.0))).max()) == 0.0
    assert float(jnp.abs(columns((exact, guessed), (1.0, 1.0))).max()) > 0.0


@pytest.mark.slow
def test_pooled_patients_say_more_than_one(found):
    pooled = pool([found[0]] * 3)
    assert pooled.patients == 3
    assert pooled.named == ("vasodilation",)
    with pytest.raises(ValueError, match="at least one diagnosis"):
        pool([])


@pytest.mark.slow
def test_diagnosis_of_a_batch_equals_that_of_one(found):
    alone = diagnose(stacked([measured(synthetic(CAUSES[2], seed=2))]))[0]
    for name, p in alone.judgement.probabilities.items():
        # fits end within their tolerance whatever else is in the block
        assert p == pytest.approx(found[2].judgement.probabilities[name], abs=1e-3)


@pytest.mark.slow
def test_a_poor_record_abstains():
    record = synthetic({"back_pressure": 8.0}, seed=9)
    judgement = diagnose(stacked([measured(record, "ffr")]))[0].judgement
    assert judgement.verdict in ("no_gap", "ambiguous")
    with pytest.raises(ValueError, match="is not known"):
        measured(record, "everything")
