"""From a circuit with its effects to what a 3D model of the proximal vessel takes from it.

The 3D model replaces the ostium (R0, K, L, narrowing over the beat, C0). Its anomalous outlet takes
the bed, its aorta the inlet pressure, and its traces the sensors:

| effects | in 3D |
|---|---|
| ostium | already in the 3D model, whose geometry has its losses, inertia and motion |
| microvasculature, pump, wall (of the bed) | the block behind the anomalous outlet |
| inlet | the pressure at the ostium |
| sensor | the traces, afterwards |
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from diagnosis.circuit import (
    ELASTIC_SHARE,
    PHASE,
    Beat,
    Circuit,
    autoregulated,
    harmonics,
    past_muscle,
    samples,
    sensed,
)
from lumped.extended_coronary import ExtendedCoronary
from lumped.waveforms import Sampled, sampled


class Boundary(NamedTuple):
    """What a 3D model of the proximal vessel is driven by.

    Attributes:
        bed: the block behind the anomalous outlet.
        P_ostium: pressure in the aorta at the ostium [dyn/cm²] as a function of time.
    """

    bed: ExtendedCoronary
    P_ostium: Sampled


def boundary_of(circuit: Circuit) -> Boundary:
    """The boundary of a circuit, its effects included.

    Two circuits give blocks of one structure, so that a 3D step is compiled once; a viscous wall
    alone adds a state.

    Args:
        circuit: one condition, not traced.
    """

    def wave(P: np.ndarray) -> Sampled:
        times = PHASE * float(circuit.period)
        return sampled(times, np.asarray(P), float(circuit.period), kind="cubic")

    P_ostium = wave(np.asarray(circuit.P_inlet))
    viscous = float(circuit.wall_time) > 0.0
    bed = ExtendedCoronary(
        P_im=wave(np.asarray(circuit.P_LV)),
        P_source=P_ostium,
        R_1=circuit.R_1,
        R_2=circuit.R_2 * autoregulated(circuit),
        R_3=circuit.R_3,
        C_a=circuit.C_a,
        C_im=circuit.C_im,
        P_venous=circuit.P_venous,
        G_collateral=circuit.G_collateral,
        G_past=past_muscle(circuit),
        elastic_share=ELASTIC_SHARE if viscous else 1.0,
        wall_time=circuit.wall_time if viscous else None,
    )
    return Boundary(bed, P_ostium)


def traces_of(circuit: Circuit, P_aorta: np.ndarray, P_distal: np.ndarray) -> np.ndarray:
    """Traces that the sensors of a circuit record of true pressures.

    Args:
        circuit: for its sensors.
        P_aorta: true pressure in the aorta at `circuit.PHASE` [dyn/cm²].
        P_distal: true pressure behind the ostium there [dyn/cm²].

    Returns:
        Aortic and distal trace, 2 × samples [dyn/cm²].
    """
    aortic, distal = harmonics(jnp.asarray(np.stack([P_aorta, P_distal])))
    seen = sensed(circuit, Beat(aortic, distal, jnp.zeros_like(aortic)))
    return np.asarray(samples(jnp.stack([seen.P_aorta, seen.P_distal])))
