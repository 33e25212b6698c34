"""Ranges that other cohorts published of what the priors of a body say.

None of these numbers was used to make a prior. Units: cm, mL/min, L/min, g, years. The figure of
docs/body.md is drawn from them::

    python -m tests.calibration.published_children
"""

import math
import pathlib

import matplotlib.pyplot as plt

from calibration import Body, aortic_root_diameter, body_surface_area, coronary_flow
from calibration import left_ventricular_mass as lv_mass
from calibration.body import (
    diastolic_pressure,
    resting_period,
    stroke_volume,
    systolic_pressure,
)
from calibration.growth_charts import height_at, weight_at
from jaxfsi.anatomy import coronary_diameter
from lumped import MMHG

STROKE_DISTANCE = (17.1, 30.4)
"""Of the aorta above 1 year [cm], 90 % of 23.76 ± 4.03 (Ahn et al. 1990, J Korean Pediatr Soc
33:1074)."""


def child(age: float, male: bool, score: float) -> Body:
    """A child whose height and weight lie at the same standard score of the growth charts."""
    sex = float(male)
    weight, height = (float(at(age, sex, score)) for at in (weight_at, height_at))
    return Body(weight, height, age, sex)


def said(body: Body) -> dict[str, float]:
    """What the priors say, their medians."""
    area = float(body_surface_area(body))
    return {
        "cardiac output": float(stroke_volume(body) / resting_period(body)) * 0.06,
        "coronary flow": float(coronary_flow(body)) * 60.0,
        "left ventricular mass": float(lv_mass(body)),
        "left main diameter": coronary_diameter("left", area),
        "right coronary diameter": coronary_diameter("right", area),
        "aortic sinus diameter": float(aortic_root_diameter("sinus", area)),
    }


def published(body: Body) -> dict[str, tuple[float, float]]:
    """Least and largest value of each by the other sources."""
    area = float(body_surface_area(body))
    annulus = math.pi / 4.0 * float(aortic_root_diameter("annulus", area)) ** 2
    rate = 60.0 / float(resting_period(body))
    output = tuple(annulus * distance * rate / 1000.0 for distance in STROKE_DISTANCE)
    # between the least of magnetic resonance, women's 52.0 - 2 · 7.4 g/m² (Alfakih et al. 2003,
    # JMRI 17:323), and the largest of M-mode ultrasound, 115 BSA - 11 g + 32 % (105 persons of
    # 1 day to 23 years, Circulation 1981); its lower end, - 32 %, exceeds 4 of 30 children by 1 %
    mass = (37.2 * area, 1.32 * (115.0 * area - 11.0))
    return {
        "cardiac output": output,
        "coronary flow": (_doppler_flow(body, area), 0.05 * 1000.0 * output[1]),
        "left ventricular mass": mass,
        "left main diameter": _mccrindle(area, 0.31747, 0.36008, -0.02887, 0.03040, 0.01514),
        "right coronary diameter": _mccrindle(area, 0.26117, 0.39920, -0.02756, 0.02407, 0.01597),
        "aortic sinus diameter": _kaiser(area),
    }


def _doppler_flow(body: Body, area: float) -> float:
    """Flow of the left anterior descending artery alone [mL/min], which both arteries exceed.

    Peak diastolic velocity 20 − 0.34 age + 0.16 rate cm/s (Aoki et al. 2003, Tohoku J Exp Med
    199:211, 303 children); half of it on average over a parabolic profile, 0.6 of that in the mean
    of the beat; diameter −0.150 + 2.267 √BSA mm (Dallaire & Dahdah 2011).
    """
    assert body.age_years is not None
    rate = 60.0 / float(resting_period(body))
    velocity = 20.0 - 0.34 * float(body.age_years) + 0.16 * rate
    diameter = 0.1 * (-0.150 + 2.267 * area**0.5)
    return 60.0 * 0.3 * velocity * math.pi / 4.0 * diameter**2


def _mccrindle(area, factor, power, offset, sd_0, sd_1) -> tuple[float, float]:
    """Coronary diameter ± 2 sd [cm] (McCrindle et al. 2007, Circulation 116:174)."""
    middle, sd = factor * area**power + offset, sd_0 + sd_1 * area
    return middle - 2.0 * sd, middle + 2.0 * sd


def _kaiser(area: float) -> tuple[float, float]:
    """Aortic sinus by magnetic resonance (Kaiser et al. 2008, JCMR 10:56), ± 15 %."""
    middle = 0.057 + 1.937 * area**0.5
    return 0.85 * middle, 1.15 * middle


def draw(file: pathlib.Path) -> None:
    """Draw medians over age beside the published ranges.

    Args:
        file: picture to write.
    """
    ages = [4.0 + 0.5 * k for k in range(27)]
    boys, girls = ([child(age, male, 0.0) for age in ages] for male in (True, False))
    figure, axes = plt.subplots(2, 3, figsize=(10.5, 6.2), layout="constrained")
    rate, pressure, *others = axes.flat
    rate.plot(ages, [60.0 / float(resting_period(b)) for b in boys], "C0")
    rate.plot([5.0, 13.5], [96.0, 78.0], "k.", label="Ostchega 2011")
    rate.errorbar([7.0], [78.0], [[14.0], [22.0]], fmt="s", color="C7", label="Seppälä 2014")
    rate.set(title="heart rate [1/min]", ylim=(50, 125))
    kinds = ((systolic_pressure, "C0", "systolic"), (diastolic_pressure, "C1", "diastolic"))
    for of, colour, name in kinds:
        for bodies, line in ((boys, "-"), (girls, "--")):
            pressure.plot(ages, [float(of(b)) / MMHG for b in bodies], line, color=colour,
                          label=name if line == "-" else None)  # fmt: skip
    pressure.set(title="pressures [mmHg]", ylim=(30, 140))
    panels = (
        ("cardiac output [L/min]", ("cardiac output",), 1.0),
        ("coronary flow, both arteries [mL/min]", ("coronary flow",), 1.0),
        ("coronary diameter [mm]", ("left main diameter", "right coronary diameter"), 10.0),
        ("aortic sinus [mm]", ("aortic sinus diameter",), 10.0),
    )
    for axis, (title, names, factor) in zip(others, panels, strict=True):
        for colour, name in zip(("C0", "C1"), names, strict=False):
            low, high = zip(*(published(b)[name] for b in boys), strict=True)
            low, high = ([factor * v for v in end] for end in (low, high))
            axis.fill_between(ages, low, high, color=colour, alpha=0.15, lw=0)
            short = name.removesuffix(" diameter")
            for bodies, line, label in ((boys, "-", short), (girls, "--", None)):
                values = [factor * said(b)[name] for b in bodies]
                axis.plot(ages, values, line, color=colour, label=label)
        axis.set(title=title, ylim=(0.0, None))
    for axis in axes.flat:
        axis.set_xlabel("age [years]")
        if len(axis.get_legend_handles_labels()[0]) > 1:
            axis.legend(frameon=False, fontsize=8)
    figure.savefig(file, dpi=110)


if __name__ == "__main__":
    draw(pathlib.Path(__file__).parents[2] / "docs" / "_static" / "body.png")
