"""Shared by the tests of verification problems."""

import jax
import pytest


@pytest.fixture(scope="package", autouse=True)
def _fields_times_numbers_of_elements():
    """Allow (3, 3, tets) * (tets,): component arrays put the elements last throughout the core."""
    with jax.numpy_rank_promotion("allow"):
        yield
