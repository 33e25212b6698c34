"""One function of many cases, in chunks and on every device.

The cases are shared out evenly among the devices of JAX: the processors' own, where it was told of
several (``XLA_FLAGS=--xla_force_host_platform_device_count=2``), the GPUs of a machine, or those of
all machines of `jax.distributed`. Each device takes its share in chunks: a chunk is vectorised and
fits the cache, which a single `vmap` of ten thousand does not (two to five times slower), and
memory is that of one chunk beside the results. No device waits for another.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, PartitionSpec

from lumped.device import on_cpu

BATCH = 200
"""Cases a chunk on a CPU: the waveforms of one chunk stay in the second-level cache."""

ACCELERATOR_BATCH = 50_000
"""Cases a chunk on an accelerator: enough to keep it busy, and a gigabyte of waveforms."""

_AXIS = "cases"


def map_cases(function: Callable[[Any], Any], cases: Any, *, batch_size: int | None = None) -> Any:
    """Apply a function to every case of a pytree whose leaves have a leading axis or none.

    With ``jax.default_device`` set, that device does all.

    Args:
        function: of one case; it gives a pytree of arrays.
        cases: pytree whose array leaves have a leading axis (cases,), or none where all share them.
        batch_size: cases a chunk; None: what suits the device.

    Returns:
        The results, each with a leading axis (cases,), in the order of the cases.

    Raises:
        ValueError: the axes differ in length, or there is no case or no chunk.
    """
    if batch_size is None:
        batch_size = BATCH if on_cpu() else ACCELERATOR_BATCH
    cases = jax.tree.map(lambda x: jnp.asarray(x) if isinstance(x, np.ndarray) else x, cases)
    split, shared = eqx.partition(cases, lambda leaf: eqx.is_array(leaf) and leaf.ndim > 0)
    n = length(split)
    if n < 1 or batch_size < 1:
        raise ValueError(
            f"{n} cases in chunks of {batch_size}: give at least one, in chunks of 1 or more."
        )

    def chunked(split: Any, shared: Any) -> Any:
        return jax.lax.map(
            lambda own: function(eqx.combine(own, shared)), split, batch_size=batch_size
        )

    devices = _devices()
    if len(devices) == 1 or n < len(devices):
        return chunked(split, shared)
    arrays, rest = eqx.partition(shared, eqx.is_array)
    spread = jax.shard_map(
        lambda split, arrays: chunked(split, eqx.combine(arrays, rest)),
        mesh=Mesh(devices, (_AXIS,)),
        in_specs=(PartitionSpec(_AXIS), PartitionSpec()),
        out_specs=PartitionSpec(_AXIS),
        check_vma=False,
    )
    filled = jax.tree.map(lambda leaf: _filled(leaf, -n % len(devices)), split)
    return jax.tree.map(lambda leaf: leaf[:n], spread(filled, arrays))


def length(cases: Any) -> int:
    """Number of cases of a pytree.

    Raises:
        ValueError: the leading axes differ in length.
    """
    lengths = {leaf.shape[0] for leaf in jax.tree.leaves(cases) if jnp.ndim(leaf)}
    if len(lengths) != 1:
        raise ValueError(
            "What differs from case to case needs one common length of its leading axes; got "
            f"{sorted(lengths)}."
        )
    return lengths.pop()


def _devices() -> list[jax.Device]:
    chosen = jax.config.jax_default_device  # pyright: ignore[reportAttributeAccessIssue]
    return jax.devices() if chosen is None else [chosen]


def _filled(leaf: jax.Array, missing: int) -> jax.Array:
    """With the last case again, so that every device has as many."""
    if not missing:
        return leaf
    return jnp.concatenate([leaf, jnp.repeat(leaf[-1:], missing, axis=0)])
