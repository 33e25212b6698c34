import math

import pytest

from study.report.number_formats import signed, significant, span, with_sd


@pytest.mark.parametrize(
    ("value", "text"), [(0.5, "+0.50"), (-0.5, "−0.50"), (0.001, "0.00"), (-0.001, "0.00")]
)
def test_signed_numbers(value, text):
    assert signed(value) == text


def test_significant_digits_and_ranges():
    assert significant(0.12345) == "0.123"
    assert significant(None) == "–"
    assert span([1.0, 2.3456]) == "1 to 2.35"


@pytest.mark.parametrize(
    ("value", "sd", "text"),
    [
        (4.1234, 0.4321, "4.12 ± 0.43"),
        (1.16e-18, 2.9, "0.0 ± 2.9"),
        (-1e-3, 2.9, "0.0 ± 2.9"),
        (-0.51, 0.019, "-0.510 ± 0.019"),
        (1234.0, 56.0, "1234 ± 56"),
        (123456.0, 7890.0, "123500 ± 7900"),
        (2.3456e-9, 1.2e-10, "2.35e-09 ± 1.2e-10"),
        (3.0, 0.0, "3 ± 0"),
        (3.0, math.inf, "3 ± inf"),
    ],
)
def test_a_number_with_its_standard_deviation(value, sd, text):
    assert with_sd(value, sd) == text
