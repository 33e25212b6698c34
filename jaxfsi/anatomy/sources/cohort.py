"""Anatomies drawn at random from the published distributions of anomalous coronary arteries.

Adult cross-sections, take-off angle and length follow the 81 patients of Mokhtari et al. 2026
(CT angiography, diastole). Each quantity is a truncated normal whose mean and standard deviation
*after* truncation to the observed range are those of the table; a Gaussian copula correlates them.

Correlations that the table implies (CV = standard deviation over mean, areas ∝ major · minor and
ellipticities = major / minor, first order)::

    ρ(area, ellipticity) = (CV_major² − CV_minor²)/(CV_area CV_ellipticity)
                         = −0.37 at the ostium, −0.20 in the wall
    ρ(area, reference area) = 0.45    from the spread 0.17 of their ratio, 1 − area stenosis

The table says nothing of how ostium and intramural lumen go together; 0.5 for like quantities is
an assumption. Children's vessels follow the body surface area (`scaled_anatomy`).
"""

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
import scipy.optimize
import scipy.stats
from jaxtyping import Float

from jaxfsi.anatomy.sources.parameters import (
    ADULT_SURFACE_AREA_M2,
    Side,
    SyntheticParameters,
    coronary_diameter,
    parameter_faults,
    scaled_anatomy,
    shortest_intramural_length,
)
from lumped.units import MM

Age = Literal["adult", "paediatric"]


class Published(NamedTuple):
    """One row of the table: moments and observed range.

    Attributes:
        mean: arithmetic mean.
        sd: standard deviation.
        low: smallest value observed.
        high: largest value observed.
    """

    mean: float
    sd: float
    low: float
    high: float


