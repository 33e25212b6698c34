import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import jv

from diagnosis import CATALOGUE, Effect, find_effect, measured
from diagnosis.circuit import FORCED, LAYER_TIME, boundary_layers
from diagnosis.effects import all_forms
from diagnosis.prediction import (
    TRANSMISSION_SD,
    as_waves,
    base_circuit,
    condition_settings,
    observations,
    predict,
)
from diagnosis.resolution import HARMONICS
from diagnosis.spectra import PHASE
from lumped import (
    MMHG,
    Fourier,
    Shooting,
    Surrogate,
    condition_from_clinic,
    nominal_coronary,
    solve_periodic,
    stress_rule,
)
from study.case.onsets import find_upstrokes
from tests.diagnosis.records import settings

FORMS = all_forms(CATALOGUE)
ADENOSINE = 1
OWN = jnp.asarray(np.array([0.3, -0.2, 0.4, -0.3, 0.2, 0.6, 0.7, 0.0, 0.5, -0.4]))
ONE_WAY = OWN.at[6].set(0.0)  # no flow past the muscle: the paper's bed


def case():
    one = jax.tree.map(lambda leaf: leaf[ADENOSINE], condition_settings(measured(settings())))
    return one._replace(dobutamine=one.adenosine)  # both, so that every effect shows


@jax.jit
def data(sizes):
    return observations(predict(case(), OWN, FORMS, sizes), 3)


@jax.jit
def linear_data(sizes):
    return observations(predict(case(), OWN, FORMS, sizes, nonlinear=False), 3)


def named(effect):
    return f"{effect.id}, {effect.form}" if effect.form else effect.id


def size_of(**sizes):
    """Sizes of the effects that are named, zero for the others."""
    return jnp.asarray([sizes.get(effect.id, 0.0) for effect in CATALOGUE])


def surrogate(K: float | None = None):
    circuit = base_circuit(case(), OWN)
    nominal = nominal_coronary()
    bed = nominal_coronary(
        C_a=nominal.C_a * jnp.exp(0.4 * OWN[2]),
        C_im=nominal.C_im * jnp.exp(0.4 * OWN[3]),
        im_factor=1.0 + TRANSMISSION_SD * OWN[5],
    )
    model = Surrogate(
        R0=circuit.R0,
        alpha=0.25 * jnp.exp(OWN[1]),
        coronary=bed,
        C0=circuit.C0,
        K=None if K is None else K * MMHG,
    )
    setting = condition_from_clinic(105.0 + 2.0 * 0.5, 60.0 - 2.0 * 0.4, 0.7)
    return model.network(setting, rule=stress_rule("printed")), setting.period


def test_base_circuit_is_the_surrogate_of_the_paper():
    network, period = surrogate()
    exact = solve_periodic(network, period, Fourier(n_samples=1024))
    waves = as_waves(predict(case(), ONE_WAY, CATALOGUE, jnp.zeros(len(CATALOGUE))))
    step = 1024 // PHASE.size
    distal = np.asarray(exact.pressure("distal"))[::step]
    # 40 harmonics of a pressure with kinks: 0.1 mmHg next to them, 0.03 rms
    assert np.sqrt(np.mean((distal - waves[1]) ** 2)) < 0.05 * MMHG
    assert float(waves[1].mean()) == pytest.approx(float(exact.mean_pressure("distal")), 1e-4)


def test_quadratic_loss_agrees_with_shooting():
    network, period = surrogate(K=6.0)
    exact = solve_periodic(network, period, Shooting(n_steps=256))
    sizes = size_of(quadratic_loss=6.0)
    waves = as_waves(predict(case(), ONE_WAY, CATALOGUE, sizes))
    there = np.interp(PHASE * float(period), exact.t, np.asarray(exact.pressure("distal")))
    # the flow's harmonics above 24 see the mean of the nonlinear slope: 0.06 mmHg rms
    assert np.sqrt(np.mean((there - np.asarray(waves[1])) ** 2)) < 0.1 * MMHG
    assert abs(there.mean() - float(waves[1].mean())) < 0.02 * MMHG


def test_a_known_quadratic_loss_is_that_of_the_effect_and_narrows_with_the_vessel():
    own = OWN.at[0].set(0.0)
    known = case()._replace(K=jnp.asarray(6.0 * MMHG), L=jnp.asarray(0.05 * MMHG))
    sizes = size_of(quadratic_loss=6.0, inertance=0.05)
    given = observations(predict(known, own, (), jnp.zeros(0), nonlinear=False), 3)
    np.testing.assert_allclose(
        given, observations(predict(case(), own, CATALOGUE, sizes), 3), rtol=1e-12
    )
    narrow = find_effect(CATALOGUE, "proximal_resistance")
    wider = base_circuit(known._replace(R0_sd_log=jnp.asarray(0.2)), OWN)
    changed = narrow.change(base_circuit(known, own), jnp.asarray(0.2 * 0.3))
    # the prior's width and the effect both move the whole curve
    np.testing.assert_allclose(changed.R0, wider.R0, rtol=1e-12)
    np.testing.assert_allclose(changed.K_known, wider.K_known, rtol=1e-12)


def test_boundary_layers_are_those_of_womersley():
    omega = 2.0 * np.pi * np.linspace(0.2, 30.0, 200)
    s = 1j * omega * LAYER_TIME
    root = 2j * np.sqrt(s)  # the argument i^(3/2) a √(ω/ν)
    exact = s / (1.0 - 2.0 * jv(1, root) / (root * jv(0, root)))
    found = 2.0 + s + np.asarray(boundary_layers(jnp.asarray(omega))) * LAYER_TIME
    # of a closed form for two series; the steady part is Poiseuille's 8ν/a² = 2/τ
    assert np.max(np.abs(found / exact - 1.0)) < 0.03


