import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lumped import (
    PeriodicSolution,
    Propagator,
    StressRule,
    Surrogate,
    VentricularPressure,
    condition_from_clinic,
    connect,
    ffr_divider,
    ifr,
    mean_state,
    metrics,
    nominal_coronary,
    scale_resistances,
    stress_rule,
    systolic_share,
    transition,
)
from lumped.metrics import mean_between
from lumped.nominal import NOMINAL
from lumped.sources import FlowSource, PressureSource
from lumped.units import MMHG
from lumped.verification import BLOCKS, Pulse
from lumped.vessels import Vessel
from lumped.waveforms import Sinusoid, sampled

T = 0.8


# Stress rules.


def test_printed_rule_lowers_the_nominal_total_by_8_8_percent_and_the_prose_by_half():
    bed = nominal_coronary()
    lowered = [1.0 - float(stress_rule(n)(bed).R_total / bed.R_total) for n in ("printed", "all")]
    assert lowered[0] == pytest.approx(0.5 * 6.3984e4 / 3.62576e5, rel=1e-12)
    assert round(100 * lowered[0], 1) == 8.8
    assert lowered[1] == pytest.approx(0.5, rel=1e-15)


@pytest.mark.parametrize("name", ["printed", "all"])
def test_rule_scales_what_it_names(name):
    bed, wk = nominal_coronary(), BLOCKS["rcr"]
    stressed, wk_stressed = stress_rule(name)(bed), stress_rule(name)(wk)
    factors = {"R_2": 0.5, "C_a": 2.0, "C_im": 2.0, "R_1": 1.0, "R_3": 1.0}
    if name == "all":
        factors |= {"R_1": 0.5, "R_3": 0.5}
    for key, factor in factors.items():
        assert float(getattr(stressed, key) / getattr(bed, key)) == factor
    assert float(wk_stressed.R_distal / wk.R_distal) == 0.5
    assert float(wk_stressed.C / wk.C) == 2.0
    assert float(wk_stressed.R_proximal / wk.R_proximal) == (0.5 if name == "all" else 1.0)
    assert float(wk_stressed.P_ref) == float(wk.P_ref)


def test_rules_that_make_no_sense_are_refused():
    with pytest.raises(ValueError, match="not known"):
        stress_rule("prose")
    with pytest.raises(ValueError, match="R_2"):
        StressRule(R_2=0.0)


def test_scale_factor_multiplies_the_three_resistances_only():
    bed, scaled = nominal_coronary(), scale_resistances(nominal_coronary(), 0.25)
    assert float(scaled.R_total / bed.R_total) == pytest.approx(0.25, rel=1e-15)
    assert float(scaled.C_im) == float(bed.C_im)


# Rest to stress.


@pytest.fixture(scope="module")
def conditions():
    def bed(**factors):
        base = eqx.tree_at(
            lambda b: b.P_im, BLOCKS["coronary"], Sinusoid(50.0 * MMHG, 30.0 * MMHG, T)
        )
        return eqx.tree_at(
            lambda b: tuple(getattr(b, k) for k in factors), base, tuple(factors.values())
        )

    def network(coronary, C0, L):
        inlet = PressureSource(Sinusoid(90.0 * MMHG, 20.0 * MMHG, T))
        return connect(
            {
                "inlet": (inlet, "aorta"),
                "ostium": (Vessel(5e3, C=C0, L=L), "aorta", "distal"),
                "coronary": (coronary, "distal"),
            }
        )

    stress = bed(C_a=jnp.asarray(9e-7), C_im=jnp.asarray(6e-6), im_factor=jnp.asarray(1.1))
    return network(bed(), 1e-7, 2.0), network(stress, 2e-7, 4.0)


def test_transition_keeps_pressures_or_volumes(conditions):
    rest, stress = conditions
    x = jnp.array([9e4, 1.2, 8e4, 3e4])
    held = transition(x, rest, stress, hold="pressure")
    start = jnp.zeros(())
    np.testing.assert_allclose(
        held + stress.external_pressure(start), x + rest.external_pressure(start), rtol=1e-15
    )
    # a flow through an inertance and a pressure without surrounding pressure stay what they are
    np.testing.assert_allclose(held[:3], x[:3], rtol=1e-15)
    assert abs(float(held[3] - x[3])) > 1e3
    volumes = transition(x, rest, stress, hold="volume")
    np.testing.assert_allclose(volumes * stress.mass(), x * rest.mass(), rtol=1e-15)


