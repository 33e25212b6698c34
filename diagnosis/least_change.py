"""The least change of a lumen whose loss is a wanted one.

A catheter pressure may lie out of reach of every boundary condition; then the lumen itself is in
doubt. Of all changes δr(s) of its half-axes the least is, by what the scan knows of them::

    minimise  ½ ∫∫ δr(s) Σ⁻¹(s, s') δr(s') ds ds'    subject to    F[r + δr] = factor · F[r],

    F = R0 + K Q,    Σ(s, s') = σ(s) σ(s') exp(−(s − s')²/(2 ℓ²)),

with R0 and K of `calibration.lumen_losses` and Q the flow at which the loss is wanted (without it
R0 alone). Σ is the prior of the scan's error, a Gaussian process of standard deviation σ and
correlation length ℓ, so that the minimum is the most probable error of the scan given the loss, and

    n_sd = √(δrᵀ Σ⁻¹ δr)

how many of its standard deviations it takes: |δr|/σ is nowhere larger. Both half-axes of a section
change by δr: its outline is stretched along its principal axes, so that an ellipse stays one.

With δr = B z, B Bᵀ = Σ, and f(z) = ln F/F[r], each step solves the linearised problem with its
Lagrange multiplier λ,

    z ← λ ∇f,    λ = (ln factor − f + ∇f·z)/|∇f|²,

taken as far as ½|z|² + ν |f − ln factor| falls (Gauss-Newton, with an exact penalty: Nocedal &
Wright 2006, Numerical Optimization, 2nd ed., section 18.3). The narrowest section, where K arises,
may change; there f has a kink, at which a step may end: of the bundled patient with its loss
halved n_sd is 4 % above the least.

Source: estimating a local diameter where boundary conditions do not suffice is an idea of FalconBC
(arXiv 2603.19331); the prior and the least change are ours.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from calibration import lumen_law
from jaxfsi import Lumen
from lumped.parameters import is_traced, nan_unless

CORRELATION_LENGTH = 0.15
"""Over which errors of a scan are alike along a vessel [cm]. Differences of the radius between the
four pull-backs of the bundled patient, a line taken off, fall to exp(−½) of their variance within
1.0 to 1.5 mm; frames are 0.9 to 1.3 mm apart."""

ULTRASOUND_SD = 0.01
"""Standard deviation of a half-axis by intravascular ultrasound [cm]: two readers differ in the
area of a lumen by −2.1 to 2.6 mm² (95 %; abstract at repub.eur.nl/pub/66054),
so that one has 0.85 mm², 0.09 mm of the radius of a lumen of 7.5 mm²."""

CT_SD = 0.02
"""The same by CT [cm]: a least diameter differs by 0.41 mm from that by ultrasound in the mean of
23 vessels (Eur J Radiol 2012, 81:83, doi 10.1016/j.ejrad.2010.12.008)."""

CLOSEST = 1e-8
"""How far ln F may miss ln factor."""

_STEPS, _POLISHING = 300, 6
_LEAST_PART = 2.0**-14
_FLAT = 1e-5  # minor over major axis, below which a section has no area but rounding
_JITTER = 1e-10  # of the variance, so that Σ has a root
_SETTLED = 1e-9  # least change of z [sd]


class LeastChange(NamedTuple):
    """The least change of a lumen.

    Attributes:
        delta_r: change of both half-axes of each section [cm].
        lumen: the changed lumen.
        R0: its resistance at zero flow [dyn·s/cm⁵].
        K: its quadratic coefficient [dyn·s²/cm⁸].
        factor: its loss over that of the lumen as it was [-].
        n_sd: standard deviations of the scan that the change takes [-].
        imbalance: |z − λ ∇f|/|z| at the end: 0 at a smooth minimum, above it at a kink [-].
    """

    delta_r: Float[Array, " sections"]
    lumen: Lumen
    R0: Float[Array, ""]
    K: Float[Array, ""]
    factor: Float[Array, ""]
    n_sd: Float[Array, ""]
    imbalance: Float[Array, ""]


def least_change(
    lumen: Lumen,
    factor: Float[ArrayLike, ""],
    *,
    sd: Float[ArrayLike, "*sections"],
    mu: Float[ArrayLike, ""],
    rho: Float[ArrayLike, ""],
    Q: Float[ArrayLike, ""] = 0.0,
    correlation_length: Float[ArrayLike, ""] = CORRELATION_LENGTH,
    area_upstream: Float[ArrayLike, ""] = float("inf"),
) -> LeastChange:
    """The least change of a lumen that multiplies its loss by a factor.

    It can be jitted, and batched over any argument.

    Args:
        lumen: sections as scanned, from the ostium downstream.
        factor: wanted loss over that of the lumen [-].
        sd: standard deviation of the half-axes as scanned, one or by section [cm]; a section
            without any keeps its size.
        mu: viscosity of blood [P].
        rho: density of blood [g/cm³].
        Q: flow at which the loss is wanted [cm³/s]; 0 counts R0 alone.
        correlation_length: over which the errors of the scan are alike [cm].
        area_upstream: see `calibration.lumen_losses` [cm²].

    Returns:
        The change; NaN where traced numbers are out of range or the factor is out of reach.

    Raises:
        ValueError: a half-axis or a number is out of range, or no change reaches the factor.
    """
    sd = jnp.broadcast_to(jnp.asarray(sd, dtype=float), lumen.s.shape)
    numbers = (factor, sd, mu, rho, Q, correlation_length, area_upstream)
    asked = _Asked(*(jnp.asarray(v, dtype=float) for v in numbers))
    found, lawful, reached = _solved(lumen, asked)
    if not is_traced(reached):
        for rule, holds in zip(_RULES, lawful, strict=True):
            if not bool(holds):
                raise ValueError(f"no least change of this lumen: {rule}.")
        if not bool(reached):
            raise ValueError(
                f"no change of the lumen was found that multiplies its loss by {factor!s}:"
                f" the nearest reaches {float(found.factor):.4g}. Give the sections that make the"
                " loss a standard deviation above 0, or a factor nearer to 1."
            )
    return jax.tree.map(lambda leaf: leaf * nan_unless(reached), found)


def changed_lumen(lumen: Lumen, delta_r: Float[Array, " sections"]) -> Lumen:
    """A lumen whose half-axes are longer by δr [cm], its outlines stretched along both axes."""
    return _stretched(_shaped(lumen), delta_r)


def half_axes(lumen: Lumen) -> Float[Array, "sections 2"]:
    """Major and minor half-axis of each section by its second moments [cm]."""
    return _shaped(lumen).half_axes


class _Shaped(NamedTuple):
    """Sections in the frames of their principal axes.

    Attributes:
        points: of each outline, along the major and the minor axis from the centroid [cm].
        half_axes: major and minor, of an ellipse 2 √(S/A) with S its principal moments [cm].
        s: see `Lumen` [cm].
    """

    points: Float[Array, "sections points 2"]
    half_axes: Float[Array, "sections 2"]
    s: Float[Array, " sections"]


def _shaped(lumen: Lumen) -> _Shaped:
    """Sections in their principal axes: tan 2θ = 2 S_xy/(S_xx − S_yy), moments of the polygon."""
    p = lumen.contours - lumen.contours[:, :1]
    q = jnp.roll(p, -1, axis=1)
    cross = p[..., 0] * q[..., 1] - q[..., 0] * p[..., 1]
    doubled = jnp.sum(cross, axis=1)
    doubled = jnp.where(doubled == 0.0, 1.0, doubled)
    p = p - jnp.einsum("sp,spk->sk", cross, p + q)[:, None] / (3.0 * doubled)[:, None, None]
    q = jnp.roll(p, -1, axis=1)
    cross = p[..., 0] * q[..., 1] - q[..., 0] * p[..., 1]
    both = jnp.einsum("spk,spl->spkl", p, 2.0 * p + q) + jnp.einsum("spk,spl->spkl", q, p + 2.0 * q)
    S = jnp.einsum("sp,spkl->skl", cross * jnp.sign(doubled)[:, None], both) / 24.0
    angle = 0.5 * jnp.arctan2(2.0 * S[:, 0, 1], S[:, 0, 0] - S[:, 1, 1])
    c, n = jnp.cos(angle)[:, None], jnp.sin(angle)[:, None]
    turned = jnp.stack([c * p[..., 0] + n * p[..., 1], c * p[..., 1] - n * p[..., 0]], axis=-1)
    area = jnp.abs(jnp.sum(cross, axis=1)) / 2.0
    mean = 0.5 * (S[:, 0, 0] + S[:, 1, 1])
    apart = 0.5 * jnp.hypot(S[:, 0, 0] - S[:, 1, 1], 2.0 * S[:, 0, 1])
    moments = jnp.maximum(jnp.stack([mean + apart, mean - apart], axis=-1), 0.0)
    axes = 2.0 * jnp.sqrt(moments / jnp.where(area > 0.0, area, 1.0)[:, None])
    return _Shaped(turned, axes, lumen.s)


def _stretched(shaped: _Shaped, delta_r: Float[Array, " sections"]) -> Lumen:
    factors = 1.0 + delta_r[:, None] / shaped.half_axes
    return Lumen(shaped.points * factors[:, None, :], shaped.s)


_RULES = (
    "every half-axis must be positive: redraw the sections without an area",
    "s must increase from the ostium downstream: sort the sections and leave doubles out",
    "the factor on its loss cannot be reached: give a positive, finite one",
    "the sd of the half-axes [cm] must not be negative, and above 0 somewhere",
    "the correlation length [cm] must be above 0",
    "the flow [cm³/s] must be finite and not negative",
    "viscosity, density and the area upstream must be positive",
)
"""What must hold of the arguments, in the order of `_lawful`."""


class _Asked(NamedTuple):
    """The numbers of `least_change`, as arrays."""

    factor: Array
    sd: Array
    mu: Array
    rho: Array
    Q: Array
    length: Array
    area_upstream: Array


def _lawful(shaped: _Shaped, asked: _Asked) -> Bool[Array, " rules"]:
    """Which of the rules hold."""
    major, minor = shaped.half_axes.T
    factor, sd, mu, rho, Q, length, upstream = asked
    return jnp.stack([
        jnp.all(minor > _FLAT * major) & jnp.all(jnp.isfinite(shaped.half_axes)),
        jnp.all(jnp.diff(shaped.s) > 0.0),
        (factor > 0.0) & jnp.isfinite(factor),
        jnp.all((sd >= 0.0) & jnp.isfinite(sd)) & jnp.any(sd > 0.0),
        length > 0.0,
        (Q >= 0.0) & jnp.isfinite(Q),
        (mu > 0.0) & (rho > 0.0) & (upstream > 0.0),
    ])  # fmt: skip


@jax.jit
def _solved(
    lumen: Lumen, asked: _Asked
) -> tuple[LeastChange, Bool[Array, " rules"], Bool[Array, ""]]:
    """The least change, which of the rules hold, and whether it reaches the factor."""
    shaped = _shaped(lumen)
    lawful = _lawful(shaped, asked)
    wanted = jnp.log(asked.factor * nan_unless(jnp.all(lawful)))
    root = _prior_root(lumen.s, asked.sd, asked.length)
    found = _least(shaped, root, wanted, asked)
    return found, lawful, jnp.abs(jnp.log(found.factor) - wanted) < CLOSEST


def _prior_root(
    s: Float[Array, " n"], sd: Float[Array, " n"], length: Array
) -> Float[Array, "n n"]:
    """B with B Bᵀ = Σ [cm]."""
    correlation = jnp.exp(-0.5 * ((s[:, None] - s[None]) / length) ** 2)
    value, vector = jnp.linalg.eigh(correlation + _JITTER * jnp.eye(s.size))
    return sd[:, None] * vector * jnp.sqrt(jnp.maximum(value, 0.0))[None]


class _At(NamedTuple):
    """The loss at a change of the lumen.

    Attributes:
        z: standardised change.
        log_loss: ln F; infinite where a section has closed.
        slope: its gradient by z.
        R0: see `LeastChange` [dyn·s/cm⁵].
        K: likewise [dyn·s²/cm⁸].
    """

    z: Float[Array, " n"]
    log_loss: Float[Array, ""]
    slope: Float[Array, " n"]
    R0: Float[Array, ""]
    K: Float[Array, ""]


class _State(NamedTuple):
    """A descent; one evaluation a step, so that its code is compiled once.

    Attributes:
        at: where it stands.
        goal: wanted ln F, known from the first evaluation on.
        part: of the step to take.
        n_steps: steps taken.
        n_polished: of those, the last ones, which meet the constraint alone.
    """

    at: _At
    goal: Float[Array, ""]
    part: Float[Array, ""]
    n_steps: Int[Array, ""]
    n_polished: Int[Array, ""]


def _least(shaped: _Shaped, root: Float[Array, "n n"], wanted: Array, asked: _Asked) -> LeastChange:
    """The least change with ln F/F[r] = wanted."""
    n = root.shape[0]

    def log_loss(z: Array) -> tuple[Array, tuple[Array, Array]]:
        is_open = jnp.all(shaped.half_axes[:, 1] + root @ z > 0.0)
        law = lumen_law(
            _stretched(shaped, root @ jnp.where(is_open, z, 0.0)),
            mu=asked.mu,
            rho=asked.rho,
            area_upstream=asked.area_upstream,
        )
        loss = law.R0 + law.K * asked.Q
        lawful = is_open & (loss > 0.0)
        value = jnp.where(lawful, jnp.log(jnp.where(lawful, loss, 1.0)), jnp.inf)
        return value, (law.R0, law.K)

    def step(state: _State) -> _State:
        at, begun, polishing = state.at, state.n_steps > 0, state.n_polished > 0
        weight, aim = _aim(at, state.goal)
        back = at.z - (at.log_loss - state.goal) * at.slope / _square(at.slope)
        tried = jnp.where(polishing, back, at.z + state.part * (aim - at.z))
        tried = jnp.where(begun, tried, 0.0)
        (value, parts), slope = jax.value_and_grad(log_loss, has_aux=True)(tried)
        new = _At(tried, value, slope, *parts)
        goal = jnp.where(begun, state.goal, value + wanted)
        nearer = jnp.abs(value - goal) < jnp.abs(at.log_loss - goal)
        falls = _merit(new, goal, weight) < _merit(at, goal, weight)
        taken = ~begun | jnp.where(polishing, nearer, falls)
        settled = taken & begun & (jnp.linalg.norm(tried - at.z) < _SETTLED)
        part = jnp.where(taken, jnp.minimum(2.0 * state.part, 1.0), state.part / 2.0)
        ends = polishing | settled | (part < _LEAST_PART) | (state.n_steps > _STEPS)
        at = jax.tree.map(lambda a, b: jnp.where(taken, a, b), new, at)
        return _State(at, goal, part, state.n_steps + 1, state.n_polished + jnp.where(ends, 1, 0))

    nothing = jnp.zeros(n)
    start = _At(nothing, jnp.zeros(()), nothing, jnp.zeros(()), jnp.zeros(()))
    count = jnp.zeros((), int)
    begun = _State(start, jnp.zeros(()), jnp.ones(()), count, count)
    state = jax.lax.while_loop(lambda s: s.n_polished <= _POLISHING, step, begun)
    at, length = state.at, jnp.linalg.norm(state.at.z)
    _, aim = _aim(at, state.goal)
    delta_r = root @ at.z
    return LeastChange(
        delta_r=delta_r,
        lumen=_stretched(shaped, delta_r),
        R0=at.R0,
        K=at.K,
        factor=jnp.exp(at.log_loss - state.goal + wanted),
        n_sd=length,
        imbalance=jnp.linalg.norm(at.z - aim) / jnp.where(length > 0.0, length, 1.0),
    )


def _aim(at: _At, goal: Array) -> tuple[Array, Float[Array, " n"]]:
    """Weight ν of the constraint, and the solution of the linearised problem."""
    multiplier = (goal - at.log_loss + at.slope @ at.z) / _square(at.slope)
    return 2.0 * jnp.abs(multiplier), multiplier * at.slope


def _merit(at: _At, goal: Array, weight: Array) -> Array:
    return 0.5 * at.z @ at.z + weight * jnp.abs(at.log_loss - goal)


def _square(slope: Float[Array, " n"]) -> Array:
    square = slope @ slope
    return jnp.where(square > 0.0, square, 1.0)