def test_a_forcing_of_the_flow_sensor_moves_the_measured_flow_alone():
    forced = jnp.zeros((len(FORCED), HARMONICS + 1), complex)
    forced = forced.at[FORCED.index("flow sensor"), 0].set(5.0 * MMHG)
    plain, moved = (
        as_waves(predict(case(), OWN, (), jnp.zeros(0), nonlinear=False, forced=f))
        for f in (None, forced)
    )
    np.testing.assert_array_equal(moved[:2], plain[:2])
    # 5 mmHg stand for an error of a fifth of the mean flow
    np.testing.assert_allclose(moved[2] - plain[2], 0.2 * plain[2].mean(), rtol=1e-9)


def test_an_effect_of_size_zero_changes_nothing():
    plain = observations(predict(case(), OWN, (), jnp.zeros(0), nonlinear=False), 3)
    zero = data(jnp.zeros(len(FORMS)))
    # round-off of pressures near 100 mmHg through a linear solve
    np.testing.assert_allclose(zero, plain, rtol=0.0, atol=1e-10 * MMHG)


@pytest.mark.parametrize("k", range(len(FORMS)), ids=[named(form) for form in FORMS])
def test_jacobian_of_every_form_matches_central_differences(k):
    effect = FORMS[k]
    at = jnp.zeros(len(FORMS)).at[k].set(0.5 * effect.sd)
    h = 1e-4 * effect.sd
    exact = jacobian(at)[:, k]
    central = (data(at.at[k].add(h)) - data(at.at[k].add(-h))) / (2.0 * h)
    scale = float(jnp.max(jnp.abs(exact)))
    assert scale > 0.0
    # truncation h²/6 f''' and |Q|'s kink in the quadratic loss
    np.testing.assert_allclose(central, exact, atol=2e-6 * scale)


@jax.jit
def data_of_all_conditions(sizes):
    cases = condition_settings(measured(settings()))
    return jax.vmap(lambda c: observations(predict(c, OWN, FORMS, sizes), 3))(cases)


def test_forms_of_an_effect_share_its_id_and_differ_in_what_they_do():
    for effect in CATALOGUE:
        own = [k for k, form in enumerate(FORMS) if form.id == effect.id]
        assert len({FORMS[k].form for k in own}) == len(own) == 1 + len(effect.forms)
        seen = [
            np.asarray(data_of_all_conditions(jnp.zeros(len(FORMS)).at[k].set(effect.sd)))
            for k in own
        ]
        for k, one, other in zip(own[1:], seen, seen[1:], strict=False):
            assert np.max(np.abs(other - one)) > 0.01 * MMHG, FORMS[k].form


def test_aligned_catheter_leaves_the_upstroke_where_beats_are_cut():
    period = float(case().period)
    effects = {e.form: e for e in FORMS if e.id == "catheter_damping"}

    def upstroke(form, ms):
        beat = predict(case(), OWN, (effects[form],), jnp.asarray([1e-3 * ms]))
        P = np.tile(np.asarray(as_waves(beat))[0] / MMHG, 5)
        return np.mean(find_upstrokes(np.arange(P.size) * period * 5 / P.size, P, period).at)

    true = upstroke("", 0.0)
    assert 1e3 * (upstroke("", 20.0) - true) > 15.0
    # beats are cut by the steepest point of a smoothed trace, which ringing moves by some ms
    for form, ms, off in (("aligned", 40.0, 2.0), ("aligned, underdamped", 10.0, 4.0)):
        assert 1e3 * abs(upstroke(form, ms) - true) < off, form


@pytest.mark.parametrize("k", range(len(FORMS)), ids=[named(form) for form in FORMS])
def test_an_effect_that_needs_the_nonlinear_solution_says_so(k):
    effect = FORMS[k]
    sizes = jnp.zeros(len(FORMS)).at[k].set(effect.sd)
    full, linear = data(sizes), linear_data(sizes)
    declared = full if effect.nonlinear else linear
    # round-off of pressures near 100 mmHg through a linear solve
    np.testing.assert_allclose(declared, full, rtol=0.0, atol=1e-10 * MMHG)
    if effect.nonlinear:  # and is not slow for nothing
        assert float(jnp.max(jnp.abs(full - linear))) > 0.01 * MMHG


@jax.jit
def jacobian(sizes):
    return jax.jacfwd(data)(sizes)


def test_a_user_adds_an_effect_in_ten_lines():
    leak = Effect(
        id="leak",
        place="wall",
        unit="cm5/(dyn s)",
        sd=1.5e-6,
        change=lambda c, size: c._replace(G_collateral=c.G_collateral + size),
        equation="Q = G (P_inlet - P_2)",
        sentence="blood leaks past the ostium",
        settled_by="an occlusion pressure",
        source="assumed",
    )
    more = observations(predict(case(), OWN, (leak,), jnp.ones(1) * 1.5e-6), 2)
    less = observations(predict(case(), OWN, (leak,), jnp.zeros(1)), 2)
    assert float(more[-3]) > float(less[-3])  # the distal mean rises


def test_the_squeeze_is_late_by_its_unknown_where_the_record_has_a_delay():
    late = OWN.at[7].set(2.0)
    plain = base_circuit(case(), OWN)
    np.testing.assert_array_equal(base_circuit(case(), late).P_LV, plain.P_LV)
    freed = case()._replace(squeeze_delay=jnp.asarray(0.025))
    np.testing.assert_allclose(
        base_circuit(freed, late).P_LV, jnp.roll(plain.P_LV, PHASE.size // 8), atol=1e-6 * MMHG
    )