def test_transition_refuses_what_does_not_match(conditions):
    rest, stress = conditions
    with pytest.raises(ValueError, match="not known"):
        transition(jnp.zeros(4), rest, stress, hold="flow")
    other = connect({"q": (FlowSource(Sinusoid(1.0, 1.0, T)), "n"), "b": (BLOCKS["rcr"], "n")})
    with pytest.raises(ValueError, match="same elements and states"):
        transition(jnp.zeros(4), rest, other)


# The surrogate.


def test_surrogate_network_is_that_of_the_paper(rest):
    patient = Surrogate(R0=5e3, alpha=0.3)
    network = patient.network(rest, rule=stress_rule("printed"))
    bed = network["coronary"]
    assert float(bed.R_2) == pytest.approx(0.5 * 0.3 * NOMINAL["R_2"], rel=1e-15)
    assert float(bed.C_im) == 2 * NOMINAL["C_im"]
    assert isinstance(bed.P_im, VentricularPressure)
    assert float(bed.P_im.P_peak) == float(rest.P_systolic)
    assert network["ostium"].K_stenosis is None
    assert network.nodes == ("aorta", "distal")


def test_divider_is_the_mean_of_the_direct_current_network(rest):
    bed = nominal_coronary(P_venous=8.0 * MMHG, R_2=5e4)
    network = Surrogate(R0=5e3, alpha=0.2, coronary=bed).network(rest)
    z = mean_state(network, rest.period)
    P_aorta, P_distal = (float(z[network.pressure_index(n)]) for n in ("aorta", "distal"))
    expected = ffr_divider(5e3, 0.2 * bed.R_total, P_aorta, 8.0 * MMHG)
    assert P_distal / P_aorta == pytest.approx(float(expected), rel=1e-14)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Surrogate(R0=-1.0), "R0"),
        (lambda: Surrogate(R0=1.0, alpha=0.0), "alpha"),
        (lambda: Surrogate(R0=1.0, C0=0.0), "C0"),
        (lambda: Surrogate(R0=1.0, K=-1.0), "K"),
        (lambda: Vessel(1.0, K_stenosis=float("nan")), "K_stenosis"),
        (lambda: Vessel(1.0, L=0.0), "Vessel.L"),
        (lambda: condition_from_clinic(110.0, 0.0, T), "P_diastolic"),
        (lambda: nominal_coronary(R_4=1.0), "R_4"),
    ],
)
def test_impossible_patients_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_clinical_numbers_of_any_kind_are_converted_once():
    condition = condition_from_clinic(np.float64(110.0), 65, jnp.asarray(0.8))
    assert float(condition.P_systolic) == 110.0 * MMHG
    assert float(condition.P_diastolic) == 65.0 * MMHG
    assert condition.period.dtype == jnp.float64


# Metrics on waveforms made by hand.


@pytest.fixture(scope="module")
def by_hand(solved) -> PeriodicSolution:
    """Aorta 100 mmHg; distal a polygon; flow 3 in systole and 1 in diastole, steep between."""
    distal = sampled([0.0, 0.2, 0.5, 0.7], np.array([80.0, 100.0, 60.0, 90.0]) * MMHG, 1.0)
    flow = sampled([0.0, 1e-9, 0.35, 0.35 + 1e-9], [1.0, 3.0, 3.0, 1.0], 1.0)
    grid = np.unique(
        np.concatenate(
            [np.linspace(0, 1, 40, endpoint=False), *map(np.asarray, (distal.times, flow.times))]
        )
    )
    P, Q = (np.array([float(w(t)) for t in grid]) for w in (distal, flow))
    network = Surrogate(R0=1.0).network(condition_from_clinic(110.0, 65.0, 1.0))
    template = solved(network, 1.0, Propagator(8))
    z = np.zeros((grid.size, network.n_unknowns))
    z[:, network.pressure_index("aorta")] = 100.0 * MMHG
    z[:, network.pressure_index("distal")] = P
    z[:, network.flow_index("ostium")] = Q
    closed_t, closed_z = np.append(grid, 1.0), np.vstack([z, z[:1]])
    mean = np.sum(0.5 * np.diff(closed_t)[:, None] * (closed_z[1:] + closed_z[:-1]), axis=0)
    return eqx.tree_at(
        lambda s: (s.t, s.z, s.mean),
        template,
        (jnp.asarray(grid), jnp.asarray(z), jnp.asarray(mean)),
    )


