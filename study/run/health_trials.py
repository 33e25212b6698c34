"""Whether JAX compiles and computes, and whether what it compiled is kept."""

import time
from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

from study.run.health import Finding
from study.store.cache_contents import cache_contents
from study.store.cache_folder import use_cache

_FLOATS = 2**23
_ROUNDS = 5


def compilation() -> Iterator[Finding]:
    """Devices, and a small program: compiled, timed, and kept."""
    folder = use_cache()
    try:
        devices = [f"{device.device_kind} ({device.platform})" for device in jax.devices()]
    except Exception as error:
        cure = "pip install --upgrade jax jaxlib; on a GPU, with the extra of its CUDA version"
        yield Finding(
            "JAX",
            "",
            f"does not start: {' '.join(str(error).split()) or type(error).__name__}",
            cure,
        )
        return
    yield Finding("devices", ", ".join(devices))
    x = jnp.linspace(0.0, 1.0, _FLOATS)
    start = time.perf_counter()
    program = jax.jit(lambda x, salt: 2.0 * x + salt).lower(x, 1.0).compile()
    compiled = time.perf_counter() - start
    times, found = [], x
    for _ in range(_ROUNDS):
        start = time.perf_counter()
        found = jax.block_until_ready(program(x, 1.0))
        times.append(time.perf_counter() - start)
    wrong = not np.allclose(np.asarray(found[::1024]), 2.0 * np.asarray(x[::1024]) + 1.0)
    rate = 2 * x.nbytes / min(times) / 1e9
    words = f"compiled in {compiled:.2g} s; {rate:.3g} GB/s over {x.nbytes / 2**20:.0f} MiB"
    cure = "pip install --force-reinstall jax jaxlib"
    yield Finding("trial", words, "the numbers are wrong" if wrong else "", cure if wrong else "")
    if folder is not None:
        kept = cache_contents(folder)["compiled code"].files
        problem = "" if kept else "what was compiled is not kept"
        cure = f"look whether {folder} can be written, or is cleared by another program"
        yield Finding("compiled code", f"{kept} files kept", problem, cure if problem else "")
