"""The own circuit of the foreign records: states, rates, and two integrators.

    aorta ── loss, L ──┬── R_1 ──┬── R_2 ──┬── R_3 ── P_v
                      C_0       C_a       C_im
                       ⏚     κ P_im(t)   squeeze P_im(t)

States: flow Q through the proximal vessel, transmural pressures of C_0, C_a and C_im, and others
that an effect adds. The distal sensor reads the pressure at C_0's node.

- *Linear* circuits take the exact step under a forcing that is linear within it (exponential of the
  augmented matrix; Van Loan 1978, IEEE Trans Autom Control 23:395).
- Others take ROS2, a Rosenbrock step of second order and L-stable (Verwer et al. 1999, SIAM J Sci
  Comput 20:1456), with a Jacobian from differences at each step.

Both start from the periodic state of the mean beat: solved exactly for linear circuits, by Newton
on the map of one beat otherwise.
"""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from benchmarks.foreign.waves import BeatPlan

Array = np.ndarray
P = dict[str, Array]

SMALLEST_L = 1e-5
"""Inertance where none is asked for [mmHg·s²/mL]: a time constant of 3 µs."""

LEAST_L = 5e-4
"""The same in nonlinear circuits, with and without the effect."""

LARGEST_STATE = 500.0
"""Pressure or flow that no circulation has [mmHg, mL/s]."""

FINER = (1, 4, 16)
"""Multiples of the steps that are tried where fewer lose the solution."""

GAMMA = 1.0 - np.sqrt(0.5)

_SCALES = (1.0, 100.0, 100.0, 100.0)
"""Sizes of the states, for differences."""


class Physics(NamedTuple):
    """Laws that replace those of the base circuit; None keeps the base law.

    Arguments are arrays over members; p holds the parameters, with `on` 1 where the effect acts.

    Attributes:
        loss: (p, Q, P_ao, P_D, z) → pressure drop of the proximal vessel [mmHg].
        arterial: (p, P_D − P_A) → flow through R_1 [mL/s].
        tone: (p, P_D, P_im, z) → factors of R_1 and of R_2.
        venous: (p, P_M, P_im, phase) → flow through R_3 [mL/s].
        side: (p, P_ao, P_D, P_A, P_M, z) → flows into the nodes D, A and M [mL/s].
        extra: (p, P_ao, P_D, P_A, Q, z) → rates of the added states, a list.
        start: values from which the added states start.
        voigt: whether the walls of C_0 and C_a have a resistance (W_0, W_a).
        linear: whether all laws are linear and do not depend on the phase.
    """

    loss: Callable | None = None
    arterial: Callable | None = None
    tone: Callable | None = None
    venous: Callable | None = None
    side: Callable | None = None
    extra: Callable | None = None
    start: tuple[float, ...] = ()
    voigt: bool = False
    linear: bool = True


class Forcing(NamedTuple):
    """What drives the members at one instant: aortic and ventricular pressure [mmHg], phase."""

    P_ao: Array
    P_im: Array
    phase: Array


@dataclasses.dataclass(frozen=True)
class Solved:
    """Traces of the members at the steps of all beats of a plan.

    Attributes:
        t: times from the start of the recorded beats on [s], shape (steps + 1, members).
        P_aorta, P_distal: [mmHg], the same shape.
        Q: flow through the proximal vessel [mL/s].
    """

    t: Array
    P_aorta: Array
    P_distal: Array
    Q: Array


def rates(p: P, f: Forcing, x: Array, physics: Physics) -> tuple[Array, Array]:
    """Rates of the states, and the pressure at the distal sensor.

    Args:
        p: parameters, each over the members.
        f: forcing over the members.
        x: states, shape (states, ..., members).
        physics: laws.
    """
    Q, z = x[0], x[4:]
    P_im = p["squeeze"] * f.P_im
    P_D, P_A, P_M = x[1], x[2] + p["kappa"] * f.P_im, x[3] + P_im
    f1, f2 = physics.tone(p, P_D, P_im, z) if physics.tone else (1.0, 1.0)
    R_1, R_2 = p["R_1"] * f1, p["R_2"] * f2
    if physics.voigt:
        P_D, P_A = _behind_walls(p, Q, P_D, P_A, P_M, R_1, R_2)
    across = P_D - P_A
    Q_1 = physics.arterial(p, across) if physics.arterial else across / R_1
    Q_2 = (P_A - P_M) / R_2
    Q_3 = physics.venous(p, P_M, P_im, f.phase) if physics.venous else (P_M - p["P_v"]) / p["R_3"]
    drop = physics.loss(p, Q, f.P_ao, P_D, z) if physics.loss else p["R_0"] * Q
    D, A, M = physics.side(p, f.P_ao, P_D, P_A, P_M, z) if physics.side else (0.0, 0.0, 0.0)
    found = [
        (f.P_ao - P_D - drop) / p["L"],
        (Q - Q_1 + D) / p["C_0"],
        (Q_1 - Q_2 + A) / p["C_a"],
        (Q_2 - Q_3 + M) / p["C_im"],
    ]
    if physics.extra:
        found += physics.extra(p, f.P_ao, P_D, P_A, Q, z)
    return np.stack(np.broadcast_arrays(*found)), P_D


