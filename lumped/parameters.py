"""How blocks and waveforms hold their physical numbers: as array leaves, checked when concrete."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

Parameter = Float[Array, "..."] | float | int
"""A physical number: an array leaf after construction; a Python number is converted."""


def real(value: Any) -> Array:
    """Convert a number or array to a double-precision array leaf."""
    if isinstance(value, jax.Array) and value.dtype == jnp.float32:
        return value  # a copy made for single precision
    return jnp.asarray(value, dtype=jnp.float64)


def is_traced(*values: Any) -> bool:
    """Whether any value is being traced by JAX, so that it cannot be looked at."""
    return any(isinstance(value, Tracer) for value in values)


def parameter(**options: Any) -> Any:
    """Declare a differentiable parameter of an `equinox.Module`."""
    return eqx.field(converter=real, **options)


def optional_parameter() -> Any:
    """Declare a differentiable parameter that may be absent (None)."""
    return eqx.field(converter=lambda v: None if v is None else real(v), default=None)


def check_range(
    owner: Any,
    *,
    above: tuple[str, ...] = (),
    least: tuple[str, ...] = (),
    finite: tuple[str, ...] = (),
) -> None:
    """Refuse parameters that are not finite, not positive (`above`) or negative (`least`).

    Traced values cannot be looked at and pass; they were checked where they were made.

    Raises:
        ValueError: a concrete parameter lies outside its range.
    """
    demands = (
        (above, lambda v: v > 0.0, "finite and positive"),
        (least, lambda v: v >= 0.0, "finite and zero or positive"),
        (finite, np.isfinite, "finite"),
    )
    for names, holds, demand in demands:
        for name in names:
            value = getattr(owner, name)
            if value is None or is_traced(value):
                continue
            numbers = np.asarray(value)
            if not np.all(np.isfinite(numbers) & holds(numbers)):
                raise ValueError(
                    f"{type(owner).__name__}.{name} = {value} must be {demand}. "
                    "Check the sign and the unit (CGS inside: dyn/cm², cm³/s, dyn·s/cm⁵, cm⁵/dyn)."
                )
