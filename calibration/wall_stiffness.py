"""Stiffness of a wall round an anomalous coronary, found from the measured motion of its lumen.

Predicted are area and minor axis of the lumen over those of the image (`calibration.loaded_wall`),
measured are the same ratios of the contours (`calibration.lumen_record`). Minimised is the sum of
squares of the differences of their logarithms in units of their standard deviation, over the
logarithms of moduli, support and thickness, with what is known of those beforehand (`known`).
"""

import dataclasses
from collections.abc import Callable, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from calibration.fit import fit
from calibration.found_motion import found_motion
from calibration.free_parameter import FreeParameter, as_free, coordinates, read, write
from calibration.gauss_newton import DampedGaussNewton
from calibration.loaded_wall import LoadedWall, WallStiffness
from calibration.lumen_record import LumenChange
from calibration.optimum import Fit

STIFFNESS_BOUNDS = (1e6, 2e8)
"""Young's moduli that a fit may reach [dyn/cm²]: 0.1 MPa to 20 MPa."""

SUPPORT_BOUNDS = (1e2, 1e7)
"""Support stiffness that a fit may reach [dyn/cm³]."""

THICKNESS_BOUNDS = (0.5, 2.0)
"""Thickness over that of the mesh that a fit may reach."""

SPREAD = {"aorta": 0.5, "coronary": 0.5, "septum": 0.5, "support": 1.5, "thickness": 0.25}
"""Standard deviation of the logarithm of each number between people.

Of moduli: the compliance of 45 human thoracic aortas reached from 1.9 to 17 mm³/mmHg/cm
(Langewouters, Wesseling & Goedhard 1984, J. Biomech. 17:425), a factor of 3 either way, taken as
two standard deviations; the same is assumed of coronary and septum. Of the support, of which little
is known: a factor of 20 either way. Of the thickness, which images do not show well: 1.6."""

IDLE = 0.9
"""Share of its spread between people above which nothing was learned of a number."""

_NEAR = 1e-2
"""Distance from the optimum, in posterior standard deviations, that counts as none."""

Told = Callable[[int, float, bool], None]

FREE = ("aorta", "coronary", "septum", "support")
"""What is fitted unless asked otherwise."""


class MotionData(eqx.Module):
    """Measured motion of the lumen in several states as data of a fit.

    Attributes:
        wall: the wall.
        P: pressure less that of the image in each state, at all nodes [dyn/cm²].
        change: what was measured in each state, arrays stacked.
    """

    wall: LoadedWall
    P: Float[Array, "states nodes"]
    change: LumenChange

    def __call__(self, stiffness: WallStiffness) -> Float[Array, " k"]:
        """Residuals of the logarithms of both ratios, in units of their standard deviation."""
        motion, _ = self.wall.motion(stiffness, self.P)
        return jnp.concatenate(
            [
                jnp.ravel((jnp.log(motion.area) - self.change.log_area) / self.change.sd_area),
                jnp.ravel((jnp.log(motion.minor) - self.change.log_minor) / self.change.sd_minor),
            ]
        )


def free_stiffness(names: Sequence[str] = FREE) -> tuple[FreeParameter, ...]:
    """Free parameters by name, within bounds that no tissue leaves.

    Raises:
        ValueError: a name is not one of `WallStiffness`.
    """
    known = ("aorta", "coronary", "septum", "support", "thickness")
    if unknown := [name for name in names if name not in known]:
        raise ValueError(f"{', '.join(unknown)} cannot be fitted; take some of {', '.join(known)}.")
    bounds = {"support": SUPPORT_BOUNDS, "thickness": THICKNESS_BOUNDS}
    return tuple(
        FreeParameter(name, lower=low, upper=high)
        for name in names
        for low, high in [bounds.get(name, STIFFNESS_BOUNDS)]
    )


def known(free: Sequence[FreeParameter], start: WallStiffness) -> tuple[FreeParameter, ...]:
    """Free parameters with what is known of them: about those of the start, see `SPREAD`."""
    return tuple(
        dataclasses.replace(p, prior=(getattr(start, p.name), SPREAD[p.name])) for p in free
    )


class LinearMotion(eqx.Module):
    """Residuals of a `MotionData` to first order about one stiffness.

    Attributes:
        u: logarithms of the free parameters there.
        residual: residuals there.
        jacobian: their derivative by the logarithms.
        free: the free parameters.
    """

    u: Float[Array, " n"]
    residual: Float[Array, " k"]
    jacobian: Float[Array, "k n"]
    free: tuple[FreeParameter, ...]

    def __call__(self, stiffness: WallStiffness) -> Float[Array, " k"]:
        """Residuals of another stiffness."""
        return self.residual + self.jacobian @ (jnp.log(read(stiffness, self.free)) - self.u)


def linear_motion(
    data: MotionData,
    stiffness: WallStiffness,
    free: tuple[FreeParameter, ...],
    u: Float[Array, " n"],
    near: Sequence[Float[Array, "3 nodes"]] | None = None,
) -> tuple[LinearMotion, list[Float[Array, "3 nodes"]]] | None:
    """The motion at logarithms u of the free parameters; None from the first state not found.

    Args:
        data: the states.
        stiffness: what is not free.
        free: the free parameters.
        u: their logarithms.
        near: displacements from which to set out, see `calibration.found_motion`.

    Returns:
        Residuals and their derivatives, and the displacements of the states [cm].
    """
    at, rows, slopes, moved = write(stiffness, free, jnp.exp(u)), [], [], []
    log = jnp.stack([data.change.log_area, data.change.log_minor])
    sd = jnp.stack([data.change.sd_area, data.change.sd_minor])
    for k, P in enumerate(data.P):
        found = found_motion(data.wall, at, free, P, near=None if near is None else near[k])
        if found is None:
            return None
        rows.append((found.log - log[:, k]) / sd[:, k])
        slopes.append(found.slope / sd[:, k, :, None])
        moved.append(found.d)
    residual, jacobian = jnp.stack(rows, axis=1), jnp.stack(slopes, axis=1)
    return LinearMotion(u, residual.ravel(), jacobian.reshape(-1, len(free)), free), moved


