import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lumped import (
    PeriodicSolution,
    Propagator,
    Surrogate,
    condition_from_clinic,
    ifr,
    metrics,
    systolic_share,
)
from lumped.metrics import mean_between, sampled_ifr
from lumped.units import MMHG
from lumped.waveforms import sampled

T = 0.8


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


def test_sampled_ifr_is_that_of_the_periodic_state(by_hand):
    t = np.linspace(0.0, 2.0, 4001)
    aorta, distal = (
        np.interp(t, by_hand.t, by_hand.pressure(name), period=1.0) for name in ("aorta", "distal")
    )
    # samples 0.5 ms apart; the window begins between two of them
    assert sampled_ifr(t, aorta, distal, 1.0) == pytest.approx(float(ifr(by_hand)), rel=1e-3)
    assert sampled_ifr(t[:1000], aorta[:1000], distal[:1000], 1.0) is None
