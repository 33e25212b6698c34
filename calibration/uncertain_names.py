"""Names of the numbers that an uncertain pressure ratio depends on; others are the case's own."""

REST_PREFIX = "rest_"
"""Begins the name of a pressure or period at rest, `rest_period`."""

DILATION = "dilation"
"""Common factor of the resistances of the bed under stress, times those of the rule."""

BED_FACTOR = "bed_factor"
"""Resistance of the whole bed under stress over that at rest; the rule says how its parts share."""

STRESS_LOSS = "stress_loss"
"""Factor of R0 and K under stress, as a narrower slit has it."""
