"""How long commands usually take."""

CASE_SECONDS = {"curve": 10.0, "3d": 3000.0}
"""Of a case of a cohort, by its mode [s]."""
