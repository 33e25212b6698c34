"""Parameters that a fit may change: where they are, their scale, bounds and priors.

Three variables for each parameter:

    x   the physical value, as the model holds it
    u   the scaled variable: log x, or x in units of its own size; statistics live here
    y   the unbounded variable of the solver

Bounds are a smooth map u(y), as in MINUIT (James & Roos 1975, Comput Phys Commun 10:343):

    both bounds     u = (a + b)/2 + (b − a)/2 sin y
    lower bound     u = a + √(1 + y²) − 1          (upper bound: mirrored)
    none            u = u_start + y

Unlike the logistic map, which puts a bound at infinity, these reach it at a finite y where
du/dy = 0 and d²u/dy² ≠ 0: a fit that ends at a bound converges, and its second derivative there
stays regular, so that the implicit-function theorem still holds (dx/d data = 0). The Jacobian
du/dy enters the solver by differentiation, d²u/dy² as the option `bend`; uncertainties are
computed in u and see neither.
"""

import dataclasses
import difflib
from collections.abc import Callable, Sequence
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from lumped.parameters import Parameter, is_traced, real

INSIDE = 0.05
"""Least distance in y of a start from a bound, where the fit would see no slope."""

AT_BOUND = 1e-5
"""Distance from a bound, as a share of the width (or in u), below which it counts as reached."""


def _optional(value: Any) -> Any:
    return None if value is None else real(value)


def _optional_pair(value: Any) -> Any:
    return None if value is None else (real(value[0]), real(value[1]))


class FreeParameter(eqx.Module):
    """One parameter of a model that a fit may change; it starts at the model's own value.

    Static: name, where, scale, and which of the others are given.

    Attributes:
        name: name in reports; also the path of attributes, items or element names that leads to
            it, such as "alpha" or "coronary.R_2", unless `where` is given.
        where: picks the parameter out of the model, as in `equinox.tree_at`.
        lower: smallest value allowed, or None [unit of the parameter].
        upper: largest value allowed, or None [unit of the parameter].
        scale: "log" for positive parameters known up to a factor, "linear" for others.
        prior: (value, sd) known beforehand, or None; sd is that of log x for scale "log".
    """

    name: str = eqx.field(static=True)
    where: Callable[[Any], Any] | None = eqx.field(static=True, default=None)
    lower: Parameter | None = eqx.field(converter=_optional, default=None)
    upper: Parameter | None = eqx.field(converter=_optional, default=None)
    scale: Literal["log", "linear"] = eqx.field(static=True, default="log")
    prior: tuple[Parameter, Parameter] | None = eqx.field(converter=_optional_pair, default=None)

    def __check_init__(self):
        bounds = [b for b in (self.lower, self.upper) if b is not None]
        numbers = [*bounds, *(self.prior or ())]
        if self.scale not in ("log", "linear"):
            raise ValueError(
                f"Scale '{self.scale}' of '{self.name}' is not known. Use log, linear."
            )
        if is_traced(*numbers):
            return
        if not all(np.all(np.isfinite(np.asarray(number))) for number in numbers):
            raise ValueError(f"A bound or prior of '{self.name}' is not finite. Leave it out.")
        if len(bounds) == 2 and not np.all(np.asarray(bounds[0] < bounds[1])):
            raise ValueError(
                f"The bounds of '{self.name}' leave no room: lower {bounds[0]}, upper {bounds[1]}. "
                "Were they swapped? Hold a parameter by not listing it."
            )
        positive = [*bounds, *(self.prior or ())[:1]] if self.scale == "log" else []
        if any(np.any(np.asarray(number) <= 0) for number in positive):
            raise ValueError(
                f"'{self.name}' has scale 'log' and a bound or prior that is not positive. "
                "Leave the bound out, or use scale='linear'."
            )
        if self.prior is not None and np.any(np.asarray(self.prior[1]) <= 0):
            raise ValueError(f"The prior of '{self.name}' needs a positive standard deviation.")

    def get(self, model: Any) -> Any:
        """The leaf of the model that holds the parameter.

        Raises:
            ValueError: the path does not lead to a number.
        """
        return self.where(model) if self.where is not None else _walk(model, self.name)


def _walk(model: Any, path: str) -> Any:
    for part in path.split("."):
        try:
            if isinstance(model, (tuple, list)):
                model = model[int(part)]
            else:
                model = getattr(model, part) if hasattr(model, part) else model[part]
        except (TypeError, KeyError, IndexError, ValueError) as fault:
            known = _names(model)
            near = difflib.get_close_matches(part, [str(k) for k in known], n=1)
            hint = (
                f"Did you mean '{near[0]}'?" if near else f"It has: {', '.join(map(str, known))}."
            )
            raise ValueError(
                f"'{path}' leads nowhere: {type(model).__name__} has no '{part}'. {hint}"
            ) from fault
    return model


