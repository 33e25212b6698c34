import numpy as np
import pytest
import scipy.special
import scipy.stats

from jaxfsi.anatomy import (
    PUBLISHED,
    Measures,
    anatomy_from_measures,
    parameter_faults,
    sample_anatomies,
    sample_measures,
)
from jaxfsi.anatomy.sources.cohort import (
    Published,
    half_axes,
    truncated_normal,
)

N_PUBLISHED = 81  # patients behind the table


def ellipse_perimeter(major: np.ndarray, minor: np.ndarray) -> np.ndarray:
    """Perimeter from half axes."""
    return 4.0 * major * scipy.special.ellipe(1.0 - (minor / major) ** 2)


@pytest.fixture(scope="module")
def large() -> Measures:
    return sample_measures(np.random.default_rng(7), 20_000)


@pytest.mark.parametrize("name", PUBLISHED)
def test_moments_match_the_table_within_its_sampling_error(large: Measures, name: str) -> None:
    row, values = PUBLISHED[name], getattr(large, name)
    # Two standard errors of 81 patients: sd/√81 of the mean, sd/√(2·81) of the deviation.
    assert values.mean() == pytest.approx(row.mean, abs=2.0 * row.sd / np.sqrt(N_PUBLISHED))
    assert values.std() == pytest.approx(row.sd, rel=2.0 / np.sqrt(2.0 * N_PUBLISHED))
    assert row.low <= values.min()
    assert values.max() <= row.high


def test_moments_that_no_cut_off_normal_has_are_refused() -> None:
    # even values from 0 to 1 alike deviate by 0.289 only
    with pytest.raises(ValueError, match="smaller deviation"):
        truncated_normal(Published(0.5, 0.3, 0.0, 1.0))


def test_quantities_derived_from_the_draws_match_the_table(large: Measures) -> None:
    error = 1.0 / np.sqrt(N_PUBLISHED)
    ostial = half_axes(large.ostial_area_mm2, large.ostial_ellipticity)
    wall = half_axes(large.intramural_area_mm2, large.intramural_ellipticity)
    stenosis = 1.0 - large.intramural_area_mm2 / large.reference_area_mm2
    # Not fitted. Real ostia are fuller than the ellipse of their widths (area/(π/4 · a · b) = 1.1),
    # so widths may be high by 5 % besides two standard errors.
    for values, mean, sd in (
        (2.0 * ostial[0], 4.58, 0.92),
        (2.0 * ostial[1], 1.69, 0.47),
        (2.0 * wall[0], 3.89, 0.81),
        (2.0 * wall[1], 1.66, 0.42),
        (ellipse_perimeter(*ostial), 10.92, 1.95),
        (stenosis, 0.50, 0.17),
    ):
        assert values.mean() == pytest.approx(mean, abs=2.0 * sd * error + 0.05 * mean)
        assert values.std() == pytest.approx(sd, rel=0.25)


def test_resistance_index_has_the_published_size(large: Measures) -> None:
    area = large.intramural_area_mm2
    perimeter = ellipse_perimeter(*half_axes(area, large.intramural_ellipticity))
    index = large.length_mm * (perimeter / area) ** 4  # L P⁴/A⁴ [1/mm³]
    # 179.9 ± 261, median 116.6; a fourth power, so its mean is known to 2 · 261/9 = 58 only.
    assert index.mean() == pytest.approx(179.9, abs=2.0 * 261.0 / np.sqrt(N_PUBLISHED))
    assert np.median(index) == pytest.approx(116.6, rel=0.3)
    # The cut-off for ischaemia, 406, is passed by about the 6.2 % found with adenosine.
    assert 0.02 < np.mean(index >= 406.0) < 0.14


def test_implied_correlations_are_met(large: Measures) -> None:
    def rank(a: np.ndarray, b: np.ndarray) -> float:
        return float(scipy.stats.spearmanr(a, b).statistic)

    # Truncation and redrawing weaken a correlation a little: 0.1 besides the rank's 3 %.
    assert rank(large.ostial_area_mm2, large.ostial_ellipticity) == pytest.approx(-0.37, abs=0.12)
    assert rank(large.intramural_area_mm2, large.reference_area_mm2) == pytest.approx(
        0.45, abs=0.12
    )
    assert rank(large.length_mm, large.take_off_deg) == pytest.approx(0.0, abs=0.03)


def test_draws_depend_on_the_seed_alone() -> None:
    assert sample_anatomies(5, 20) == sample_anatomies(5, 20)
    assert sample_anatomies(5, 3) != sample_anatomies(6, 3)


def test_children_are_drawn_smaller() -> None:
    adult, child = (sample_anatomies(5, 300, age=age) for age in ("adult", "paediatric"))
    ratio = np.mean([p.tube_radius for p in child]) / np.mean([p.tube_radius for p in adult])
    # √(1.45/1.9) = 0.874 on average, within 3 standard errors of 300 draws.
    assert ratio == pytest.approx(0.87, abs=0.03)
    assert min(p.reference_radius for p in child) < min(p.reference_radius for p in adult)


def test_flat_and_short_courses_are_raised_to_what_can_be_built() -> None:
    p = anatomy_from_measures(
        "right",
        ostial_area_mm2=6.0,
        ostial_ellipticity=2.0,
        intramural_area_mm2=5.0,
        intramural_ellipticity=2.0,
        reference_area_mm2=11.0,
        take_off_deg=0.0,
        length_mm=0.0,
        septum_mm=0.6,
    )
    assert not parameter_faults(p)
    assert p.intramural_length < 0.45
    assert p.intramural_area == pytest.approx(0.05)


def test_impossible_requests_are_refused() -> None:
    with pytest.raises(ValueError, match="Give a number"):
        sample_anatomies(0, -1)
    assert sample_anatomies(0, 0) == []
    for n in (0, -1):
        with pytest.raises(ValueError, match=f"measures of {n} patients. Ask for at least one"):
            sample_measures(np.random.default_rng(0), n)