def _behind_walls(p, Q, P_0, P_a, P_M, R_1, R_2):
    """Node pressures where the walls resist their motion: P = P_elastic + W (net inflow)."""
    W_0, W_a = p["W_0"], p["W_a"]
    a, b = 1.0 + W_0 / R_1, 1.0 + W_a * (1.0 / R_1 + 1.0 / R_2)
    right_0, right_a = P_0 + W_0 * Q, P_a + W_a * P_M / R_2
    det = a * b - W_0 * W_a / R_1**2
    return (b * right_0 + W_0 / R_1 * right_a) / det, (a * right_a + W_a / R_1 * right_0) / det


def solve(
    p: P,
    plan: BeatPlan,
    pressures: Callable[[Array, int], tuple[Array, Array]],
    period: Array,
    physics: Physics,
    steps: int,
    *,
    finer: tuple[int, ...] = FINER,
) -> Solved:
    """Traces of the members over the beats of a plan.

    Args:
        p: parameters, each over the members.
        plan: beats.
        pressures: (phases, place of the beat) → aortic and ventricular pressure over phases and
            members; place −1 is the mean beat.
        period: mean length of a beat, over the members [s].
        physics: laws.
        steps: steps a beat; more where those lose the solution.
        finer: how many times as many are tried, one after the other.

    Raises:
        LostError: no number of steps finds a periodic state.
    """
    lost = np.ones(period.size, bool)
    for more in finer:
        with np.errstate(over="ignore", invalid="ignore"):
            try:
                return _solved(p, plan, pressures, period, physics, more * steps)
            except LostError as error:
                lost = error.members
            except np.linalg.LinAlgError:
                continue
    raise LostError(lost)


class LostError(RuntimeError):
    """States that no circulation has.

    Attributes:
        members: which of the members have them.
    """

    def __init__(self, members: Array):
        super().__init__("The circuit has no periodic state. Draw a smaller effect.")
        self.members = members


def _solved(p: P, plan: BeatPlan, pressures, period: Array, physics: Physics, steps: int) -> Solved:
    p = {**p, "L": np.maximum(p["L"], SMALLEST_L if physics.linear else LEAST_L)}
    beats = range(1) if plan.regular else range(plan.lengths.shape[0])
    march = _Exact(p, physics) if physics.linear else _Rosenbrock(p, physics)
    f, h = _forcing(pressures, -1, 1.0, period, steps)
    x = march.periodic(f, h)
    parts, times, start = [], [], np.zeros_like(period)
    for beat in beats:
        length = plan.lengths[beat]
        f, h = _forcing(pressures, beat, length, period, steps)
        states = march.beat(f, h, x)
        x = states[-1]
        _check(states)
        P_D = rates(p, f, np.moveaxis(states, 1, 0), physics)[1]
        parts.append((f.P_ao[:-1], P_D[:-1], states[:-1, 0]))
        times.append(start + h * np.arange(steps)[:, None])
        start = start + h * steps
    n = plan.lengths.shape[0]
    if plan.regular:
        parts, times = parts * n, [times[0] + k * period for k in range(n)]
    before = period * plan.lengths[: plan.lead].sum(axis=0)
    P_ao, P_D, Q = (np.concatenate(one) for one in zip(*parts, strict=True))
    return Solved(np.concatenate(times) - before, P_ao, P_D, Q)


def _check(x: Array) -> None:
    fine = (np.isfinite(x) & (np.abs(x) < LARGEST_STATE)).reshape(-1, x.shape[-1])
    kept = np.array(fine.all(axis=0))
    if not kept.all():
        raise LostError(~kept)


def _forcing(pressures, beat: int, length, period: Array, steps: int):
    phase = np.arange(steps + 1) / steps
    P_ao, P_im = pressures(phase, beat)
    return Forcing(P_ao, P_im, phase[:, None]), period * length / steps


