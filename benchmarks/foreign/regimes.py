"""Baseline `regime`: where the base model fails, and the one term whose lack explains it best.

A regime is one condition in one phase of the beat; the mean flow of a condition is one more. With
the base model linear about its optimum (`plain`), ỹ = [r + J x; 0] and X = [J; I], whose lower rows
are the priors, regime ρ fails by the F test of columns A_ρ that leave its residual free: whitened
raised cosines of each pressure, `STEP` apart, whose centres lie within the window,

    F = (RSS(X) − RSS(X, A_ρ))/q · ν/RSS(X, A_ρ) ~ F(q, ν),    ν = n − rank X − q.

With its own columns free the unknowns are fitted to the rest, which alone gives the scale of the
noise too. For normal noise of any scale the test is exact, priors being data. The worst regime is
left free, and the others are tested again, while p ≤ `LEVEL` over the number of those left (Holm
1979, Scand J Stat 6:65, step by step), so that the model is fitted to the clean regimes in the end.

In failing regimes one term is sought: with residual and derivatives G by sizes of effects projected
on the columns A of these regimes, beyond X, the effect that leaves least squares in the even
coefficients. It must pass the F test of its one column in the odd ones, and leave less than half of
the squares in the failing regimes; else the cause is unknown. A one-sided effect needs a positive
size.

Written from the description of LISDD (Wang 2026, arXiv:2606.23215: clean regimes, sparse local
term, F test on a split sample), not from its code. What differs: the regimes are given, the library
is the linearised catalogue, one term is taken, and priors count as data.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import f as f_distribution

from benchmarks.foreign.plain import FORMS, PlainFit
from diagnosis.measured import Measured, weights, whitener_of
from diagnosis.resolution import HARMONICS
from diagnosis.spectra import FROM_SAMPLES, PHASE
from diagnosis.where import PHASES

LEVEL = 0.05
"""Of the tests: probability that a record without an effect has a failing regime."""

EXPLAINED = 0.5
"""Share of the squares in failing regimes from which their term is named."""

STEP = 0.05
"""Distance of the raised cosines, and half their width [beats]; they sum to one."""

MEAN_FLOW = "mean flow"

_COUNT = 2 * HARMONICS + 1


class Regime(NamedTuple):
    """One condition in one phase.

    Attributes:
        condition: its position in the record.
        phase: a window of `diagnosis.where.PHASES`, or `MEAN_FLOW`.
        columns: whitened columns that leave its residual free, data × columns.
    """

    condition: int
    phase: str
    columns: Float[np.ndarray, "n q"]


class AddedColumns(NamedTuple):
    """What columns explain beyond others.

    Attributes:
        basis: orthonormal basis of the columns' part beyond the others.
        left: the data beyond the others.
        freedom: ν of the test of these columns.
        p: of the F test; 1 where the columns add nothing.
    """

    basis: Float[np.ndarray, "n q"]
    left: Float[np.ndarray, " n"]
    freedom: int
    p: float


def added(
    y: Float[np.ndarray, " n"], Q: Float[np.ndarray, "n k"], A: Float[np.ndarray, "n q"]
) -> AddedColumns:
    """The F test of columns A beside columns Q.

    Args:
        y: data with independent noise of one unknown scale.
        Q: what is fitted anyway, orthonormal.
        A: what is tested.
    """
    left = y - Q @ (Q.T @ y)
    basis = orthonormal(A, Q)
    q, freedom = basis.shape[1], y.size - Q.shape[1] - basis.shape[1]
    if q == 0 or freedom <= 0:
        return AddedColumns(basis, left, max(freedom, 0), 1.0)
    explained = float(np.sum((basis.T @ left) ** 2))
    rest = max(float(left @ left) - explained, np.finfo(float).tiny)
    p = float(f_distribution.sf(explained / q * freedom / rest, q, freedom))
    return AddedColumns(basis, left, freedom, p)


def orthonormal(
    A: Float[np.ndarray, "n q"], beside: Float[np.ndarray, "n k"] | None = None
) -> Float[np.ndarray, "n r"]:
    """Orthonormal basis of columns, or of their part beyond others; what is tiny is left out.

    Args:
        A: columns.
        beside: the others, orthonormal.
    """
    if A.shape[1] == 0:
        return A
    length = np.linalg.norm(A, axis=0)
    beyond = A if beside is None else A - beside @ (beside.T @ A)
    U, s, _ = np.linalg.svd(beyond / np.where(length == 0.0, 1.0, length), full_matrices=False)
    return U[:, s > 1e-7]


def failing(
    y: Float[np.ndarray, " n"], X: Float[np.ndarray, "n k"], columns: list[np.ndarray]
) -> dict[int, float]:
    """Positions of the groups of columns that fail, worst first, with the p-value of each.

    Args:
        y: data with independent noise of one unknown scale.
        X: what is fitted anyway.
        columns: groups of columns.
    """
    Q, found, left = orthonormal(X), {}, list(range(len(columns)))
    while left:
        tests = {r: added(y, Q, columns[r]) for r in left}
        worst = min(left, key=lambda r: tests[r].p)
        if tests[worst].p > LEVEL / len(left):
            break
        found[worst] = tests[worst].p
        Q = np.hstack([Q, tests[worst].basis])
        left.remove(worst)
    return found


def regimes_of(record: Measured) -> list[Regime]:
    """All regimes of a record; their columns have a row for each datum that was measured."""
    weight = np.asarray(weights(record))
    S, (C, d) = record.n_sensors, weight.shape
    centres = (np.arange(round(1.0 / STEP)) + 0.5) * STEP
    away = np.abs((PHASE[:, None] - centres + 0.5) % 1.0 - 0.5)
    waves = np.where(away < STEP, 0.5 + 0.5 * np.cos(np.pi * away / STEP), 0.0)
    phase = [n for x in centres for n, (low, high) in PHASES.items() if low <= x < high]
    shapes = np.zeros((d, S, len(phase)))
    for s in range(S):
        shapes[s * _COUNT : (s + 1) * _COUNT, s] = FROM_SAMPLES @ waves
    flow = np.zeros((d, 1))
    flow[-1] = 1.0
    free = np.concatenate([shapes.reshape(d, -1), flow], axis=1)
    names = np.array([*phase * S, MEAN_FLOW])
    white = np.asarray(whitener_of(record).columns(jnp.asarray(np.tile(free, (C, 1, 1)))))
    found = []
    for c in range(C):
        for name in (*PHASES, MEAN_FLOW):
            own = np.zeros((C, d, int((names == name).sum())))
            own[c] = white[c][:, names == name]
            rows = own.reshape(C * d, -1)[weight.ravel() > 0.0]
            kept = np.linalg.norm(rows, axis=0) > 0.0
            if kept.any():
                found.append(Regime(c, name, rows[:, kept]))
    return found


class Term(NamedTuple):
    """The one term of failing regimes.

    Attributes:
        position: among the columns that were offered.
        share: of the squares in these regimes that it explains.
        p: of its F test in the half of the data that did not choose it.
    """

    position: int
    share: float
    p: float


def single_term(
    y: Float[np.ndarray, " n"],
    X: Float[np.ndarray, "n k"],
    A: Float[np.ndarray, "n q"],
    G: Float[np.ndarray, "n e"],
    one_sided: Bool[np.ndarray, " e"],
    half: Bool[np.ndarray, " n"],
) -> Term | None:
    """The term that leaves least squares within regimes, see above; None where none fits at all.

    Args:
        y: data with independent noise of one unknown scale.
        X: what is fitted anyway; its last rows, as many as it has columns, are the priors.
        A: columns of the failing regimes.
        G: the terms that are offered.
        one_sided: those that need a positive coefficient.
        half: rows that choose; the others confirm. The rows of the priors are used in both.
    """
    prior = np.arange(y.size) >= y.size - X.shape[1]

    def explained(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Share of the squares by each term within the regimes, and the sign of each."""
        found = added(y[rows], orthonormal(X[rows]), A[rows])
        r, g = found.basis.T @ found.left, found.basis.T @ G[rows]
        size = np.linalg.norm(g, axis=0)
        along = np.where(size > 1e-9, r @ g / np.maximum(size, 1e-9), 0.0)
        along = np.where(one_sided, np.maximum(along, 0.0), along)
        return along**2 / max(float(r @ r), np.finfo(float).tiny), along

    first, along = explained(half | prior)
    if not np.any(along != 0.0):
        return None
    best = int(np.argmax(first))
    other = ~half | prior
    p = added(y[other], orthonormal(X[other]), G[other, best : best + 1]).p
    return Term(best, float(explained(np.ones(y.size, bool))[0][best]), p)


