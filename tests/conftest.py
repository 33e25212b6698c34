"""Shared set-up: runtime shape checks, strict promotion, and the folder of unshipped data."""

import gc
import os
import pathlib
from collections.abc import Iterator

import equinox as eqx
import jax
import pytest
from jaxtyping import install_import_hook

# One thread a process, before XLA starts: there is a process on each core, and jaxlib 0.10 can wait
# for ever where a program asks LAPACK for two batches of factorisations at once (see
# `diagnosis.elimination`), which fits and sweeps of `calibration` may do.
os.environ.setdefault("NPROC", "1")

with install_import_hook(
    ["lumped", "jaxfsi", "calibration", "diagnosis", "study"], "beartype.beartype"
):
    import calibration
    import diagnosis
    import jaxfsi
    import lumped
    import study

    _PACKAGES = (lumped, jaxfsi, calibration, diagnosis, study)
    for package in _PACKAGES:  # names are imported on first use, and checked only in here
        for name in dir(package):
            getattr(package, name)

jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

SHARED_DATA = pathlib.Path(__file__).parents[2] / "shared" / "data"


@pytest.fixture(autouse=True, scope="module")
def _compiled_code_released() -> Iterator[None]:
    """Release compiled code after each file.

    A process may have 65 530 memory maps on Linux, and each compiled function takes several: with
    the code of all files kept, the process ends with a fault.
    """
    yield
    eqx.clear_caches()
    jax.clear_caches()
    gc.collect()


@pytest.fixture(scope="session")
def shared_data() -> pathlib.Path:
    """Reference data that may not be shipped; tests that need it skip where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip("reference data folder ../shared/data is not here")
    return SHARED_DATA