def test_metrics_of_a_waveform_made_by_hand(by_hand):
    # distal: 80 -> 100 (0.2 s), 100 -> 60 (0.3 s), 60 -> 90 (0.2 s), 90 -> 80 (0.3 s)
    mean = 0.2 * 90 + 0.3 * 80 + 0.2 * 75 + 0.3 * 85
    m = metrics(by_hand)
    assert float(m.ratio) == pytest.approx(mean / 100.0, rel=1e-12)
    assert float(m.mean_P_aorta) == pytest.approx(100.0 * MMHG, rel=1e-12)
    # wave-free period: from 0.35 + 0.65/4 = 0.5125 to 0.995
    start, end = 0.5125, 0.995
    P_start, P_end = 60.0 + 150.0 * 0.0125, 80.0 + (10.0 / 0.3) * 0.005
    area = (0.7 - start) * 0.5 * (P_start + 90.0) + (end - 0.7) * 0.5 * (90.0 + P_end)
    assert float(m.ifr) == pytest.approx(area / (end - start) / 100.0, rel=1e-12)
    # flow: 3 for 0.35 s, 1 for 0.65 s
    assert float(m.systolic_share) == pytest.approx(1.05 / 1.7, rel=1e-8)
    assert float(m.flow_ml_per_min) == pytest.approx(1.7 * 60.0, rel=1e-8)


def test_valve_closure_can_be_given(by_hand):
    assert float(systolic_share(by_hand, t_valve=0.175)) == pytest.approx(0.525 / 1.7, rel=1e-8)
    late = ifr(by_hand, t_valve=0.6)
    area = 90.0 - (10.0 / 0.3) * 0.5 * (0.0 + 0.295)
    assert float(late) == pytest.approx(area / 100.0, rel=1e-9)


def test_mean_between_is_exact_for_a_polygon(by_hand):
    values = by_hand.pressure("distal") / MMHG
    assert float(mean_between(by_hand, values, 0.0, 1.0)) == pytest.approx(82.5, rel=1e-12)
    assert float(mean_between(by_hand, values, 0.1, 0.2)) == pytest.approx(95.0, rel=1e-12)
    assert float(mean_between(by_hand, values, 0.93, 0.99)) == pytest.approx(
        80.0 + (10.0 / 0.3) * 0.04, rel=1e-12
    )


def test_metrics_that_mean_nothing_are_nan(by_hand):
    backwards = eqx.tree_at(lambda s: (s.z, s.mean), by_hand, (-by_hand.z, -by_hand.mean))
    found = metrics(backwards)
    assert all(np.isnan(x) for x in (found.ratio, found.ifr, found.systolic_share))
    values = by_hand.pressure("distal")
    for window in ((0.2, 0.2), (0.3, 0.1), (-0.1, 0.5), (0.5, 1.1), (0.5, math.nan)):
        assert np.isnan(mean_between(by_hand, values, *window))
    for t_valve in (0.0, -0.1, 1.0, math.nan):
        for reading in (ifr, systolic_share):
            with pytest.raises(ValueError, match="within the cycle"):
                reading(by_hand, t_valve=t_valve)
            assert np.isnan(jax.jit(lambda t, read=reading: read(by_hand, t_valve=t))(t_valve))


def test_ifr_and_share_of_the_surrogate_converge(rest, solved):
    network = Surrogate(R0=5e3, alpha=0.2).network(rest)
    coarse, fine = (metrics(solved(network, T, Propagator(n))) for n in (512, 2048))
    # trapezoids on the samples: second order
    assert float(coarse.ifr) == pytest.approx(float(fine.ifr), abs=2e-5)
    assert float(coarse.systolic_share) == pytest.approx(float(fine.systolic_share), abs=2e-4)
    assert float(coarse.ratio) == pytest.approx(float(fine.ratio), rel=1e-13)


def test_pulse_is_periodic():
    pulse = Pulse(2.0, 0.1, 0.3, T)
    assert [float(pulse(t)) for t in (0.05, 0.1, 0.2, 0.3, 0.95)] == [0.0, 2.0, 2.0, 0.0, 2.0]