def regime_entry(fit: PlainFit) -> dict[str, Any]:
    """The entry of a record: verdict, and under "regimes" the failing ones with their p-values."""
    seen = np.asarray(weights(fit.record)).ravel() > 0.0
    e, J = (np.asarray(own) for own in fit.linear.linear)
    k = J.shape[-1]
    y = np.concatenate([e.ravel()[seen], np.zeros(k)])
    X = np.vstack([J.reshape(-1, k)[seen], np.eye(k)])

    def extended(rows: np.ndarray) -> np.ndarray:
        return np.vstack([rows, np.zeros((k, rows.shape[1]))])

    regimes = regimes_of(fit.record)
    columns = [extended(regime.columns) for regime in regimes]
    failed = failing(y, X, columns)
    where = [
        {"condition": fit.conditions[regimes[r].condition], "phase": regimes[r].phase, "p": p}
        for r, p in failed.items()
    ]
    if not failed:
        return {
            "verdict": "no_gap", "named": [], "probabilities": {"none": 1.0}, "regimes": where
        }  # fmt: skip
    G = extended(np.asarray(fit.linear.effects).reshape(-1, len(FORMS))[seen])
    even = np.broadcast_to(np.arange(e.shape[1]) % 2 == 0, e.shape).ravel()[seen]
    term = single_term(
        y, X, np.hstack([columns[r] for r in failed]), G,
        np.array([form.one_sided for form in FORMS]), np.concatenate([even, np.zeros(k, bool)]),
    )  # fmt: skip
    share = term.share if term is not None and term.p <= LEVEL else 0.0
    effect = [] if term is None else [FORMS[term.position].id]
    probabilities = {name: round(share, 5) for name in effect}
    return {
        "verdict": "named" if share >= EXPLAINED else "unknown",
        "named": effect,
        "probabilities": {**probabilities, "unknown": round(1.0 - share, 5)},
        "regimes": where,
    }
