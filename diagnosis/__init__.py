"""The gap between simulation and measurement."""

from diagnosis.gap import RATIO_SD, RatioGap, ratio_gap
