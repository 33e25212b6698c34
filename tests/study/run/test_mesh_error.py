"""The mesh error of a ramp, from curves of two meshes whose error is known."""

import dataclasses

import numpy as np
import pytest

from calibration import RampRecord
from lumped import MMHG
from study import demo_case_path, read_case
from study.run.fitted_ramp import fitted
from study.run.mesh_error import compared
from study.run.second_mesh import second, second_faults
from study.run.study_choice import RampChoice

CASE = read_case(demo_case_path())
A, B = 700.0, 650.0
ACROSS = 3.6, 2.3
T = np.linspace(0.0, 1.0, 101)
Q = 7.5 * T


def on_mesh(n):
    """Curve of a mesh whose resistance is too large by 5/n⁴."""
    share = 1.0 + 5.0 / n**4
    record = RampRecord(T, share * A * Q + share**2 * B * Q**2, np.zeros_like(T), Q)
    return fitted(record, RampChoice()).fit


@pytest.fixture(scope="module")
def found():
    return compared(CASE, (on_mesh(ACROSS[0]), on_mesh(ACROSS[1])), ACROSS, 20_000)


def test_resistance_without_mesh_error_is_found(found):
    band, exact = found.tangent_40_mmHg, np.sqrt(A**2 + 4.0 * B * 40.0 * MMHG)
    # the fit has an inertance beside the curve, which moves it by 1e-5
    assert band.value == pytest.approx(exact * (1.0 + 5.0 / ACROSS[0] ** 4), rel=1e-3)
    assert band.expected == pytest.approx(exact, rel=1e-3)
    assert band.low < exact < band.high < band.value


def test_flow_follows_the_resistance_and_ffr_does_not(found):
    share = found.tangent_40_mmHg.expected / found.tangent_40_mmHg.value
    flow = found.rest_flow_ml_per_min
    # pressures are the same, so that flow goes with 1/R and alpha with R, but for the compliances
    # of the bed, which do not follow: they move the waveform of the flow, and its mean by 0.3 %
    assert flow.expected / flow.value == pytest.approx(1.0 / share, rel=1e-2)
    assert found.alpha.expected / found.alpha.value == pytest.approx(share, rel=1e-2)
    assert flow.low <= flow.expected <= flow.high
    assert set(found.ffr) == {name for name in CASE.conditions if name != "rest"}
    for band in found.ffr.values():
        assert band.expected == pytest.approx(band.value, abs=1e-3)


def test_a_coarse_mesh_is_told_by_a_finer_one():
    fine, coarse = (on_mesh(n) for n in ACROSS)
    band = compared(CASE, (coarse, fine), (ACROSS[1], ACROSS[0]), 40_000).tangent_40_mmHg
    exact = np.sqrt(A**2 + 4.0 * B * 40.0 * MMHG)
    assert band.expected == pytest.approx(exact, rel=1e-3)
    assert band.low < exact < band.high < band.value


def test_second_mesh_has_half_the_elements_across_or_more_where_these_are_few():
    for preset, across in (("coarse", 4), ("medium", 3), ("fine", 4)):
        mesh = dataclasses.replace(CASE.mesh, preset=preset)
        assert second(dataclasses.replace(CASE, mesh=mesh)).mesh.elements_across == across
    three = dataclasses.replace(CASE.mesh, elements_across=3)
    assert second(dataclasses.replace(CASE, mesh=three)).mesh.elements_across == 6


def test_finished_mesh_has_no_second_one(tube, tmp_path):
    (fault,) = second_faults(read_case(tube.write_case(tmp_path)))
    assert "leave --mesh-error out" in str(fault)
    assert not second_faults(CASE)
