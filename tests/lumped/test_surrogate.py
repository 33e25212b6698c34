import jax.numpy as jnp
import numpy as np
import pytest

from lumped import (
    Surrogate,
    VentricularPressure,
    condition_from_clinic,
    ffr_divider,
    mean_state,
    nominal_coronary,
    stress_rule,
)
from lumped.nominal import NOMINAL
from lumped.units import MMHG
from lumped.verification import Pulse
from lumped.vessels import Vessel

T = 0.8


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


def test_pulse_is_periodic():
    pulse = Pulse(2.0, 0.1, 0.3, T)
    assert [float(pulse(t)) for t in (0.05, 0.1, 0.2, 0.3, 0.95)] == [0.0, 2.0, 2.0, 0.0, 2.0]