class TruncatedNormal(NamedTuple):
    """A normal distribution cut off at both ends.

    Attributes:
        mean: of the whole normal.
        sd: likewise.
        low: lower end.
        high: upper end.
    """

    mean: float
    sd: float
    low: float
    high: float

    def quantile(self, uniform: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Values below which these shares lie."""
        low, high = ((end - self.mean) / self.sd for end in (self.low, self.high))
        return scipy.stats.truncnorm.ppf(uniform, low, high, loc=self.mean, scale=self.sd)


PUBLISHED: dict[str, Published] = {
    "ostial_area_mm2": Published(6.69, 2.27, 1.34, 13.0),
    "ostial_ellipticity": Published(2.89, 0.85, 1.0, 5.3),
    "intramural_area_mm2": Published(5.55, 1.94, 1.27, 10.4),
    "intramural_ellipticity": Published(2.46, 0.72, 1.0, 4.8),
    "reference_area_mm2": Published(11.62, 3.35, 5.0, 22.0),
    "take_off_deg": Published(22.9, 11.6, 0.0, 43.0),
    "length_mm": Published(10.41, 4.20, 0.0, 21.5),
}
"""Geometry of 81 adults with an intramural right coronary artery (Mokhtari et al. 2026)."""

# Between the quantities above, in their order; the last two are independent of all others.
_CORRELATION = np.eye(len(PUBLISHED))
_CORRELATION[:5, :5] = [
    [1.0, -0.37, 0.5, -0.2, 0.3],
    [-0.37, 1.0, -0.2, 0.5, 0.0],
    [0.5, -0.2, 1.0, -0.2, 0.45],
    [-0.2, 0.5, -0.2, 1.0, 0.0],
    [0.3, 0.0, 0.45, 0.0, 1.0],
]
_SMALLEST_MINOR_MM = 0.9  # in the table, at the ostium and in the wall
_WIDEST_MINOR_MM = (3.1, 2.8)  # at the ostium, in the wall
_WIDEST_MAJOR_MM = (7.1, 5.8)

# The modelled artery must part from the aorta within its course; flatter and shorter ones are
# steepened and lengthened to these.
_LEAST_TAKE_OFF_DEG = 15.0
_LEAST_LENGTH_MM = 3.0

# Septum: 0.4..1.2 mm about 0.6 (the patient of the open intravascular record: 0.9..1.3).
_SEPTUM_MM = Published(0.62, 0.15, 0.4, 1.2)
# 60 kg at 13 years (Doan et al. 2020): 1.45 m² with a deviation of 0.34. A cut-off normal of 0.35
# there is none, even values from 0.8 to 2 alike have 0.346; this one rises by two thirds.
_SURFACE_AREA_M2 = TruncatedNormal(22.696911926160787, 7.169055027010367, 0.8, 2.0)
_ROOT_SPREAD = 0.08  # of aortic diameters at one body size, relative
_CORONARY_SPREAD = 0.13  # of normal coronary diameters (Tan et al. 2003: 0.02/0.15)


class Measures(NamedTuple):
    """What the table lists, for each adult drawn; areas mm², lengths mm, angles degrees."""

    ostial_area_mm2: Float[np.ndarray, " patients"]
    ostial_ellipticity: Float[np.ndarray, " patients"]
    intramural_area_mm2: Float[np.ndarray, " patients"]
    intramural_ellipticity: Float[np.ndarray, " patients"]
    reference_area_mm2: Float[np.ndarray, " patients"]
    take_off_deg: Float[np.ndarray, " patients"]
    length_mm: Float[np.ndarray, " patients"]


@functools.cache
def truncated_normal(row: Published) -> TruncatedNormal:
    """The normal that, cut off at the observed range, has the moments of a row.

    Raises:
        ValueError: there is none.
    """

    def mismatch(x: Float[np.ndarray, " 2"]) -> list[float]:
        mean, sd = x[0], math.exp(x[1])
        law = scipy.stats.truncnorm((row.low - mean) / sd, (row.high - mean) / sd, mean, sd)
        return [(law.mean() - row.mean) / row.sd, law.std() / row.sd - 1.0]

    # to round-off: what is drawn shall not depend on where an iteration ends on some processor
    start, least = [row.mean, math.log(row.sd)], 1e-15
    solution = scipy.optimize.least_squares(mismatch, start, ftol=least, xtol=least, gtol=least)
    if np.max(np.abs(solution.fun)) > 1e-10:
        raise ValueError(
            f"no normal cut off at {row.low} and {row.high} has the mean {row.mean} and the"
            f" deviation {row.sd}. Take a smaller deviation, or wider limits."
        )
    mean, log_sd = map(float, solution.x)
    return TruncatedNormal(mean, math.exp(log_sd), row.low, row.high)


def half_axes(
    area: Float[np.ndarray, " n"], ellipticity: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Half axes (major, minor) of ellipses of given area and ratio of axes."""
    minor = np.sqrt(area / (np.pi * ellipticity))
    return minor * ellipticity, minor


def _plausible(measures: Measures) -> np.ndarray:
    """Which draws have widths in the observed ranges and an intramural lumen below reference."""
    fits = measures.intramural_area_mm2 <= measures.reference_area_mm2
    shapes = (
        (measures.ostial_area_mm2, measures.ostial_ellipticity),
        (measures.intramural_area_mm2, measures.intramural_ellipticity),
    )
    for shape, widest_minor, widest_major in zip(
        shapes, _WIDEST_MINOR_MM, _WIDEST_MAJOR_MM, strict=True
    ):
        major, minor = (2.0 * half for half in half_axes(*shape))
        fits &= (minor >= _SMALLEST_MINOR_MM) & (minor <= widest_minor) & (major <= widest_major)
    return fits


def sample_measures(generator: np.random.Generator, n: int) -> Measures:
    """Draw what the table lists for n adults.

    Draws whose widths leave the observed ranges, or whose intramural lumen is larger than the
    reference, are drawn again.

    Args:
        generator: source of random numbers.
        n: number of patients, at least one.

    Raises:
        ValueError: n is less than one.
    """
    if n < 1:
        raise ValueError(f"cannot draw the measures of {n} patients. Ask for at least one.")
    root = np.linalg.cholesky(_CORRELATION)
    kept: list[np.ndarray] = []
    while sum(len(part) for part in kept) < n:
        normal = generator.standard_normal((2 * n + 20, len(PUBLISHED))) @ root.T
        uniform = scipy.stats.norm.cdf(normal)
        columns = [
            truncated_normal(row).quantile(uniform[:, i])
            for i, row in enumerate(PUBLISHED.values())
        ]
        kept.append(np.stack(columns, axis=1)[_plausible(Measures(*columns))])
    return Measures(*np.concatenate(kept)[:n].T)


def _steep_and_long_enough(p: SyntheticParameters) -> SyntheticParameters:
    """Steepen the take-off as little as needed for the septum to form; then lengthen."""
    for angle in np.radians(np.arange(math.degrees(p.take_off_angle), 75.0, 1.0)):
        p = dataclasses.replace(p, take_off_angle=float(angle))
        if shortest_intramural_length(p) <= p.intramural_length:
            return p
    return dataclasses.replace(p, intramural_length=1.01 * shortest_intramural_length(p))


def anatomy_from_measures(
    side: Side,
    *,
    ostial_area_mm2: float,
    ostial_ellipticity: float,
    intramural_area_mm2: float,
    intramural_ellipticity: float,
    reference_area_mm2: float,
    take_off_deg: float,
    length_mm: float,
    septum_mm: float,
) -> SyntheticParameters:
    """Parameters of an adult anatomy from clinical measures.

    Take-offs flatter than 15° and courses shorter than 3 mm are raised to that; where the artery
    could still not reach its depth in the wall, the take-off is steepened as little as needed.

    Args:
        side: which artery is anomalous.
        ostial_area_mm2: area of the ostium [mm²].
        ostial_ellipticity: its major over its minor width.
        intramural_area_mm2: area of the intramural lumen [mm²].
        intramural_ellipticity: its major over its minor width.
        reference_area_mm2: area of the artery beyond its intramural course [mm²].
        take_off_deg: angle between artery and aortic wall [degrees].
        length_mm: of the intramural course [mm].
        septum_mm: thickness of tissue between the two lumens [mm].
    """
    ostial = half_axes(np.array([ostial_area_mm2]), np.array([ostial_ellipticity]))
    major, minor = (float(2.0 * half[0]) * MM for half in ostial)
    return _steep_and_long_enough(
        SyntheticParameters(
            side=side,
            take_off_angle=math.radians(max(take_off_deg, _LEAST_TAKE_OFF_DEG)),
            intramural_length=max(length_mm, _LEAST_LENGTH_MM) * MM,
            septum=septum_mm * MM,
            ostium_major=major,
            ostium_minor=minor,
            hypoplasia=intramural_area_mm2 / reference_area_mm2,
            ellipticity=intramural_ellipticity,
            reference_radius=math.sqrt(reference_area_mm2 / math.pi) * MM,
        )
    )


def _with_body(
    p: SyntheticParameters, generator: np.random.Generator, age: Age
) -> SyntheticParameters:
    """Vary root, heights and the normal artery, and scale all to the size of the body."""
    root = math.exp(_ROOT_SPREAD * float(np.clip(generator.standard_normal(), -2.0, 2.0)))
    coronary = 1.0 + _CORONARY_SPREAD * float(np.clip(generator.standard_normal(), -2.0, 2.0))
    names = ("annulus_radius", "sinus_radius", "junction_radius", "tube_radius")
    changes = {name: getattr(p, name) * root for name in names}
    other: Side = "right" if p.side == "left" else "left"
    p = dataclasses.replace(
        p,
        **changes,
        normal_radius=coronary * coronary_diameter(other, ADULT_SURFACE_AREA_M2) / 2.0,
        ostium_height=p.junction_height + float(generator.uniform(-0.1, 0.5)),
        ostium_angle=float(generator.uniform(0.25, 0.45)),
        course_angle=float(generator.uniform(0.0, 0.3)),
        bend_angle=float(generator.uniform(0.3, 0.6)),
    )
    surface_area = float(_SURFACE_AREA_M2.quantile(generator.uniform(size=1))[0])
    return p if age == "adult" else scaled_anatomy(p, surface_area)


def sample_anatomies(
    seed: int | Sequence[int], n: int, *, side: Side = "right", age: Age = "adult"
) -> list[SyntheticParameters]:
    """Draw valid anatomies from the published distributions.

    The same seed gives the same anatomies; the first of a larger draw are not those of a smaller.

    Args:
        seed: of the random numbers.
        n: number of anatomies.
        side: which artery is anomalous. The table is of right ones and is used for both.
        age: ``adult`` (1.9 m²) or ``paediatric`` (0.8 to 2 m² of body surface).

    Raises:
        ValueError: n is negative, or age is neither.
    """
    if n < 0 or age not in ("adult", "paediatric"):
        raise ValueError(
            f"cannot draw {n} anatomies of age {age!r}. Give a number and adult or paediatric."
        )
    generator = np.random.default_rng(seed)
    drawn: list[SyntheticParameters] = []
    while len(drawn) < n:
        measures = sample_measures(generator, n - len(drawn))
        septum = truncated_normal(_SEPTUM_MM).quantile(generator.uniform(size=n - len(drawn)))
        for row, thickness in zip(zip(*measures, strict=True), septum, strict=True):
            named = dict(zip(Measures._fields, map(float, row), strict=True))
            adult = anatomy_from_measures(side, **named, septum_mm=float(thickness))
            p = _steep_and_long_enough(_with_body(adult, generator, age))
            if not parameter_faults(p):
                drawn.append(p)
    return drawn
