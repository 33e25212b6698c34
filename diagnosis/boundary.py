"""Boundary conditions of a 3D model of the proximal vessel from a circuit with its effects.

The 3D model replaces the ostium (R0, K, L, narrowing over the beat, C0). The bed becomes the block
behind its anomalous outlet, P_inlet the pressure at the ostium; sensors act on the results:

| effects | in 3D |
|---|---|
| ostium | not added: the geometry of the 3D model includes its losses, inertia and motion |
| microvasculature, pump, wall (of the bed) | the block behind the anomalous outlet |
| inlet | the pressure at the ostium |
| sensor | the computed pressures, afterwards |

Collaterals of every form enter behind R_1, with the aortic pressure.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from diagnosis.circuit import (
    ELASTIC_SHARE,
    Circuit,
    SensorSpectra,
    autoregulated,
    bypass_conductance,
    sensed,
)
from diagnosis.spectra import PHASE, harmonics, samples
from lumped.extended_coronary import ExtendedCoronary
from lumped.waveforms import Sampled, sampled


class BoundaryConditions(NamedTuple):
    """Boundary conditions of a 3D model of the proximal vessel.

    Attributes:
        bed: the block behind the anomalous outlet.
        P_ostium: pressure in the aorta at the ostium [dyn/cm²] as a function of time.
    """

    bed: ExtendedCoronary
    P_ostium: Sampled


def boundary_conditions(circuit: Circuit) -> BoundaryConditions:
    """Boundary conditions for a circuit, its effects included.

    Blocks of all circuits have the same structure, so a 3D step is compiled once; only a viscous
    wall adds a state.

    Args:
        circuit: one condition, not traced.
    """

    def wave(P: np.ndarray) -> Sampled:
        times = PHASE * float(circuit.period)
        return sampled(times, np.asarray(P), float(circuit.period), kind="cubic")

    P_ostium = wave(np.asarray(circuit.P_inlet))
    viscous = max(float(circuit.wall_time), float(circuit.whole_wall_time))
    share = ELASTIC_SHARE if float(circuit.wall_time) > 0.0 else 0.0
    bed = ExtendedCoronary(
        P_im=wave(np.asarray(circuit.P_LV)),
        P_source=P_ostium,
        R_1=circuit.R_1,
        R_2=circuit.R_2 * autoregulated(circuit),
        R_3=circuit.R_3,
        C_a=circuit.C_a,
        C_im=circuit.C_im,
        P_venous=circuit.P_venous,
        G_collateral=circuit.G_collateral + circuit.G_epicardial + circuit.G_steady,
        G_bypass=bypass_conductance(circuit),
        elastic_share=share if viscous > 0.0 else 1.0,
        wall_time=viscous if viscous > 0.0 else None,
    )
    return BoundaryConditions(bed, P_ostium)


def sensor_traces(circuit: Circuit, P_aorta: np.ndarray, P_distal: np.ndarray) -> np.ndarray:
    """Pressures as recorded by the sensors of a circuit.

    Args:
        circuit: gives the sensors' offsets, gain, lag and delay.
        P_aorta: true pressure in the aorta at `spectra.PHASE` [dyn/cm²].
        P_distal: true pressure behind the ostium there [dyn/cm²].

    Returns:
        Recorded aortic and distal pressure, 2 × samples [dyn/cm²].
    """
    aortic, distal = harmonics(jnp.asarray(np.stack([P_aorta, P_distal])))
    seen = sensed(circuit, SensorSpectra(aortic, distal, jnp.zeros_like(aortic)))
    return np.asarray(samples(jnp.stack([seen.P_aorta, seen.P_distal])))