class _Exact:
    """Exact steps of linear circuits."""

    def __init__(self, p: P, physics: Physics):
        members = p["R_1"].size
        count = 4 + len(physics.start)
        zero = Forcing(*np.zeros((3, members)))
        origin = rates(p, zero, np.zeros((count, members)), physics)[0]
        columns = np.repeat(np.eye(count)[:, :, None], members, axis=2)
        self.A = np.stack(
            [rates(p, zero, column, physics)[0] - origin for column in columns], axis=1
        )
        one, none = np.ones(members), np.zeros(members)
        inputs = [Forcing(one, none, none), Forcing(none, one, none)]
        still = np.zeros((count, members))
        B = [rates(p, f, still, physics)[0] - origin for f in inputs]
        self.B = np.stack([*B, origin], axis=1)
        self.kept: dict[bytes, tuple[Array, Array, Array]] = {}

    def _step(self, h: Array) -> tuple[Array, Array, Array]:
        """Factors of the state, of the input at the start, and of its change in the step."""
        key = h.tobytes()
        if key not in self.kept:
            m, u = self.B.shape[:2]
            whole = np.zeros((h.size, m + 2 * u, m + 2 * u))
            whole[:, :m, :m] = np.moveaxis(self.A * h, 2, 0)
            whole[:, :m, m : m + u] = np.moveaxis(self.B * h, 2, 0)
            whole[:, m : m + u, m + u :] = np.eye(u)
            E = expm(whole)
            self.kept[key] = E[:, :m, :m], E[:, :m, m : m + u], E[:, :m, m + u :]
        return self.kept[key]

    def beat(self, f: Forcing, h: Array, x: Array) -> Array:
        """States at all steps of a beat, shape (steps + 1, states, members)."""
        E, first, change = self._step(h)
        u = np.stack([f.P_ao, f.P_im, np.ones_like(f.P_ao)], axis=2)  # steps, members, inputs
        pushed = np.einsum("bmu,sbu->sbm", first, u[:-1])
        pushed += np.einsum("bmu,sbu->sbm", change, np.diff(u, axis=0))
        found = [x.T[:, :, None]]
        for push in pushed:
            found.append(E @ found[-1] + push[:, :, None])
        return np.moveaxis(np.stack(found)[:, :, :, 0], 1, 2)

    def periodic(self, f: Forcing, h: Array) -> Array:
        """State from which the beat repeats."""
        E = self._step(h)[0]
        still = np.zeros(self.B[:, 0].shape)
        reached = self.beat(f, h, still)[-1].T
        map_ = np.linalg.matrix_power(E, f.P_ao.shape[0] - 1)
        return np.linalg.solve(np.eye(E.shape[1]) - map_, reached[:, :, None])[:, :, 0].T


class _Rosenbrock:
    """ROS2 steps of nonlinear circuits."""

    def __init__(self, p: P, physics: Physics):
        self.p, self.physics = p, physics
        self.scale = 1e-6 * np.array([*_SCALES, *(100.0,) * len(physics.start)])

    def beat(self, f: Forcing, h: Array, x: Array, p: P | None = None) -> Array:
        """States at all steps of a beat, shape (steps + 1, states, members)."""
        p = self.p if p is None else p
        m = x.shape[0]
        eye = np.eye(m)
        moves = np.concatenate([np.zeros((m, 1)), np.diag(self.scale)], axis=1)[:, :, None]
        found = [x]
        for k in range(f.P_ao.shape[0] - 1):
            now, then = (Forcing(*(part[j] for part in f)) for j in (k, k + 1))
            around = rates(p, now, x[:, None, :] + moves, self.physics)[0]
            here = around[:, 0]
            J = (around[:, 1:] - here[:, None]) / self.scale[None, :, None]
            W = np.linalg.inv(eye - GAMMA * np.moveaxis(J * h, 2, 0))
            drift = GAMMA * (rates(p, then, x, self.physics)[0] - here)
            k1 = (W @ (here + drift).T[:, :, None])[:, :, 0].T
            late = rates(p, then, x + h * k1, self.physics)[0]
            k2 = (W @ (late - 2.0 * k1 - drift).T[:, :, None])[:, :, 0].T
            x = x + h * (1.5 * k1 + 0.5 * k2)
            found.append(x)
        return np.stack(found)

    def periodic(self, f: Forcing, h: Array) -> Array:
        """State from which the beat repeats, by Newton on the map of one beat."""
        members = h.size
        base = {**self.p, "on": np.zeros(members)}
        start = _Exact(base, Physics()).periodic(f, h)
        added = np.repeat(np.array(self.physics.start)[:, None], members, axis=1)
        x = np.concatenate([start, added])
        m, solver = x.shape[0], np.zeros(0)
        for attempt in range(6):
            if attempt < 2:
                copies = {name: np.tile(value, m + 1) for name, value in self.p.items()}
                wide = Forcing(np.tile(f.P_ao, m + 1), np.tile(f.P_im, m + 1), f.phase)
                size = 1e3 * self.scale
                moved = np.concatenate([x, *(x + s[:, None] for s in np.diag(size))], axis=1)
                ends = self.beat(wide, np.tile(h, m + 1), moved, copies)[-1]
                ends = ends.reshape(m, m + 1, members)
                reached = ends[:, 0]
                map_ = (ends[:, 1:] - reached[:, None]) / size[None, :, None]
                solver = np.linalg.inv(np.eye(m) - np.moveaxis(map_, 2, 0))
            else:
                reached = self.beat(f, h, x)[-1]
            change = (solver @ (reached - x).T[:, :, None])[:, :, 0].T
            x = x + change
            _check(x)
            if np.all(np.abs(change) < 1e3 * self.scale[:, None] * 1e-2):
                break
        return x
