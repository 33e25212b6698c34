"""Changes of a circuit that many effects make: a factor, a sum, a slow sensor, a bell on the aorta.

They are told by their numbers, so that the changes of all effects of a catalogue are summed up
before they are applied: a chain of fifty closures takes minutes to compile, a sum seconds. Any
function of a circuit and a size is a change as well; such functions are applied one after another.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from diagnosis.circuit import Circuit
from diagnosis.spectra import PHASE
from lumped.units import MMHG

Change = Callable[[Circuit, Float[Array, ""]], Circuit]


class Scaled(NamedTuple):
    """Numbers of the circuit times exp(rate φ).

    Attributes:
        names: of the numbers.
        rate: per size.
        under: "stress", "adenosine" or "dobutamine", where it acts there alone.
    """

    names: tuple[str, ...]
    rate: float = 1.0
    under: str | None = None

    def __call__(self, circuit: Circuit, size: Float[Array, ""]) -> Circuit:
        """The circuit with this change at a size."""
        return _summed(circuit, [self], jnp.reshape(size, (1,)))


class Added(NamedTuple):
    """A number of the circuit plus unit × φ.

    Attributes:
        name: of the number.
        unit: of the size [unit of the number].
    """

    name: str
    unit: float = 1.0

    def __call__(self, circuit: Circuit, size: Float[Array, ""]) -> Circuit:
        """The circuit with this change at a size."""
        return _summed(circuit, [self], jnp.reshape(size, (1,)))


class Resonance(NamedTuple):
    """A second-order sensor of the natural frequency ω₀ = 2ζ/φ: lag plus φ, inertia plus 1/ω₀².

    Attributes:
        sensor: "aortic", "distal" or "aligned".
        damping: damping ratio ζ [-].
    """

    sensor: str
    damping: float

    def __call__(self, circuit: Circuit, size: Float[Array, ""]) -> Circuit:
        """The circuit with this change at a size."""
        return _summed(circuit, [self], jnp.reshape(size, (1,)))


class Bell(NamedTuple):
    """The aortic pressure plus φ mmHg times exp(−x²/2), or x exp(½ − x²/2) with a rebound.

    x = (t/T − time)/width.

    Attributes:
        time, width: of the bell [beats].
        rebound: a dip that a rise follows.
    """

    time: float
    width: float
    rebound: bool = False

    def __call__(self, circuit: Circuit, size: Float[Array, ""]) -> Circuit:
        """The circuit with this change at a size."""
        return _summed(circuit, [self], jnp.reshape(size, (1,)))

    @property
    def wave(self) -> Float[np.ndarray, " n"]:
        """The waveform at size one [dyn/cm²]."""
        x = (PHASE - self.time) / self.width
        bell = np.exp(-0.5 * x**2)
        return MMHG * (x * np.exp(0.5) * bell if self.rebound else bell)


def changed(circuit: Circuit, changes: Sequence[Change], sizes: Float[Array, " e"]) -> Circuit:
    """The circuit with every change at its size: sums first, then the others in their order."""
    told = [
        k
        for k, change in enumerate(changes)
        if isinstance(change, (Scaled, Added, Resonance, Bell))
    ]
    if told:
        circuit = _summed(circuit, [changes[k] for k in told], sizes[np.array(told)])
    for k, change in enumerate(changes):
        if k not in told:
            circuit = change(circuit, sizes[k])
    return circuit


def _summed(circuit: Circuit, changes: Sequence[Change], sizes: Float[Array, " e"]) -> Circuit:
    """The circuit with changes that are told by their numbers."""
    rates: dict[tuple[str, str | None], np.ndarray] = {}
    units: dict[str, np.ndarray] = {}
    inertias: dict[str, np.ndarray] = {}
    waves = np.zeros((len(changes), PHASE.size))
    for k, change in enumerate(changes):
        if isinstance(change, Scaled):
            for name in change.names:
                rates.setdefault((name, change.under), np.zeros(len(changes)))[k] = change.rate
        elif isinstance(change, Added):
            units.setdefault(change.name, np.zeros(len(changes)))[k] = change.unit
        elif isinstance(change, Resonance):
            units.setdefault(f"{change.sensor}_lag", np.zeros(len(changes)))[k] = 1.0
            inertia = inertias.setdefault(f"{change.sensor}_inertia", np.zeros(len(changes)))
            inertia[k] = (0.5 / change.damping) ** 2
        elif isinstance(change, Bell):
            waves[k] = change.wave
    logs: dict[str, Array] = {}
    for (name, under), rate in rates.items():
        share = jnp.dot(sizes, jnp.asarray(rate))
        share = share if under is None else getattr(circuit, under) * share
        logs[name] = logs[name] + share if name in logs else share
    found = {name: getattr(circuit, name) * jnp.exp(log) for name, log in logs.items()}
    for name, unit in units.items():
        start = found.get(name, getattr(circuit, name))
        found[name] = start + jnp.dot(sizes, jnp.asarray(unit))
    for name, inertia in inertias.items():
        found[name] = getattr(circuit, name) + jnp.dot(sizes**2, jnp.asarray(inertia))
    if waves.any():
        found["P_inlet"] = circuit.P_inlet + sizes @ jnp.asarray(waves)
    return circuit._replace(**found)
