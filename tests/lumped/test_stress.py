import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from lumped import (
    StressRule,
    connect,
    nominal_coronary,
    scale_resistances,
    stress_rule,
    transition,
)
from lumped.sources import FlowSource, PressureSource
from lumped.units import MMHG
from lumped.verification import BLOCKS
from lumped.vessels import Vessel
from lumped.waveforms import Sinusoid

T = 0.8


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
