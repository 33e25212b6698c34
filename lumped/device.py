"""What the programs are compiled for, and how they differ by it.

CPU and accelerator compute the same in another order: a CPU gains where fewer bytes are read, an
accelerator where fewer kernels are started and nothing waits for the host.
"""

import jax


def on_cpu() -> bool:
    """Whether programs are compiled for a CPU; known while they are traced."""
    chosen = jax.config.jax_default_device  # pyright: ignore[reportAttributeAccessIssue]
    if chosen is None:
        return jax.default_backend() == "cpu"
    return getattr(chosen, "platform", chosen) == "cpu"
