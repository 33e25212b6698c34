"""Names of the laws that a case file chooses between."""

LINEAR, QUADRATIC = "linear", "quadratic"
"""Laws of the pressure drop over the anomalous artery in 0D."""

CARREAU_YASUDA = "carreau_yasuda"
"""The law of shear-thinning blood."""