def fit_stiffness(
    data: MotionData,
    start: WallStiffness,
    *,
    free: Sequence[FreeParameter | str] | None = None,
    max_steps: int = 40,
    told: Told | None = None,
) -> Fit:
    """Find the stiffness of a wall that explains the measured motion of its lumen.

    The steps are those of `DampedGaussNewton`, taken one by one, so that equilibria and derivatives
    are compiled once. Each sets out from the equilibria of the last that was taken; where it finds
    none, it is not taken and the next is shorter. What is known of the optimum is that of
    `calibration.fit` on the motion to first order about it.

    Args:
        data: the states to fit.
        start: where the fit starts; what is not free stays there.
        free: what is fitted, on scale "log"; None: the moduli of all regions and the support.
        max_steps: evaluations of the motion allowed.
        told: called with the number of each evaluation, the cost so far, and whether this one found
            equilibria.

    Raises:
        ValueError: a parameter does not exist, starts outside its bounds, or is the thickness of
            a wall that cannot change it.
        RuntimeError: the start has no equilibrium, or the evaluations did not suffice.
    """
    free = as_free(free_stiffness() if free is None else free)
    if any(p.name == "thickness" for p in free) and data.wall.thickening is None:
        raise ValueError(
            "the thickness is to be fitted, but the wall cannot change it. Give `thickening`."
        )
    near = _nearest(data, start, free, max_steps, told)
    at = write(start, free, jnp.exp(near.u))
    found = fit(at, free, near, solver=DampedGaussNewton(atol=_NEAR), max_steps=max_steps)
    return found


def _nearest(
    data: MotionData,
    start: WallStiffness,
    free: tuple[FreeParameter, ...],
    max_steps: int,
    told: Told | None,
) -> LinearMotion:
    """The motion about the optimum."""
    axes = coordinates(start, free)
    solver, options = DampedGaussNewton(atol=_NEAR), {"bend": axes.bend}
    y = axes.unbounded(axes.u_start)
    state = solver.init(None, y, None, options, None, None, frozenset())
    best = near = None
    for k in range(max_steps):
        trial = state.trial
        found = linear_motion(data, start, free, axes.scaled(trial), near)
        if best is None and found is None:
            raise RuntimeError(
                "the start has no equilibrium under the pressures of the states. Start from"
                " stiffer walls, and check pressures and units."
            )

        def about(y, _, found=found):
            u = axes.scaled(y)
            if found is None:  # a trial that is not finite is not taken
                return jnp.full(data.change.log_area.size * 2 + len(free), jnp.inf), None
            here = found[0]
            own = here.residual + here.jacobian @ (u - here.u)
            return jnp.concatenate([own, axes.prior_residual(u)]), None

        y, state, _ = solver.step(about, y, None, options, state, frozenset())
        if found is not None and bool(jnp.all(y == trial)):
            best, near = found
        if told is not None:
            told(k + 1, 2.0 * float(state.cost), found is not None)
        if bool(state.done):
            assert best is not None, "the first trial is taken"
            return best
    raise RuntimeError(
        f"the fit was not at its end after {max_steps} evaluations. Allow more, or hold what"
        " the motion does not determine."
    )


def misfit(found: Fit) -> float:
    """Root of χ² over its degrees of freedom, at least 1: by it the intervals are widened.

    Where the model does not explain the data, residuals are larger than the standard deviations
    that were assumed, and the covariance of the fit is too small by the square of this factor.
    """
    degrees = max(found.residual.shape[-1] - int(found.identifiability.rank), 1)
    return float(max(1.0, float(jnp.sqrt(found.chi2 / degrees))))


def stiffness_interval(found: Fit) -> Float[Array, "n 2"]:
    """Interval of 95 % of each free parameter, widened by `misfit`."""
    return found.interval(1.96 * misfit(found))


def learned(found: Fit) -> tuple[str, ...]:
    """What the lumens say of each number beyond what was known, in plain words.

    Where the data are poor the optimum is the prior, and says nothing of this patient.
    """
    lines = [
        f"{parameter.name} ended at its {'upper' if int(side) > 0 else 'lower'} bound: the lumens"
        " imply a value beyond any tissue, so the model lacks something."
        for parameter, side in zip(found.free, found.at_bound, strict=True)
        if int(side) != 0
    ]
    idle = []
    for parameter, sd in zip(found.free, np.asarray(found.sd_scaled), strict=True):
        if parameter.prior is None:
            continue
        share = float(sd) / float(parameter.prior[1])
        if share > IDLE:
            idle.append(parameter.name)
        else:
            lines.append(
                f"For {parameter.name} the lumens leave {100.0 * share:.0f} % of the spread between"
                " people."
            )
    if idle:
        lines.append(
            f"The lumens say next to nothing about {', '.join(idle)}: value and interval reflect"
            " other people, not this patient."
        )
    return tuple(lines)
