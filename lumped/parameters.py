"""Physical parameters of blocks and waveforms: array leaves, checked when concrete."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Bool, Float

Parameter = Float[Array, "..."] | float | int
"""A physical number: an array leaf after construction; a Python number is converted."""


def real(value: Any) -> Array:
    """Convert a number or array to a double-precision array leaf."""
    if isinstance(value, jax.Array) and value.dtype == jnp.float32:
        return value  # a copy made for single precision
    return jnp.asarray(value, dtype=jnp.float64)


def is_traced(*values: Any) -> bool:
    """Whether any value is traced by JAX, so that it has no concrete number."""
    return any(isinstance(value, Tracer) for value in values)


def parameter(**options: Any) -> Any:
    """Declare a differentiable parameter of an `equinox.Module`."""
    return eqx.field(converter=real, **options)


def optional_parameter() -> Any:
    """Declare a differentiable parameter that may be absent (None)."""
    return eqx.field(converter=lambda v: None if v is None else real(v), default=None)


class Range(NamedTuple):
    """Allowed ranges of the parameters of a class, by the names of its fields.

    Attributes:
        above: finite and positive.
        least: finite and zero or positive.
        finite: finite.
        ascending: two names, the value of the first below that of the second; or none.
    """

    above: tuple[str, ...] = ()
    least: tuple[str, ...] = ()
    finite: tuple[str, ...] = ()
    ascending: tuple[()] | tuple[str, str] = ()


_DEMANDS: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "above": ("finite and positive", lambda v: v > 0.0),
    "least": ("finite and zero or positive", lambda v: v >= 0.0),
    "finite": ("finite", lambda v: v == v),
}


def check_range(owner: Any) -> None:
    """Refuse parameters of a module outside the `ranges` of its class.

    Traced values pass unchecked; use `in_range` for those.

    Raises:
        ValueError: a concrete parameter lies outside its range.
    """
    ranges: Range = owner.ranges
    for kind in _DEMANDS:
        for name in getattr(ranges, kind):
            _refuse(f"{type(owner).__name__}.{name}", getattr(owner, name), kind)
    if ranges.ascending:
        below, above = (getattr(owner, name) for name in ranges.ascending)
        if not is_traced(below, above) and np.any(np.asarray(above) <= np.asarray(below)):
            raise ValueError(
                f"{ranges.ascending[1]} = {above} must lie above {ranges.ascending[0]} = {below} "
                "[dyn/cm²]. Were the two swapped?"
            )


def numbers_in_range(
    *,
    above: Mapping[str, Any] | None = None,
    least: Mapping[str, Any] | None = None,
    finite: Mapping[str, Any] | None = None,
) -> Bool[Array, "..."]:
    """Whether the arguments of a function lie in their ranges, one by one; as in `Range`.

    Args:
        above: numbers by name, with their unit; finite and positive.
        least: likewise; finite and zero or positive.
        finite: likewise; finite.

    Raises:
        ValueError: a concrete number lies outside its range.
    """
    holds = jnp.asarray(True)
    for kind, numbers in (("above", above), ("least", least), ("finite", finite)):
        for name, value in (numbers or {}).items():
            _refuse(name, value, kind)
            holds = holds & _lies(value, kind)
    return holds


def _refuse(name: str, value: Any, kind: str) -> None:
    """Refuse a concrete number outside its range."""
    demand, holds = _DEMANDS[kind]
    if value is None or is_traced(value):
        return
    numbers = np.asarray(value)
    if not np.all(np.isfinite(numbers) & holds(numbers)):
        raise ValueError(
            f"{name} = {value} must be {demand}. "
            "Check the sign and the unit (CGS inside: dyn/cm², cm³/s, dyn·s/cm⁵, cm⁵/dyn)."
        )


def _lies(value: Any, kind: str) -> Bool[Array, "..."]:
    return jnp.isfinite(value) & _DEMANDS[kind][1](real(value))


def in_range(tree: Any) -> Bool[Array, ""]:
    """Whether all parameters of all modules in a tree lie in their `ranges`; for use under jit."""
    holds = jnp.asarray(True)
    for module in _modules(tree):
        ranges: Range = getattr(module, "ranges", Range())
        for kind in _DEMANDS:
            for name in getattr(ranges, kind):
                value = getattr(module, name)
                if value is not None:
                    holds = holds & jnp.all(_lies(value, kind))
        if ranges.ascending:
            below, above = (getattr(module, name) for name in ranges.ascending)
            holds = holds & jnp.all(real(below) < real(above))
    return holds


def _modules(tree: Any) -> list[eqx.Module]:
    """All modules in a tree, those inside others too."""
    found: list[eqx.Module] = []
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, eqx.Module):
            found.append(node)
        inside = jax.tree.leaves(
            node, is_leaf=lambda x, n=node: isinstance(x, eqx.Module) and x is not n
        )
        waiting += [part for part in inside if isinstance(part, eqx.Module) and part is not node]
    return found


def nan_unless(holds: Bool[ArrayLike, "..."]) -> Array:
    """A factor of 1 where a condition holds and NaN elsewhere.

    Values and their derivatives become NaN where the condition does not hold, while
    `jnp.where(holds, value, nan)` would leave derivatives of zero.
    """
    return jnp.where(holds, 1.0, jnp.nan)


def only_if(holds: Bool[ArrayLike, ""], values: Any, inputs: Any) -> Any:
    """Values where a condition holds; elsewhere NaN, and NaN for their derivatives by the inputs.

    No NaN is sent back through what computed the values: implicit solves refuse it.

    Args:
        holds: the condition.
        values: pytree of arrays.
        inputs: pytree of what they were computed from.
    """
    leaves = [x for x in jax.tree.leaves(inputs) if eqx.is_inexact_array(x)]
    failed = jnp.logical_not(holds)
    total = sum(jnp.sum(jnp.where(jnp.isfinite(x) | failed, x, 0.0)) for x in leaves)
    lost = jnp.where(holds, 0.0, jnp.nan) * total
    return jax.tree.map(lambda value: jnp.where(holds, value, jnp.nan) + lost, values)
