"""Conversion factors between clinical units and the CGS units used inside.

Inside, pressures are dyn/cm², flows cm³/s, resistances dyn·s/cm⁵ and compliances cm⁵/dyn.
Multiply by a factor on reading, divide by it on reporting::

    P = 120.0 * MMHG            # mmHg -> dyn/cm²
    Q_reported = Q / ML_PER_MIN  # cm³/s -> mL/min
"""

MMHG = 1333.22
"""One millimetre of mercury [dyn/cm²]."""

ML_PER_MIN = 1.0 / 60.0
"""One millilitre a minute [cm³/s]."""

L_PER_MIN = 1000.0 / 60.0
"""One litre a minute [cm³/s]."""

MMHG_S_PER_ML = MMHG
"""One mmHg·s/mL, the clinical unit of resistance [dyn·s/cm⁵]."""

MM = 0.1
"""One millimetre [cm]."""
