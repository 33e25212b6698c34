"""Shared set-up: runtime shape checks, strict promotion, and the folder of unshipped data."""

import pathlib

import jax
import pytest
from jaxtyping import install_import_hook

with install_import_hook(
    ["lumped", "jaxfsi", "calibration", "diagnosis", "study"], "beartype.beartype"
):
    import calibration
    import diagnosis
    import jaxfsi
    import lumped
    import study

    _PACKAGES = (lumped, jaxfsi, calibration, diagnosis, study)

jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

SHARED_DATA = pathlib.Path(__file__).parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> pathlib.Path:
    """Reference data that may not be shipped; tests that need it skip where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip("reference data folder ../shared/data is not here")
    return SHARED_DATA