def _names(model: Any) -> list[Any]:
    """What a path may name in a model."""
    if dataclasses.is_dataclass(model):
        return [field.name for field in dataclasses.fields(model)]
    return list(model) if isinstance(model, dict | tuple | list) else []


def as_free(free: Sequence[FreeParameter | str]) -> tuple[FreeParameter, ...]:
    """Free parameters from a list that may name some only."""
    return tuple(FreeParameter(p) if isinstance(p, str) else p for p in free)


def read(model: Any, free: tuple[FreeParameter, ...]) -> Float[Array, "... n"]:
    """Values of the free parameters in a model, along the last axis.

    Raises:
        ValueError: a parameter is absent, is not a number, or is listed twice.
    """
    leaves = [parameter.get(model) for parameter in free]
    for parameter, leaf in zip(free, leaves, strict=True):
        if not (isinstance(leaf, float) or eqx.is_inexact_array(leaf)):
            raise ValueError(
                f"'{parameter.name}' is {type(leaf).__name__}, not a number. Give the model a "
                "value to start from (an absent part has None)."
            )
    names = [parameter.name for parameter in free]
    ids = [id(leaf) for leaf in leaves if isinstance(leaf, jax.Array)]
    if len(set(names)) < len(names) or len(set(ids)) < len(ids):
        raise ValueError(f"A parameter is listed twice in {names}. List each once.")
    return jnp.stack([real(leaf) for leaf in leaves], axis=-1)


def write(model: Any, free: tuple[FreeParameter, ...], values: Float[Array, " n"]) -> Any:
    """A copy of the model with the free parameters at new values."""
    return eqx.tree_at(
        lambda m: [parameter.get(m) for parameter in free],
        model,
        [values[i] for i in range(len(free))],
    )


class Coordinates(eqx.Module):
    """The variables x, u, y of all free parameters; make it with `coordinates`.

    Attributes:
        free: the parameters.
        unit: size of u in physical units for scale "linear", 1 for "log", shape (n,).
        u_start: scaled variables at the model's own values, shape (n,).
    """

    free: tuple[FreeParameter, ...]
    unit: Float[Array, " n"]
    u_start: Float[Array, " n"]

    def values(self, u: Float[Array, " n"]) -> Float[Array, " n"]:
        """x(u): physical values."""
        logarithmic = self._logarithmic()
        return jnp.where(logarithmic, jnp.exp(jnp.where(logarithmic, u, 0.0)), self.unit * u)

    def slope(self, u: Float[Array, " n"]) -> Float[Array, " n"]:
        """dx/du."""
        return jnp.where(self._logarithmic(), self.values(u), self.unit)

    def scaled(self, y: Float[Array, " n"]) -> Float[Array, " n"]:
        """u(y): scaled variables, inside the bounds for all y."""
        columns = []
        for i in range(len(self.free)):
            a, b = self.bounds(i)
            if a is not None and b is not None:
                columns.append(0.5 * (a + b) + 0.5 * (b - a) * jnp.sin(y[i]))
            elif a is not None:
                columns.append(a + jnp.sqrt(1.0 + y[i] ** 2) - 1.0)
            elif b is not None:
                columns.append(b - jnp.sqrt(1.0 + y[i] ** 2) + 1.0)
            else:
                columns.append(self.u_start[i] + y[i])
        return jnp.stack(columns)

    def bend(self, y: Float[Array, " n"]) -> Float[Array, " n"]:
        """u″/u′ of the map u(y), 0 where u′ = 0: how sharply it turns towards a bound."""
        columns = []
        for i, parameter in enumerate(self.free):
            if parameter.lower is not None and parameter.upper is not None:
                columns.append(-_divided(jnp.sin(y[i]), jnp.cos(y[i])))
            elif parameter.lower is not None or parameter.upper is not None:
                columns.append(_divided(1.0, y[i] * (1.0 + y[i] ** 2)))
            else:
                columns.append(jnp.zeros(()))
        return jnp.stack(columns)

    def unbounded(self, u: Float[Array, " n"]) -> Float[Array, " n"]:
        """y(u), moved inside where u is at a bound or beyond."""
        edge = jnp.sin(0.5 * jnp.pi - INSIDE)
        columns = []
        for i in range(len(self.free)):
            a, b = self.bounds(i)
            if a is not None and b is not None:
                share = (2.0 * u[i] - a - b) / (b - a)
                columns.append(jnp.arcsin(jnp.clip(share, -edge, edge)))
            elif a is not None:
                columns.append(_root(u[i] - a))
            elif b is not None:
                columns.append(_root(b - u[i]))
            else:
                columns.append(u[i] - self.u_start[i])
        return jnp.stack(columns)

    def bounds(self, i: int) -> tuple[Array | None, Array | None]:
        """Lower and upper bound of u of parameter i, None where absent."""
        parameter = self.free[i]
        return self._to_scaled(i, parameter.lower), self._to_scaled(i, parameter.upper)

    def at_bound(self, u: Float[Array, " n"]) -> Int[Array, " n"]:
        """−1 where u is at its lower bound, +1 at its upper bound, else 0."""
        flags = []
        for i in range(len(self.free)):
            a, b = self.bounds(i)
            near = AT_BOUND * (b - a if a is not None and b is not None else 1.0)
            low = jnp.zeros((), bool) if a is None else u[i] - a <= near
            high = jnp.zeros((), bool) if b is None else b - u[i] <= near
            flags.append(high.astype(int) - low.astype(int))
        return jnp.stack(flags)

    def prior_residual(self, u: Float[Array, " n"]) -> Float[Array, " n"]:
        """(u − prior)/sd of each parameter, 0 where it has no prior."""
        rows = []
        for i, parameter in enumerate(self.free):
            if parameter.prior is None:
                rows.append(jnp.zeros(()))
                continue
            centre, sd = parameter.prior
            width = sd if parameter.scale == "log" else sd / self.unit[i]
            rows.append((u[i] - self._to_scaled(i, centre)) / width)
        return jnp.stack(rows)

    def _to_scaled(self, i: int, x: Any) -> Any:
        if x is None:
            return None
        return jnp.log(x) if self.free[i].scale == "log" else x / self.unit[i]

    def _logarithmic(self) -> np.ndarray:
        return np.array([parameter.scale == "log" for parameter in self.free])


