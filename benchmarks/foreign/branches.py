"""Evidence of every truth of a generator in one record, each branch at its own nodes.

Branches start from a few fast nodes over their prior. A branch whose nodes cannot explain the data,
in whatever combination, as well as the best so far is left as it is; in the others nodes are added
where the posterior is, by precise runs, until interpolation and run agree there.

A kind that moves every beat by a normal number of its own (`Leaf.course`) is linear in these
numbers: with E the changes that each makes alone and s its size, which enters as a factor,

    log E = log ∫ N(r; 0, G + s² E Eᵀ) / N(r; 0, G) p(s) ds
"""

import dataclasses
from collections.abc import Mapping

import numpy as np
from scipy.special import logsumexp, ndtri
from scipy.stats import qmc

from benchmarks.foreign.effect_runs import Bench, differences, in_sensors
from benchmarks.foreign.evidence import Integral, Metric, Nodes, integrate
from benchmarks.foreign.replay import Drawer, Leaf, leaves

FAR = 8.0
"""A branch counts no more when its evidence falls short of the largest by so much (in its log)."""

SLACK, CLEAR = 2.0, 20.0
"""Factor by which few nodes may underestimate what a branch explains, and a gain of theirs from
which that alone decides: interpolation between them may miss all of it."""

MISSED, SPARE = 0.5, 4.0
"""Share of a change that interpolation may miss, and what else the evidence may gain by nodes."""

SMALL, CLOSE = 3.0, 0.5
"""Lengths: of a change that needs no more nodes; of an error of interpolation that ends it."""

ROUNDS, MOST_NODES = 8, 12
"""Rounds of added nodes; nodes a branch starts with, at most."""

LINE = np.array([0.03, 0.2, 0.6, 0.95])
"""Shares of the prior at which a branch of one size starts; the last three where runs are slow."""

WIDER, WIDENED = 3.0, 0.05
"""Precise nodes reach so many posterior deviations plus so much around the likeliest sizes."""

SIZES = 24
"""Sizes of a course."""


@dataclasses.dataclass
class _Search:
    """One branch on its way.

    Attributes:
        leaf: the branch.
        nodes: so far; None where no patient could have its forms.
        found: the integral over them.
        precise: whether the nodes are precise.
        done: whether more would not help.
    """

    leaf: Leaf
    nodes: Nodes | None
    found: Integral | None
    precise: bool
    done: bool

    @property
    def length(self) -> float:
        """Of the change at the likeliest sizes, in standard deviations."""
        if self.nodes is None or self.found is None:
            return 0.0
        return self.nodes.length(self.found.z[0])

    @property
    def log_evidence(self) -> float:
        """Of the branch with its share."""
        return -np.inf if self.found is None else self.leaf.log_share + self.found.log_evidence

    @property
    def most(self) -> float:
        """An optimistic value of the same."""
        if self.nodes is None:
            return -np.inf
        most = self.nodes.most()
        if most > CLEAR and not self.precise:
            return self.leaf.log_share + SLACK * most
        better = self.log_evidence + SPARE + 0.5 * (MISSED * self.length) ** 2
        return min(self.leaf.log_share + most, better)


def evidences(
    b: Bench, r: np.ndarray, drawers: Mapping[str, Drawer], most: int = MOST_NODES
) -> dict[str, float]:
    """Log E of every truth over that of no effect.

    Args:
        b: scene and base model.
        r: whitened data of the record minus the base model's.
        drawers: of the truths.
        most: nodes that a branch starts with, at most.
    """
    metric = Metric.of(b.unknowns.columns)
    searches: dict[str, list[_Search]] = {}
    courses: dict[str, float] = {}
    for name, drawer in drawers.items():
        branches = leaves(drawer, b.scene.patient)
        if branches[0].course:
            courses[name] = _of_course(b, r, branches[0], metric)
            continue
        searches[name] = [_start(b, r, leaf, metric, most) for leaf in branches]
    every = [one for some in searches.values() for one in some]
    for _ in range(ROUNDS):
        best = max([0.0, *courses.values(), *(one.log_evidence for one in every)])
        left = [one for one in every if not one.done and one.most > best - FAR]
        if not left:
            break
        for one in left:
            _refine(b, r, one, metric)
    found = {name: logsumexp([one.log_evidence for one in some]) for name, some in searches.items()}
    return {name: float(value) for name, value in {**found, **courses}.items()}


