"""Shared by the tests of runs: the small tube, as a module."""

import importlib.util
import pathlib
import types

import jax
import pytest


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
