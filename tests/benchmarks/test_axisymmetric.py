"""The nozzle by a Taylor-Hood method in (z, r)."""

import pytest

from benchmarks.axisymmetric import axisymmetric_loss
from jaxfsi.verification.nozzle import REFERENCE


def test_loss_converges_to_the_stored_one():
    # 3.41280, 3.40488, 3.40448, 3.40437, 3.40427 with 1, 2, 3, 4 and 6
    errors = [axisymmetric_loss(n) / REFERENCE - 1.0 for n in (1, 2)]
    assert errors[1] == pytest.approx(0.0, abs=3e-4)
    assert abs(errors[1]) < abs(errors[0]) / 4.0
