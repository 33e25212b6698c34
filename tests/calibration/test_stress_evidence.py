"""Evidence on the response to stress: the published rules lie on its scale, and limits are told."""

import numpy as np
import pytest
from scipy.stats import norm

from calibration import LogNormal, stress_evidence


@pytest.mark.parametrize("age", ["adult", "child", "unknown"])
@pytest.mark.parametrize("drug", ["adenosine", "dobutamine", "other"])
def test_the_prose_of_the_paper_is_likelier_than_its_equations(drug, age):
    bed = stress_evidence(drug, age).bed_factor
    z_prose, z_printed = (float(np.log(f / bed.median) / bed.log_sd) for f in (0.5, 0.912))
    assert abs(z_prose) < 2.0
    assert norm.pdf(z_prose) > norm.pdf(z_printed)


def test_adults_dilate_more_than_children():
    for drug in ("adenosine", "dobutamine"):
        assert (
            stress_evidence(drug, "adult").bed_factor.median
            < stress_evidence(drug, "child").bed_factor.median
        )
        pooled = stress_evidence(drug, "unknown").bed_factor
        assert pooled.log_sd > stress_evidence(drug, "adult").bed_factor.log_sd


def test_a_slit_narrows_under_dobutamine():
    assert stress_evidence("dobutamine").stress_loss.median > 1.1
    assert isinstance(stress_evidence("adenosine").stress_loss, LogNormal)


def test_unknown_drugs_are_refused():
    with pytest.raises(
        ValueError, match="take one of adenosine, dobutamine, other, and one of adult"
    ):
        stress_evidence("regadenoson", "adult")
