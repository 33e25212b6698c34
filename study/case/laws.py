"""Names of the laws that a case file chooses between."""

LINEAR, QUADRATIC = "linear", "quadratic"
"""Laws of the pressure drop over the anomalous artery in 0D."""

FIBRES = "holzapfel_gasser_ogden"
"""The law of a wall with collagen fibres."""

CARREAU_YASUDA = "carreau_yasuda"
"""The law of shear-thinning blood."""
