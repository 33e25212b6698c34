"""What a 3D model takes from a circuit, checked in 0D: a network of `lumped` behind the surrogate.

The network is solved with 512 harmonics and no circuit of the diagnosis; what is left is that the
circuit keeps 40.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from diagnosis import CATALOGUE, find_effect, measured
from diagnosis.boundary import BoundaryConditions, boundary_conditions, sensor_traces
from diagnosis.effects import apply_effects
from diagnosis.prediction import as_waves, base_circuit, condition_settings, predict
from diagnosis.spectra import PHASE
from lumped import MMHG, Fourier, PressureSource, Vessel, connect, solve_periodic
from tests.diagnosis.records import settings

DOBUTAMINE = 2
OWN = jnp.asarray(np.array([0.3, -0.2, 0.4, -0.3, 0.2, 0.6, 0.7, 0.0, 0.5, -0.4]))
AT_BOUNDARY = [e.id for e in CATALOGUE if e.place not in ("ostium", "sensor")]
SENSED = [e.id for e in CATALOGUE if e.place == "sensor"]


def situation():
    one = jax.tree.map(lambda leaf: leaf[DOBUTAMINE], condition_settings(measured(settings())))
    return one._replace(adenosine=one.dobutamine)  # both, so that every effect shows


def circuit_with(name: str | None, share: float = 0.7):
    circuit = base_circuit(situation(), OWN)
    if name is None:
        return circuit
    effect = find_effect(CATALOGUE, name)
    return apply_effects(circuit, [effect], jnp.array([share * effect.sd]))


NAMES = [effect.id for effect in CATALOGUE]


@jax.jit
def waves_of(sizes):
    return as_waves(predict(situation(), OWN, CATALOGUE, sizes))


def circuit_waves(name: str | None, share: float = 0.7) -> np.ndarray:
    sizes = jnp.zeros(len(CATALOGUE))
    if name is not None:
        sizes = sizes.at[NAMES.index(name)].set(share * find_effect(CATALOGUE, name).sd)
    return np.asarray(waves_of(sizes))


def network_waves(boundary: BoundaryConditions, circuit) -> np.ndarray:
    artery = Vessel(R_viscous=circuit.R0, C=circuit.C0)
    network = connect(
        {
            "inlet": (PressureSource(boundary.P_ostium), "aorta"),
            "artery": (artery, "aorta", "distal"),
            "bed": (boundary.bed, "distal"),
        }
    )
    found = solve_periodic(network, float(circuit.period), Fourier(n_samples=1024))
    step = 1024 // PHASE.size
    P = [np.asarray(found.pressure(node))[::step] for node in ("aorta", "distal")]
    return np.stack([*P, np.asarray(found.flow("artery"))[::step]])


@pytest.mark.parametrize("name", [None, *AT_BOUNDARY])
def test_bed_with_an_effect_gives_the_traces_of_the_circuit(name):
    circuit = circuit_with(name)
    expected = circuit_waves(name)
    found = network_waves(boundary_conditions(circuit), circuit)
    error = np.sqrt(np.mean((found - expected) ** 2, axis=1))
    # 40 harmonics of pressures with kinks leave 0.05 mmHg rms; flow follows with 1/R0
    assert error[1] < 0.07 * MMHG
    assert error[2] < 0.02 * np.abs(expected[2]).max()
    assert abs(found[1].mean() - expected[1].mean()) < 1e-3 * MMHG
    if name:
        moved = np.sqrt(np.mean((expected - circuit_waves(None)) ** 2, axis=1)).max()
        assert moved > 5.0 * error[1], "the effect shows more than the error"


@pytest.mark.parametrize("name", AT_BOUNDARY)
def test_a_size_of_zero_changes_no_bit(name):
    plain, zero = (
        boundary_conditions(circuit_with(None)),
        boundary_conditions(circuit_with(name, 0.0)),
    )
    assert jax.tree.structure(plain) == jax.tree.structure(zero)
    for a, b in zip(jax.tree.leaves(plain), jax.tree.leaves(zero), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", [n for n in AT_BOUNDARY if n != "wall_viscoelasticity"])
def test_effects_keep_the_structure_so_that_a_step_is_compiled_once(name):
    plain, changed = (
        boundary_conditions(circuit_with(None)),
        boundary_conditions(circuit_with(name)),
    )
    assert jax.tree.structure(plain) == jax.tree.structure(changed)


@pytest.mark.parametrize("name", SENSED)
def test_sensors_do_to_given_pressures_what_they_do_to_those_of_the_circuit(name):
    true, expected = circuit_waves(None), circuit_waves(name)
    seen = sensor_traces(circuit_with(name), true[0], true[1])
    # the traces hold the circuit's harmonics and no others: round-off
    np.testing.assert_allclose(seen, expected[:2], atol=1e-9 * MMHG)
    assert np.abs(expected[:2] - true[:2]).max() > 0.1 * MMHG
