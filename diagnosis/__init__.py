"""The gap between simulation and measurement: where it lies, what causes it, how far it shrinks."""

from typing import TYPE_CHECKING

from lumped.lazy_package import import_on_first_use

if TYPE_CHECKING:
    from diagnosis.catalogue import CATALOGUE
    from diagnosis.diagnose import diagnose
    from diagnosis.effects import PLACES, Effect, apply_effects, find_effect
    from diagnosis.gap import RATIO_SD, RatioGap, ratio_gap
    from diagnosis.measured import SCALARS, SENSORS, Measured
    from diagnosis.record import (
        RICHNESS,
        Folding,
        Noise,
        Record,
        RecordedCondition,
        measured,
        noise_of,
        stacked,
    )
    from diagnosis.result import Diagnosis
    from diagnosis.verdict import Judgement

__all__ = [
    "CATALOGUE",
    "PLACES",
    "RATIO_SD",
    "RICHNESS",
    "SCALARS",
    "SENSORS",
    "Diagnosis",
    "Effect",
    "Folding",
    "Judgement",
    "Measured",
    "Noise",
    "RatioGap",
    "Record",
    "RecordedCondition",
    "apply_effects",
    "diagnose",
    "find_effect",
    "measured",
    "noise_of",
    "ratio_gap",
    "stacked",
]

import_on_first_use(__name__)
