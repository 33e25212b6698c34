"""How uncertain a scalar is whose inputs are: an interval, its causes, and what would shrink it.

Every input x_i is an increasing function of a standard normal number z_i, so that all inputs of any
distribution are one vector z ~ N(0, I), and a scalar y = f(x(z)). To first order about z = 0::

    y ≈ y₀ + Σ g_i z_i,   g_i = ∂y/∂z_i,   var y ≈ Σ g_i²

g_i is what one standard deviation of an input does to y, and g_i²/Σ g² its share. A scalar that
calibrates inside, such as FFR with α tuned to the resting ratio, has the right correlations by
itself. Shape, quantiles and chances come from samples of z, a scrambled Sobol sequence: for smooth
scalars of a few inputs their error falls nearly as 1/n.

Evidence, a measured value m ± s of something that the same inputs predict as f(z), weighs the
samples by exp(−(f(z) − m)²/2s²) (`calibration.reweighting`).

A costly scalar, such as FFR of a 3D run, is sampled through a cheap one that follows it and a few
runs that say what the cheap one lacks (`calibration.two_levels`).

Source: Smith 2013, Uncertainty Quantification, chapters 8 and 15; Owen 1998, ACM TOMACS 8:71.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import betainc, ndtri

from calibration.cases import map_cases
from calibration.interval import Uncertainty, tail_of
from calibration.reweighting import LEAST_EFFECTIVE, Evidence, agreeing, drawn_again
from calibration.spreads import EDGE, AbstractSpread
from calibration.two_levels import Correction, Runs, correction

MOST_FAILED = 0.01
"""Share of the samples that may have no value."""

MOST_ROUNDS = 16
"""Times that the samples are drawn, each in another sequence, until enough agree with evidence."""


def uncertainty(
    scalar: Callable[[dict[str, Array]], Float[Array, ""]],
    inputs: Mapping[str, AbstractSpread],
    *,
    evidence: Sequence[Evidence] = (),
    runs: Sequence[Runs] = (),
    bounds: tuple[float, float] = (-np.inf, np.inf),
    n_samples: int = 2**12,
    batch_size: int | None = None,
    seed: int = 0,
) -> Uncertainty:
    """The uncertainty of a scalar.

    Args:
        scalar: gives it from a value of each input by name; jittable and differentiable, NaN where
            there is none.
        inputs: distribution of each input, before the evidence.
        evidence: what was measured besides.
        runs: a costlier and better scalar beside this one at a few inputs, then a still costlier
            one beside that, and so on; what each lacks of the next is learned from them.
        bounds: least and largest value that the scalar can have: a correction by runs that goes
            beyond is held there.
        n_samples: samples, rounded up to a power of two.
        batch_size: samples evaluated at once; None: what suits the device.
        seed: of the scrambling.

    Raises:
        ValueError: no input, less than two samples, evidence without a value or a standard
            deviation, or runs of other inputs.
        RuntimeError: the scalar has no value or derivative at the medians, lacks one in more than
            `MOST_FAILED` of the samples, or hardly any sample agrees with the evidence.
    """
    _check(inputs, evidence, runs, n_samples)
    names = tuple(inputs)
    learned = tuple(correction(level) for level in runs)
    spreads, functions = _traced(
        (tuple(inputs.values()), (scalar, *(e.predicted for e in evidence)))
    )
    middle = jnp.zeros(len(names))
    nominal, slopes = (np.asarray(v) for v in _sloped(middle, names, spreads, functions[0]))
    if not (np.isfinite(nominal) and np.all(np.isfinite(slopes))):
        missing = [n for n, g in zip(names, slopes, strict=True) if not np.isfinite(g)]
        raise RuntimeError(
            f"the scalar is {float(nominal):g} where all inputs have their medians, with no"
            f" derivative by {', '.join(missing) or 'none'}. Check those inputs."
        )
    errors = np.array([level.error for level in learned])
    for level in learned:
        nominal, slopes = level(middle, nominal), level.slope(slopes)
        nominal = jnp.clip(nominal, *bounds)
    slopes = np.concatenate([slopes, errors])
    model = _Model(names, spreads, functions, learned, bounds, batch_size)
    z, values, predicted = _samples(n_samples, model, evidence, seed)
    good = np.all([np.isfinite(p) for p in (values, *predicted)], axis=0)
    n_failed = int(np.sum(~good))
    if n_failed > MOST_FAILED * len(values):
        raise RuntimeError(
            f"the scalar has no value in {n_failed} of {len(values)} samples. Narrow the inputs to"
            " what can be: see which samples fail with `standard_normals`."
        )
    z, values = z[good], values[good]
    n_effective = float(len(values))
    if evidence:
        chosen, n_effective = drawn_again([p[good] for p in predicted], evidence, seed)
        z, values = z[chosen], values[chosen]
        slopes = _explained(z, values)
    by_name = dict(zip((*names, *(c.name for c in learned)), slopes.tolist(), strict=True))
    return Uncertainty(float(nominal), by_name, z, values, n_failed, n_effective, learned)


def _explained(
    z: Float[np.ndarray, "samples inputs"], values: Float[np.ndarray, " samples"]
) -> Float[np.ndarray, " inputs"]:
    """By its square the part of the variance that each input explains, with the sign of its slope.

    Evidence makes inputs depend on each other. With y ≈ Σ b_i z_i by least squares the parts are
    b_i cov(z_i, y), which add up to what the line explains.
    """
    dz, dy = z - np.mean(z, axis=0), values - np.mean(values)
    b = np.linalg.lstsq(dz, dy, rcond=None)[0]
    return np.sign(b) * np.sqrt(np.maximum(b * (dz.T @ dy) / len(dy), 0.0))


def evaluate(
    costly: Callable[[dict[str, Array]], Float[Array, ""]],
    cheap: Callable[[dict[str, Array]], Float[Array, ""]],
    inputs: Mapping[str, AbstractSpread],
    n_runs: int,
    *,
    name: str = "model",
    batch_size: int | None = None,
    seed: int = 0,
) -> Runs:
    """A costly and a cheap scalar at a few inputs, for `uncertainty` of the cheap one.

    Args:
        costly: gives it from a value of each input by name; jittable.
        cheap: likewise.
        inputs: see `uncertainty`.
        n_runs: runs, rounded up to a power of two.
        name: of the costly scalar.
        batch_size: runs made at once; None: what suits the device.
        seed: of the scrambling.
    """
    z = standard_normals(n_runs, len(inputs), seed)
    spreads, scalars = _traced((tuple(inputs.values()), (costly, cheap)))
    of_costly, of_cheap = (
        np.asarray(_evaluated(jnp.asarray(z), tuple(inputs), spreads, scalar, batch_size))
        for scalar in scalars
    )
    return Runs(of_costly, of_cheap, z, name, names=tuple(inputs))


def interval_bounds(
    scalar: Callable[[dict[str, Array]], Float[Array, ""]],
    inputs: Mapping[str, AbstractSpread],
    *,
    level: float = 0.9,
    n_samples: int = 2**12,
    batch_size: int | None = None,
    seed: int = 0,
) -> Float[Array, "2"]:
    """Lower and upper bound of a scalar's interval, differentiable by the numbers of the inputs.

    So a derivative of the width by the standard deviation of a measurement says what a better one
    is worth. The quantile p of n samples is their mean in ascending order, weighed by the beta
    distribution with parameters p (n + 1) and (1 − p)(n + 1): smooth, where a single sample is not.

    Args:
        scalar: see `uncertainty`; a sample without a value makes the bounds NaN.
        inputs: likewise; where all of them are exact, so that samples are equal, the bounds have no
            derivative.
        level: part of the samples inside.
        n_samples: likewise.
        batch_size: likewise.
        seed: likewise.

    Raises:
        ValueError: no input, less than two samples, or a level that is not between 0 and 1.

    Source: Harrell & Davis 1982, Biometrika 69:635.
    """
    _check(inputs, (), (), n_samples)
    tail = tail_of(level)
    z = standard_normals(n_samples, len(inputs), seed)
    spreads, scalar = _traced((tuple(inputs.values()), scalar))
    values = _evaluated(jnp.asarray(z), tuple(inputs), spreads, scalar, batch_size)
    n = len(z)
    below = np.linspace(0.0, 1.0, n + 1)
    weights = [
        np.diff(betainc(p * (n + 1), (1.0 - p) * (n + 1), below)) for p in (tail, 1.0 - tail)
    ]
    return jnp.asarray(np.array(weights)) @ jnp.sort(values)


def _check(
    inputs: Mapping[str, AbstractSpread],
    evidence: Sequence[Evidence],
    runs: Sequence[Runs],
    n_samples: int,
) -> None:
    if not inputs:
        raise ValueError("nothing is uncertain: give at least one input")
    if n_samples < 2:
        raise ValueError(f"n_samples = {n_samples!r}: at least 2 are needed")
    if any(not (np.isfinite(e.value) and 0.0 < e.sd < np.inf) for e in evidence):
        raise ValueError(
            "each piece of evidence needs a finite value and a standard deviation above 0"
        )
    called = [*inputs, *(level.name for level in runs)]
    if len(set(called)) < len(called):
        raise ValueError(f"inputs and runs need different names, not {', '.join(called)}")
    for level in runs:
        if level.names and level.names != tuple(inputs):
            raise ValueError(
                f"the runs have the inputs {', '.join(level.names)}, in this order: give the same"
            )
        if level.z is not None and level.z.shape != (len(level.costly), len(inputs)):
            raise ValueError(
                f"{len(level.costly)} runs have inputs of shape {level.z.shape}: give one row a run"
                f" and one column an input, of which there are {len(inputs)}"
            )


class _Model(NamedTuple):
    """A scalar of inputs, what it predicts of the evidence, and what runs add to it."""

    names: tuple[str, ...]
    spreads: tuple[AbstractSpread, ...]
    functions: tuple[Any, ...]
    corrections: tuple[Correction, ...]
    bounds: tuple[float, float]
    batch_size: int | None


def _traced(tree: Any) -> Any:
    """The same with arrays for plain numbers, so that other numbers are not compiled anew."""
    return jax.tree.map(lambda a: jnp.asarray(a) if isinstance(a, float | np.ndarray) else a, tree)


def _inputs(
    z: Float[Array, " inputs"], names: tuple[str, ...], spreads: tuple[AbstractSpread, ...]
) -> dict[str, Array]:
    return {n: s.value(v) for n, s, v in zip(names, spreads, z, strict=True)}


@eqx.filter_jit
def _sloped(z, names, spreads, scalar) -> tuple[Array, Array]:
    return jax.value_and_grad(lambda z: scalar(_inputs(z, names, spreads)))(z)


@eqx.filter_jit
def _evaluated(z, names, spreads, scalar, batch_size: int | None) -> Array:
    """The scalar at each sample."""
    return map_cases(lambda z: scalar(_inputs(z, names, spreads)), z, batch_size=batch_size)


@eqx.filter_jit
def _predicted(z, values, names, spreads, functions, batch_size: int | None) -> tuple[Array, ...]:
    """What each sample predicts of the evidence."""

    def row(sample: tuple[Array, Array]) -> tuple[Array, ...]:
        x = _inputs(sample[0], names, spreads)
        return tuple(predicted(x, sample[1]) for predicted in functions)

    return map_cases(row, (z, values), batch_size=batch_size)


def _samples(
    n: int, model: _Model, evidence: Sequence[Evidence], seed: int
) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Samples, the scalar there and what is predicted of the evidence, until enough agree."""
    parts: list[list[np.ndarray]] = []
    while True:
        parts.append(_drawn(n, model, seed + len(parts)))
        z, values, *predicted = (np.concatenate(column) for column in zip(*parts, strict=True))
        good = np.all([np.isfinite(p) for p in (values, *predicted)], axis=0)
        enough = not evidence or len(parts) == MOST_ROUNDS
        if enough or agreeing([p[good] for p in predicted], evidence) >= LEAST_EFFECTIVE:
            return z, values, predicted