def _divided(a: Any, b: Array) -> Array:
    return jnp.where(b == 0.0, 0.0, a / jnp.where(b == 0.0, 1.0, b))


def _root(gap: Array) -> Array:
    """Y of √(1 + y²) − 1 = gap, kept away from 0."""
    square = (jnp.maximum(gap, 0.0) + 1.0) ** 2 - 1.0
    return jnp.sqrt(jnp.maximum(square, INSIDE**2))


def coordinates(model: Any, free: tuple[FreeParameter, ...]) -> Coordinates:
    """Scaled and unbounded variables of the free parameters, from the model's own values.

    Raises:
        ValueError: a start (concrete) is not positive on scale "log", or outside its bounds.
    """
    start = jax.lax.stop_gradient(read(model, free))
    if not is_traced(start):
        check_start(free, np.asarray(start))
    unit = jnp.stack([_unit(parameter, start[i]) for i, parameter in enumerate(free)])
    u = [jnp.log(start[i]) if p.scale == "log" else start[i] / unit[i] for i, p in enumerate(free)]
    return Coordinates(free, unit, jnp.stack(u))


def check_start(free: tuple[FreeParameter, ...], start: np.ndarray) -> None:
    """Refuse starts (along the last axis) that are not positive or lie outside their bounds.

    Raises:
        ValueError: parameter, value, what to change.
    """
    for parameter, values in zip(free, np.moveaxis(start, -1, 0), strict=True):
        if parameter.scale == "log" and not np.all(values > 0):
            raise ValueError(
                f"'{parameter.name}' starts at {values} but has scale 'log'. Start from a "
                "positive value, or use scale='linear'."
            )
        low = parameter.lower is not None and np.any(values < np.asarray(parameter.lower))
        high = parameter.upper is not None and np.any(values > np.asarray(parameter.upper))
        if low or high or not np.all(np.isfinite(values)):
            raise ValueError(
                f"'{parameter.name}' starts at {values}, outside its bounds [{parameter.lower}, "
                f"{parameter.upper}]. Move the model's value inside, or widen the bounds."
            )


def _unit(parameter: FreeParameter, start: Array) -> Array:
    """Size of a parameter on a linear scale: prior sd, half the width, its start, or 1."""
    if parameter.scale == "log":
        return jnp.ones(())
    if parameter.prior is not None:
        return real(parameter.prior[1])
    if parameter.lower is not None and parameter.upper is not None:
        return 0.5 * (real(parameter.upper) - real(parameter.lower))
    return jnp.where(start == 0.0, 1.0, jnp.abs(start))
