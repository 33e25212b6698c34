import pytest

from calibration import bed_flow, bed_for_flow
from lumped import (
    ML_PER_MIN,
    MMHG,
    Shooting,
    Surrogate,
    condition_from_clinic,
    nominal_coronary,
    solve_periodic,
)

REST = condition_from_clinic(104.0, 62.0, 0.74)


def test_nominal_bed_carries_the_flow_of_a_branch():
    flow = float(bed_flow(nominal_coronary(), 80.0 * MMHG)) / ML_PER_MIN
    assert flow == pytest.approx(17.65, abs=0.05)  # 80 mmHg over 4.53 mmHg min/mL


def test_sized_bed_carries_its_flow_and_keeps_its_time_constants():
    own = nominal_coronary(P_venous=6.0 * MMHG)
    bed = bed_for_flow(own, 60.0 * ML_PER_MIN, 75.0 * MMHG)
    # products and quotients
    assert float(bed_flow(bed, 75.0 * MMHG)) / ML_PER_MIN == pytest.approx(60.0, rel=1e-12)
    for R, C in (("R_2", "C_a"), ("R_3", "C_im")):
        before, after = (float(getattr(b, R) * getattr(b, C)) for b in (own, bed))
        assert after == pytest.approx(before, rel=1e-12)
    assert float(bed.P_venous) == float(own.P_venous)


def test_mean_flow_of_a_beat_is_the_one_asked_for():
    bed = bed_for_flow(nominal_coronary(), 50.0 * ML_PER_MIN, (104.0 + 2.0 * 62.0) / 3.0 * MMHG)
    network = Surrogate(R0=1.0, coronary=bed).network(REST)
    solution = solve_periodic(network, REST.period, Shooting(200, order=3))
    mean = float(solution.mean_flow("ostium")) / ML_PER_MIN
    # the mean of the beat is not quite a third of the way from diastole to systole
    assert mean == pytest.approx(50.0, rel=0.12)