def _differences(b: Bench, leaf: Leaf, z: np.ndarray, precise: bool) -> tuple[np.ndarray, ...]:
    """Nodes at which a patient could have the form, and their differences as columns."""
    found = differences(b, [leaf.form(one) for one in z], precise=precise)
    kept = [k for k, d in enumerate(found) if d is not None]
    columns = [d for d in found if d is not None]
    return z[kept], np.stack(columns, axis=1) if columns else np.zeros((b.origin.size, 0))


def _start(b: Bench, r: np.ndarray, leaf: Leaf, metric: Metric, most: int) -> _Search:
    n = len(leaf.used)
    cheap = in_sensors(leaf.form(np.zeros(n)))
    if n == 1:
        z = ndtri(LINE if cheap or not b.blocks else LINE[1:])[:, None]
    else:
        count = 3 * n + 4 if cheap else min(n + 2 if b.blocks else 2 * n + 3, most)
        z = ndtri(qmc.Halton(n, rng=1).random(count + 1)[1:])
    return _search(b, r, leaf, metric, *_differences(b, leaf, z, precise=False), precise=False)


def _search(
    b: Bench,
    r: np.ndarray,
    leaf: Leaf,
    metric: Metric,
    z: np.ndarray,
    d: np.ndarray,
    *,
    precise: bool,
) -> _Search:
    if not len(z):
        return _Search(leaf, None, None, precise, True)
    nodes = Nodes.of(z, d, r, metric, [leaf.ranges[k] for k in leaf.used])
    found = integrate(nodes.gain, len(leaf.used))
    small = nodes.length(found.z[0]) < SMALL and nodes.length(found.mean) < SMALL
    return _Search(leaf, nodes, found, precise, small)


def _refine(b: Bench, r: np.ndarray, one: _Search, metric: Metric) -> None:
    """Add a node at the likeliest sizes; the first time, precise ones around them."""
    if one.nodes is None or one.found is None:
        return
    leaf, at = one.leaf, one.found.z[:1]
    n = at.shape[1]
    if not one.precise and not b.blocks and not in_sensors(leaf.form(at[0])):
        reach = WIDER * one.found.spread + WIDENED
        around = at + reach * ndtri(qmc.Halton(n, rng=2).random(2 * n + 2)[1:])
        z, d = _differences(b, leaf, np.concatenate([at, around]), precise=True)
        new = _search(b, r, leaf, metric, z, d, precise=True)
        new.done = new.nodes is None
    else:
        more, d = _differences(b, leaf, at, precise=True)
        if not len(more):
            one.done = True
            return
        w = one.nodes.weights(at)[0]
        error = d[:, 0] - one.nodes.d @ w
        z = np.concatenate([one.nodes.z, more])
        d = np.concatenate([one.nodes.d, d], axis=1)
        new = _search(b, r, leaf, metric, z, d, precise=True)
        new.done = float(metric.product(error, error)) < CLOSE**2
    one.nodes, one.found, one.precise, one.done = new.nodes, new.found, new.precise, new.done


def _of_course(b: Bench, r: np.ndarray, leaf: Leaf, metric: Metric) -> float:
    """Log E of the module's docstring for a course over beats."""
    beats = max(plan.low.size for plan in b.scene.plans.values())
    rows = len(b.scene.patient.conditions)
    forms = [leaf.form(np.zeros(1), np.tile(np.eye(beats)[k], (rows, 1))) for k in range(beats)]
    whole = [d for d in differences(b, forms, precise=True) if d is not None]
    if not whole:
        return -np.inf
    blocks = np.cumsum([2 * b.scene.acquisition.times[name].size + 2 for name in b.names])
    columns = []
    for d in whole:
        for part in np.split(np.arange(d.size), blocks[:-1]):
            column = np.zeros(d.size)
            column[part] = d[part]
            columns.append(column)
    E = np.stack(columns, axis=1)
    middle = next(iter(leaf.form(np.zeros(1)).size.values()))
    gram, along = metric.product(E, E), metric.product(E, r)
    values, vectors = np.linalg.eigh(gram)
    values, along = np.maximum(values, 0.0), vectors.T @ along
    found = []
    for v in (np.arange(SIZES) + 0.5) / SIZES:
        size = next(iter(leaf.form(np.array([ndtri(v)])).size.values())) / middle
        scale = 1.0 + size**2 * values
        found.append(0.5 * float(np.sum(size**2 * along**2 / scale) - np.log(scale).sum()))
    return float(logsumexp(found) - np.log(SIZES))
