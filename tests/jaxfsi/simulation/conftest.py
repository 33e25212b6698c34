"""Shared by the tests of runs: the small tube, as a module, and runs of it."""

import importlib.util
import pathlib
import types

import jax
import pytest

from jaxfsi.simulation import simulate


@pytest.fixture(scope="package", autouse=True)
def _fields_times_numbers_of_elements():
    """Allow (3, 3, tets) * (tets,): component arrays put the elements last throughout the core."""
    with jax.numpy_rank_promotion("allow"):
        yield


@pytest.fixture(scope="session")
def pulsed() -> types.ModuleType:
    """The module `pulsed_tube.py`."""
    path = pathlib.Path(__file__).with_name("pulsed_tube.py")
    spec = importlib.util.spec_from_file_location("pulsed_tube", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="package")
def tube_model(pulsed):
    """Mesh, model and start of the small tube."""
    return pulsed.pulsed_tube()


@pytest.fixture(scope="package")
def run(tube_model, pulsed):
    """Runs the model with chunks of five steps: one program for all tests."""
    _, model, state = tube_model

    def go(n_steps=20, dt=1e-3, model=model, **options):
        options = {"solver": pulsed.SOLVER, "chunk": 5, **options}
        return simulate(model, state, dt=dt, n_steps=n_steps, **options)

    return go