def _drawn(n: int, model: _Model, seed: int) -> list[np.ndarray]:
    """Samples, the scalar there, and what is predicted of each piece of evidence."""
    names, spreads, (scalar, *functions), learned, bounds, batch_size = model
    every = standard_normals(n, len(names) + len(learned), seed)
    z, errors = every[:, : len(names)], every[:, len(names) :]
    values = np.asarray(_evaluated(jnp.asarray(z), names, spreads, scalar, batch_size))
    for level, e in zip(learned, errors.T, strict=True):
        values = np.asarray(level(z, values)) + level.missed(z, values, e)
        values = np.clip(values, *bounds)
    found = _predicted(z, values, names, spreads, tuple(functions), batch_size)
    return [every, values, *(np.asarray(p) for p in found)]


def standard_normals(n: int, n_inputs: int, seed: int = 0) -> Float[np.ndarray, "samples inputs"]:
    """A scrambled Sobol sequence of standard normal numbers, as many as the next power of two."""
    from scipy.stats import qmc  # a fifth of a second to import, for this alone

    sequence = qmc.Sobol(n_inputs, scramble=True, rng=np.random.default_rng(seed))
    uniform = sequence.random_base2(int(np.ceil(np.log2(n))))
    return ndtri(np.clip(uniform, EDGE, 1.0 - EDGE))
