"""What the programs are compiled for, and how they differ by it.

CPU and accelerator compute the same in another order: a CPU gains where fewer bytes are read, an
accelerator where fewer kernels are started and nothing waits for the host.
"""

import functools
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.tree_util import tree_leaves

from lumped.parameters import is_traced

QUICK_TO_COMPILE = {"xla_cpu_use_fusion_emitters": False}
"""Options of XLA for programs that run a few times: a third less time to compile. Small ones run as
fast with it, a step of the 3D model takes a third longer."""

P = ParamSpec("P")
T = TypeVar("T")


def quick_jit(function: Callable[P, T]) -> Callable[P, T]:
    """Like `equinox.filter_jit`, for a function that runs a few times, see `QUICK_TO_COMPILE`.

    Within another transformation of JAX, whose options count, the two are the same.
    """
    alone = cast(Any, eqx.filter_jit)(function, compiler_options=QUICK_TO_COMPILE)
    within = eqx.filter_jit(function)

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        # a number that is made while a program is traced is traced too
        traced = is_traced(jnp.zeros(()), *tree_leaves((args, kwargs)))
        return (within if traced else alone)(*args, **kwargs)

    return call


def on_cpu() -> bool:
    """Whether programs are compiled for a CPU; known while they are traced."""
    chosen = jax.config.jax_default_device  # pyright: ignore[reportAttributeAccessIssue]
    if chosen is None:
        return jax.default_backend() == "cpu"
    return getattr(chosen, "platform", chosen) == "cpu"
