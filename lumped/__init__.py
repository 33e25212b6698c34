"""Lumped (0D) haemodynamics: waveforms, boundary blocks, networks and their periodic states.

Importing this package switches JAX to double precision: the figures promised here (means to
1e-12, periodic waveforms to 1e-8) do not exist in single precision.
"""

import jax

jax.config.update("jax_enable_x64", True)
