"""Shared set-up: runtime shape checks, strict promotion, and the folder of unshipped data."""

import gc
import importlib
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator

import equinox as eqx
import jax
import pytest
from jaxtyping import install_import_hook

# One thread a process, before XLA starts: there is a process on each core, and jaxlib 0.10 can wait
# for ever where a program asks LAPACK for two batches of factorisations at once (see
# `lumped.elimination`), which fits and sweeps of `calibration` may do.
os.environ.setdefault("NPROC", "1")

# Compiled code of this run, for all its processes: compilation is three quarters of the time of
# most tests, and many files compile the same functions. It is empty at the start of each run.
COMPILED = "JAX_COMPILATION_CACHE_DIR"

# Tests compile far more than they compute: code that XLA makes in a third of the time suits them.
CHEAP = (
    "--xla_backend_optimization_level=0 --xla_cpu_use_fusion_emitters=false"
    " --xla_cpu_parallel_codegen_split_count=1"
)


def _accepted(flags: str) -> bool:
    """Whether this version of XLA knows the flags: it ends the process where it does not."""
    first = [sys.executable, "-c", "import jax; jax.devices()"]
    tried = subprocess.run(first, env={**os.environ, "XLA_FLAGS": flags}, capture_output=True)
    return tried.returncode == 0


_OWNER = "PYTEST_XDIST_WORKER" not in os.environ
if _OWNER:
    if _accepted(CHEAP):
        os.environ["XLA_FLAGS"] = f"{CHEAP} {os.environ.get('XLA_FLAGS', '')}"
    os.environ[COMPILED] = tempfile.mkdtemp(prefix="compiled-")
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
jax.config.update("jax_compilation_cache_dir", os.environ[COMPILED])
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)

PACKAGES = ("lumped", "jaxfsi", "calibration", "diagnosis", "study")

jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")

SHARED_DATA = pathlib.Path(__file__).parents[2] / "shared" / "data"


def pytest_configure(config: pytest.Config) -> None:
    """Import the packages with shape checks, where tests run and not where they are handed out."""
    if _OWNER and config.getoption("numprocesses", None):
        return
    with install_import_hook(list(PACKAGES), "beartype.beartype"):
        for package in map(importlib.import_module, PACKAGES):
            for name in dir(package):  # imported on first use, and checked only in here
                getattr(package, name)
    # What is loaded stays: the collector need not look at it again and again.
    gc.freeze()
    gc.set_threshold(50_000, 20, 20)


def pytest_unconfigure() -> None:
    """Remove the compiled code of this run."""
    if _OWNER:
        shutil.rmtree(os.environ[COMPILED], ignore_errors=True)


@pytest.fixture(autouse=True, scope="module")
def _compiled_code_released() -> Iterator[None]:
    """Release compiled code after each file; what other files need again comes from the cache.

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
