import pathlib
import re

import jax.numpy as jnp
import pytest

from calibration import PRIORS, Body, LogNormal, body_priors
from tests.calibration.published_children import child, published, said

CHILDREN = [
    (age, male, score)
    for age, scores in ((4.0, (-1.645, 1.645)), (7.0, (0.0,)), (10.0, (-1.645, 1.645)),
                        (13.0, (0.0,)), (17.0, (-1.645, 0.0, 1.645)))
    for male in (False, True)
    for score in scores
]  # fmt: skip


@pytest.mark.parametrize(("age", "male", "score"), CHILDREN)
def test_children_lie_within_the_ranges_of_other_cohorts(age, male, score):
    body = child(age, male, score)
    found, ranges = said(body), published(body)
    for name, (low, high) in ranges.items():
        assert low < found[name] < high, (
            f"{name}: {found[name]:.3g}, published {low:.3g}..{high:.3g}"
        )


def test_index_of_young_adults_is_that_of_magnetic_resonance():
    # Carlsson et al. 2012, JCMR 14:51: 3.3 ± 0.4 l/min/m² at 20 to 29 years
    for male in (False, True):
        body = child(20.0, male, 0.0)
        area = body_priors(body)["stroke_volume"].value(jnp.zeros(())) / 42.5
        assert said(body)["cardiac output"] / float(area) == pytest.approx(3.3, abs=0.4)


def test_flow_per_gram_lies_among_the_studies_and_theirs_within_its_spread():
    flow = body_priors(Body(height=150.0))["coronary_flow"]
    per_gram = [
        float(flow.value(jnp.array(z))) * 60.0 / (1.28 * 103.1) for z in (-1.645, 0.0, 1.645)
    ]
    # means at rest of Yates et al. 2000, Sdringola et al. 2011, ammonia in patients without
    # coronary disease (EJNMMI Rep 2018) and in volunteers (Kiso et al.) [mL/min/g]
    for mean in (0.69, 0.72, 1.02, 1.26):
        assert per_gram[0] < mean < per_gram[2]


def test_priors_are_those_whose_numbers_are_known():
    assert set(body_priors(Body(age_years=9.0))) == {"period"}
    assert set(body_priors(Body())) == set()
    assert set(body_priors(child(9.0, True, 0.0))) == {prior.name for prior in PRIORS}
    assert "left_flow" in body_priors(Body(height=130.0))


def test_every_prior_has_unit_source_and_spread():
    spreads = body_priors(child(9.0, True, 0.0))
    for prior in PRIORS:
        spread = spreads[prior.name]
        sd = spread.log_sd if isinstance(spread, LogNormal) else spread.sd / spread.mean
        assert prior.source
        assert prior.unit
        assert 0.05 < float(sd) < 0.5, prior.name


def test_page_names_the_source_of_every_prior():
    page = (pathlib.Path(__file__).parents[2] / "docs" / "body.md").read_text()
    table = page.partition("## What is assumed")[2].partition("Height scores")[0]
    for prior in PRIORS:
        cited = re.findall(r"([A-Z]\w+)[^;,]*?((?:19|20)\d\d)", prior.source)
        assert cited
        for author, year in cited:
            assert re.search(rf"{author}.*{year}", table), prior.source
